"""Exports open in the projects they are for; pickles of strangers run nothing."""

from __future__ import annotations

import dataclasses
import json
import os
import pickle
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.episodes.schema import feature_columns
from data.errors import DatasetError
from data.features import column
from gaitpref.cli.main import main
from gaitpref.formats.pickles import load_plain_pickle
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.motion import trotting_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Three episodes of 60, 70 (a fall) and 80 steps; a, b, equal and can't tell."""
    return trotting_dataset(tmp_path_factory.mktemp("set"))


def exported(
    dataset: Dataset, form: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> dict[str, Any]:
    """Run the command; gives what it reported."""
    root = ["--dataset", str(dataset.root), "--out", str(out)]
    assert main(["data", "export", *root, "--format", form, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
def test_minari_reads_every_episode(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With T + 1 observations, which minari itself would not miss."""
    minari = pytest.importorskip("minari", reason="needs the package minari")
    report = exported(dataset, "minari", tmp_path / "out", capsys)
    assert (report["episodes"], report["steps"]) == (3, 210)
    found = minari.MinariDataset(tmp_path / "out" / "data")
    assert (found.total_episodes, found.total_steps) == (3, 210)
    assert found.observation_space.shape == (48,)
    metadata = list(found.storage.get_episode_metadata(range(3)))
    for entry, episode, about in zip(
        dataset.entries(), found.iterate_episodes(), metadata, strict=True
    ):
        own = dataset.read(entry.sha256)
        assert episode.observations.shape == (entry.num_steps + 1, 48)
        np.testing.assert_array_equal(episode.observations, own.obs)
        np.testing.assert_array_equal(episode.actions, own.action)
        np.testing.assert_array_equal(episode.rewards, own.reward)
        np.testing.assert_array_equal(episode.infos["qpos"], own.qpos)
        assert bool(episode.terminations[-1]) == (entry.end_reason == "terminated")
        assert bool(episode.truncations[-1]) == (entry.end_reason == "truncated")
        assert about["rollout_sha256"] == entry.sha256


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
def test_minari_makes_the_environment_of_the_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its actions are those recorded, which lie within the bounds that are told."""
    minari = pytest.importorskip("minari", reason="needs the package minari")
    env = EnvCfg()
    robot = load_robot(physics_dt_s=env.physics_dt_s)
    ppo = PpoCfg(num_envs=4, hidden_sizes=(8,), init_std=2.0)
    cfg = TrainCfg(steps=1, env=env, ppo=ppo)
    policy = train(tmp_path / "policy", robot, cfg).policy
    recorded = RecordCfg(episodes=4, episode_s=0.4, noisy_share=1.0, checkpoints=0)
    dataset = Dataset.create(tmp_path / "set")
    dataset.add_episodes(record(policy, recorded, seed=0))
    exported(dataset, "minari", tmp_path / "out", capsys)
    found = minari.MinariDataset(tmp_path / "out" / "data")
    episode = next(found.iterate_episodes())
    assert np.abs(episode.actions).max() == env.action_limit, "noise was clipped"
    assert found.action_space.high.tolist() == [env.action_limit] * 12
    assert all(found.action_space.contains(action) for action in episode.actions)
    made = found.recover_environment()
    assert made.action_space == found.action_space
    made.reset(seed=0)
    observed, *_ = made.step(episode.actions[0])
    assert observed[33:45] == pytest.approx(episode.actions[0], abs=1e-5)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
def test_minari_names_no_environment_that_is_another(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """These episodes have another rate of physics, and an action beyond the limit."""
    minari = pytest.importorskip("minari", reason="needs the package minari")
    exported(dataset, "minari", tmp_path / "out", capsys)
    found = minari.MinariDataset(tmp_path / "out" / "data")
    with pytest.raises(ValueError, match="env_spec is None"):
        found.recover_environment()
    largest = max(np.abs(e.actions).max() for e in found.iterate_episodes())
    assert found.action_space.high.tolist() == [max(3.0, largest)] * 12


def test_d4rl_lies_in_one_piece(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The keys and shapes D4RL documents; its package needs a MuJoCo of 2021."""
    h5py = pytest.importorskip("h5py", reason="needs the extra `export`")
    exported(dataset, "d4rl", tmp_path / "out", capsys)
    with h5py.File(tmp_path / "out" / "dataset.hdf5") as file:
        flat = {name: file[name][()] for name in file if name != "infos"}
        qpos = file["infos/qpos"][()]
    assert {name: array.shape for name, array in flat.items()} == {
        "observations": (210, 48),
        "next_observations": (210, 48),
        "actions": (210, 12),
        "rewards": (210,),
        "terminals": (210,),
        "timeouts": (210,),
    }
    ends = np.cumsum([entry.num_steps for entry in dataset.entries()]) - 1
    assert (
        np.flatnonzero(flat["terminals"] | flat["timeouts"]).tolist() == ends.tolist()
    )
    assert flat["terminals"].sum() == 1
    second = dataset.read(dataset.entries()[1].sha256)
    rows = slice(ends[0] + 1, ends[1] + 1)
    np.testing.assert_array_equal(flat["observations"][rows], second.obs[:-1])
    np.testing.assert_array_equal(flat["next_observations"][rows], second.obs[1:])
    np.testing.assert_array_equal(qpos[rows], second.qpos[:-1])


def test_lerobot_itself_reads_it(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its package wants another torch, so it is there only where somebody put it."""
    lerobot = pytest.importorskip(
        "lerobot.datasets.lerobot_dataset", reason="needs lerobot 0.4, installed apart"
    )
    exported(dataset, "lerobot", tmp_path / "out", capsys)
    loaded = lerobot.LeRobotDataset("local/gaitpref", root=tmp_path / "out")
    assert (len(loaded), loaded.num_episodes, loaded.fps) == (210, 3, 50)
    entry, rows = dataset.entries()[0], dataset.read(dataset.entries()[0].sha256)
    np.testing.assert_array_equal(loaded[5]["observation.state"], rows.obs[5])
    np.testing.assert_array_equal(loaded[5]["action"], rows.action[5])
    assert bool(loaded[entry.num_steps - 1]["next.done"])


@pytest.mark.parametrize("form", ["minari", "d4rl", "lerobot", "hf", "uni-rlhf"])
def test_models_beside_the_episodes_go_along(
    form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each once, under its hash: no format has a place for the robot itself."""
    pytest.importorskip("h5py", reason="needs the extra `export`")
    pytest.importorskip("pyarrow", reason="needs the extra `export`")
    apart = trotting_dataset(tmp_path / "set", models_apart=True)
    exported(apart, form, tmp_path / "out", capsys)
    (model,) = (tmp_path / "out" / "models").iterdir()
    assert model.stem == apart.entries()[0].mjcf_sha256
    assert model.read_text() == apart.read(apart.entries()[0].sha256).mjcf


def test_lerobot_has_the_layout_of_version_3(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As its own reader takes it apart; the package wants another torch."""
    pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra `export`")
    exported(dataset, "lerobot", tmp_path / "out", capsys)
    info = json.loads((tmp_path / "out/meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"]) == ("v3.0", 50)
    assert (info["total_episodes"], info["total_frames"]) == (3, 210)
    episodes = pq.read_table(tmp_path / "out/meta/episodes").to_pylist()
    tasks = pq.read_table(tmp_path / "out/meta/tasks.parquet").to_pylist()
    stats = json.loads((tmp_path / "out/meta/stats.json").read_text())
    frames: list[dict[str, Any]] = []
    for entry, episode in zip(dataset.entries(), episodes, strict=True):
        place = {
            "chunk_index": episode["data/chunk_index"],
            "file_index": episode["data/file_index"],
        }
        table = pq.read_table(tmp_path / "out" / info["data_path"].format(**place))
        assert set(table.column_names) == set(info["features"])
        rows = slice(episode["dataset_from_index"], episode["dataset_to_index"])
        frames = [
            row for row in table.to_pylist() if rows.start <= row["index"] < rows.stop
        ]
        own = dataset.read(entry.sha256)
        assert episode["length"] == len(frames) == entry.num_steps
        states = np.array([row["observation.state"] for row in frames], np.float32)
        np.testing.assert_array_equal(states, own.obs[:-1])
        assert [row["next.done"] for row in frames].index(True) == entry.num_steps - 1
        assert frames[3]["timestamp"] == pytest.approx(0.06)
        assert {row["episode_index"] for row in frames} == {episode["episode_index"]}
        (task,) = [t for t in tasks if t["task_index"] == frames[0]["task_index"]]
        assert episode["tasks"] == [task["__index_level_0__"]]
    actions = np.concatenate([dataset.read(e.sha256).action for e in dataset.entries()])
    assert stats["action"]["mean"] == pytest.approx(actions.mean(axis=0), abs=1e-6)
    assert stats["action"]["std"] == pytest.approx(actions.std(axis=0), rel=1e-5)
    assert stats["action"]["count"] == [210]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_hugging_face_reads_chosen_and_rejected(
    dataset: Dataset,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two preferences; what is equal or cannot be told is counted."""
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("datasets", reason="needs the package datasets")
    report = exported(dataset, "hf", tmp_path / "out", capsys)
    assert (report["preferences"], report["left_out_answers"]) == (2, 2)
    found = datasets.load_dataset(
        str(tmp_path / "out"), split="train", cache_dir=str(tmp_path / "cache")
    )
    assert len(found) == 2
    with dataset.answers_copy() as store:
        (first, _), (second, _) = store.current_answers()[:2]
    for row, chosen, rejected in (
        (found[0], first.a, first.b),
        (found[1], second.b, second.a),
    ):
        for name, clip in (("chosen", chosen), ("rejected", rejected)):
            rows = np.array(row[name], dtype=np.float32)
            assert rows.shape == (40, len(feature_columns()))
            np.testing.assert_array_equal(rows, dataset.clip_features(clip))
            assert row[f"{name}_clip"] == clip.key
        assert row["target"] == 1.0


def test_uni_rlhf_goes_out_and_comes_back(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The indices point at the right rows; a second import adds nothing."""
    h5py = pytest.importorskip("h5py", reason="needs the extra `export`")
    report = exported(dataset, "uni-rlhf", tmp_path / "out", capsys)
    assert (report["preferences"], report["left_out_answers"]) == (3, 1)
    lists = {
        name: pickle.loads((tmp_path / f"out/{name}_num_3_len_40.pkl").read_bytes())
        for name in ("indices_1", "indices_2", "human_label")
    }
    assert lists["human_label"] == [0, 1, -1]
    with h5py.File(tmp_path / "out/dataset.hdf5") as file:
        flat = file["infos/features"][()]
    with dataset.answers_copy() as store:
        answered = [row for row in store.current_answers() if row[1].target is not None]
    for number, (pair, _) in enumerate(answered):
        for name, clip in (("indices_1", pair.a), ("indices_2", pair.b)):
            rows = slice(lists[name][number], lists[name][number] + 40)
            np.testing.assert_array_equal(flat[rows], dataset.clip_features(clip))
    copy = Dataset.create(tmp_path / "copy")
    copy.add_from(dataset, [entry.sha256 for entry in dataset.entries()])
    command = ["data", "import", "uni-rlhf", str(tmp_path / "out")]
    into = ["--dataset", str(copy.root), "--rater", "crowd", "--json"]
    for added in (3, 0):
        assert main([*command, *into]) == 0
        assert json.loads(capsys.readouterr().out) == {"answers": added}
    with copy.answers_copy() as store:
        back = store.current_answers()
    assert [(p.pair_id, a.choice) for p, a in back] == [
        (p.pair_id, a.choice) for p, a in answered
    ]
    assert {a.rater_id for _, a in back} == {"crowd"}


@pytest.fixture
def imitation(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Classes of the names and attributes that imitation 1.0.1 pickles."""

    @dataclasses.dataclass(frozen=True)
    class TrajectoryWithRew:
        obs: np.ndarray
        acts: np.ndarray
        infos: np.ndarray | None
        terminal: bool
        rews: np.ndarray

    class PreferenceDataset:
        def __init__(self, a: list, b: list, preferences: np.ndarray) -> None:
            self.fragments1, self.fragments2 = a, b
            self.max_size = None
            self.preferences = preferences

    for name, cls in (
        ("imitation.data.types", TrajectoryWithRew),
        ("imitation.algorithms.preference_comparisons", PreferenceDataset),
    ):
        module = types.ModuleType(name)
        cls.__module__, cls.__qualname__ = name, cls.__name__
        setattr(module, cls.__name__, cls)
        for parent in (name.split(".")[0], name.rpartition(".")[0]):
            monkeypatch.setitem(sys.modules, parent, types.ModuleType(parent))
        monkeypatch.setitem(sys.modules, name, module)
    return TrajectoryWithRew, PreferenceDataset


@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_imitations_preferences_find_their_clips(
    protocol: int, dataset: Dataset, imitation: Any, tmp_path: Path
) -> None:
    """By what the robot saw and did; 0.75, 0 and 0.5 keep their meaning."""
    trajectory, preference_dataset = imitation
    clips = [Clip(entry.sha256, 7 + n, 30) for n, entry in enumerate(dataset.entries())]

    def fragment(clip: Clip) -> Any:
        episode = dataset.read(clip.rollout)
        return trajectory(
            obs=episode.obs[clip.start : clip.stop + 1],
            acts=episode.action[clip.rows],
            infos=np.array([{} for _ in range(clip.steps)]),
            terminal=False,
            rews=episode.reward[clip.rows],
        )

    a, b = [clips[0], clips[1], clips[0]], [clips[1], clips[2], clips[2]]
    saved = preference_dataset(
        [fragment(clip) for clip in a],
        [fragment(clip) for clip in b],
        np.array([0.75, 0.0, 0.5], dtype=np.float32),
    )
    path = tmp_path / "preferences.pkl"
    path.write_bytes(pickle.dumps(saved, protocol=protocol))
    copy = Dataset.create(tmp_path / "copy")
    copy.add_from(dataset, [entry.sha256 for entry in dataset.entries()])
    into = ["--dataset", str(copy.root), "--rater", "imitation"]
    assert main(["data", "import", "imitation", str(path), *into]) == 0
    with copy.answers_copy() as store:
        found = store.current_answers()
    assert [(p.a, p.b) for p, _ in found] == list(zip(a, b, strict=True))
    assert [answer.target for _, answer in found] == [0.75, 0.0, 0.5]


class Exploit:
    """What a hostile pickle asks to be called."""

    def __init__(self, function: Any, *args: Any) -> None:
        self._call = function, args

    def __reduce__(self) -> tuple[Any, tuple]:
        return self._call


def test_pickles_that_run_code_are_refused(tmp_path: Path) -> None:
    """Nothing of them is called: the file they would make is not there."""
    mark = tmp_path / "mark"
    hostile = [
        Exploit(os.system, f"touch {mark}"),
        Exploit(eval, f"open({str(mark)!r}, 'w')"),
        Exploit(exec, f"open({str(mark)!r}, 'w')"),
        Exploit(os.mkdir, str(mark)),
        [0, 1, {"deep": Exploit(os.system, f"touch {mark}")}],
        Exploit(getattr, "os", "system"),
        Exploit(np.load, str(mark)),
        Exploit(np.ndarray, (10**12,)),
    ]
    texts = [
        pickle.dumps(value, protocol=protocol)
        for value in hostile
        for protocol in range(pickle.HIGHEST_PROTOCOL + 1)
    ]
    # By hand: the old opcode that names a class, a count without bytes, the end.
    texts += [b"cos\nsystem\n(S'touch " + str(mark).encode() + b"'\ntR.", b""]
    texts += [b"\x80\x05\x8e" + (2**62).to_bytes(8, "little") + b"x.", b"\x80\x04}"]
    path = tmp_path / "labels.pkl"
    for text in texts:
        path.write_bytes(text)
        with pytest.raises(DatasetError, match="is refused"):
            load_plain_pickle(path)
        assert not mark.exists()
    path.write_bytes(pickle.dumps([np.arange(3), np.float32(0.5), b"x", "y"]))
    arrays, number, content, text = load_plain_pickle(path)
    assert (arrays.tolist(), number, content, text) == ([0, 1, 2], 0.5, b"x", "y")


def test_imports_of_other_episodes_are_refused(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is added where the indices or the fragments mean something else."""
    pytest.importorskip("h5py", reason="needs the extra `export`")
    out = tmp_path / "out"
    exported(dataset, "uni-rlhf", out, capsys)
    other = Dataset.create(tmp_path / "other")
    command = ["data", "import", "uni-rlhf", "--dataset", str(other.root)]
    label = out / "human_label_num_3_len_40.pkl"
    for content, message in (
        (None, "is in no episode of this data set"),
        (pickle.dumps([0, 1]), "do not belong together"),
        (pickle.dumps([0, 1, "x"]), "no list of whole numbers"),
        (pickle.dumps(Exploit(os.system, "true")), "could run code"),
    ):
        if content is not None:
            label.write_bytes(content)
        assert main([*command, str(out)]) == 2
        assert message in capsys.readouterr().err
    (out / "episodes.json").unlink()
    assert main([*command, str(out)]) == 2
    assert "nobody knows which episodes" in capsys.readouterr().err
    with other.answers_copy() as store:
        assert store.pairs() == []


def test_exports_replace_nothing_and_leave_hardware_out(
    dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An episode without actions is counted; a directory that is there stays."""
    mixed = Dataset.create(tmp_path / "mixed")
    mixed.add_from(dataset, [entry.sha256 for entry in dataset.entries()])
    episode = dataset.read(dataset.entries()[0].sha256)
    rows = episode.features.copy()
    rows[:, column("action")] = np.nan
    hardware = dataclasses.replace(
        episode,
        obs=np.full_like(episode.obs, np.nan),
        action=np.full_like(episode.action, np.nan),
        features=rows,
        meta=dataclasses.replace(episode.meta, extra={"missing_features": "action"}),
    )
    (entry,) = mixed.add_episodes([hardware])
    pair = Pair.make(
        Clip(entry.sha256, 0, 40),
        Clip(dataset.entries()[1].sha256, 0, 40),
        strategy="u",
        round=0,
    )
    with mixed.answers() as store:
        store.add_rater("ada", "human")
        store.add_pairs([pair])
        store.add_answer(
            Answer(
                answer_id="1",
                pair_id=pair.pair_id,
                rater_id="ada",
                choice="a",
                shown_left="a",
                created_utc="2030-01-31T12:00:00Z",
            )
        )
    report = exported(mixed, "uni-rlhf", tmp_path / "out", capsys)
    assert (report["left_out_episodes"], report["left_out_answers"]) == (1, 1)
    assert exported(mixed, "hf", tmp_path / "hf", capsys)["preferences"] == 1
    again = ["--dataset", str(mixed.root), "--out", str(tmp_path / "out")]
    assert main(["data", "export", *again, "--format", "d4rl"]) == 2
    assert "is there already" in capsys.readouterr().err
    assert (tmp_path / "out" / "episodes.json").exists()
