"""Tables of others come in by a map of their columns, with a walk's truth beside."""

from __future__ import annotations

import csv
import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from data.datasets.dataset import Dataset
from data.episodes.episode import Episode
from data.features import column
from gaitpref import steps_from_qpos
from gaitpref.cli.main import main
from gaitpref.formats.logs.log_map import LogError
from policy.robots.robot import Robot, load_robot
from tests.helpers.walked import walked

h5py = pytest.importorskip("h5py", reason="needs the extra `logs`")
pa = pytest.importorskip("pyarrow", reason="needs the extra `logs`")
pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra `logs`")

JOINTS = [f"{leg}{k}" for leg in ("fr", "fl", "rr", "rl") for k in range(3)]
NAMED = f"""
robot = "go1"
command = [0.5, 0, 0]
ground = "zero"
contact_height_m = 0.002
[columns]
time = "t"
base_pos = ["x", "y", "z"]
base_quat = ["qw", "qx", "qy", "qz"]
joint_pos = {json.dumps(JOINTS)}
"""
STATES = 'robot = "go1"\nground = "zero"\ncontact_height_m = 0.002\n[columns]\n'


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=0.02)


def run(
    form: str, place: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str, str]:
    root = place.parent
    (root / "map.toml").write_text(text)
    into = ["--map", str(root / "map.toml"), "--dataset", str(root / "set"), "--json"]
    code = main(["data", "import", form, str(place), *into])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def take(
    form: str, place: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> tuple[dict[str, Any], list[Episode]]:
    """What was reported, and the episodes in their order."""
    code, out, error = run(form, place, text, capsys)
    assert code == 0, error
    dataset = Dataset.open(place.parent / "set")
    episodes = [dataset.read(entry.sha256) for entry in dataset.entries()]
    episodes.sort(key=lambda episode: episode.meta.env_index)
    return json.loads(out), episodes


def named_columns(episode: Episode, robot: Robot) -> dict[str, np.ndarray]:
    """The columns of `NAMED`."""
    times_s = np.arange(len(episode.qpos)) * 0.02
    base = dict(
        zip(["x", "y", "z", "qw", "qx", "qy", "qz"], episode.qpos.T, strict=False)
    )
    joints = dict(zip(JOINTS, episode.qpos[:, robot.qpos_adr].T, strict=True))
    return {"t": times_s, **base, **joints}


def write_csv(place: Path, columns: dict[str, np.ndarray], mark: str = ",") -> Path:
    with place.open("w", newline="") as file:
        lines = csv.writer(file, delimiter=mark)
        lines.writerow(columns)
        lines.writerows(zip(*columns.values(), strict=True))
    return place


def off(found: Episode, truth: Episode, name: str) -> float:
    """Root mean square difference of a feature, over the whole episode."""
    assert found.num_steps == truth.num_steps
    error = found.features[:, column(name)] - truth.features[:, column(name)]
    return float(np.sqrt(np.mean(error**2)))


def require_alike(found: Episode, truth: Episode, *, told: bool) -> None:
    """The truth; velocities that were worked out are smoothed a little."""
    assert off(found, truth, "base_lin_vel_b") < (1e-3 if told else 0.02)
    assert off(found, truth, "joint_vel") < (1e-3 if told else 1.0)
    assert off(found, truth, "base_height") < 0.002
    assert off(found, truth, "gravity_b") < 0.01
    part = column("foot_contact")
    same = found.features[:, part] == truth.features[:, part]
    assert same.mean() > 0.9


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_a_csv_of_named_columns_comes_in(
    tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str], mark: str
) -> None:
    truth = walked()[0]
    columns = named_columns(truth, robot) | {"note": np.full(len(truth.qpos), "ok")}
    place = write_csv(tmp_path / "walk.csv", columns, mark)
    told, (found,) = take("csv", place, NAMED, capsys)
    assert told["left_out"] == {}
    require_alike(found, truth, told=False)
    assert found.meta.extra["source"] == "csv"


def test_states_of_mujoco_come_in_out_of_an_npz(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = walked()[1]
    np.savez(tmp_path / "walk.npz", qpos=truth.qpos, qvel=truth.qvel, dt=0.02)
    text = STATES + 'rate_hz = 50\nqpos = "qpos"\nqvel = "qvel"\n'
    _, (found,) = take("npz", tmp_path / "walk.npz", text, capsys)
    require_alike(found, truth, told=True)


def test_what_a_criterion_cannot_see_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A log has no actions: who looks for small changes of them skips, and is told
    why; who looks at heights is not."""
    for number, truth in enumerate(walked()[:2]):
        place = tmp_path / f"walk{number}.npz"
        np.savez(place, qpos=truth.qpos, qvel=truth.qvel, dt=0.02)
        text = STATES + 'rate_hz = 50\nqpos = "qpos"\nqvel = "qvel"\n'
        run("npz", place, text, capsys)
    root = str(tmp_path / "set")
    assert main(["pairs", "--dataset", root, "--count", "4", "--clip-s", "0.5"]) == 0
    capsys.readouterr()
    for criterion, told in (("smooth", True), ("crouch", False)):
        assert main(["answer", "--dataset", root, "--criterion", criterion]) == 0
        said = " ".join(capsys.readouterr().err.split())
        skipped = "4 were skipped: of a clip that lacks what smooth looks at" in said
        assert skipped == told
        assert ("lack action, action_rate" in said) == told


def test_lists_and_episodes_come_in_out_of_parquet(
    tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    """Time in nanoseconds, xyzw, joints as parts of a list, two walks in one file."""
    rows = []
    for number, truth in enumerate(walked()[:2]):
        for k, (qpos, qvel) in enumerate(zip(truth.qpos, truth.qvel, strict=True)):
            rows.append(
                {
                    "run": number,
                    "ns": 7_000_000_000 + k * 20_000_000,
                    "pos": qpos[:3].tolist(),
                    "quat": qpos[[4, 5, 6, 3]].tolist(),
                    "joints": [0.0, *qpos[robot.qpos_adr], *qvel[robot.qvel_adr]],
                }
            )
    pq.write_table(pa.Table.from_pylist(rows), tmp_path / "walk.parquet")
    text = STATES + (
        'time = "ns"\ntime_unit_s = 1e-9\nepisode = "run"\nbase_pos = "pos"\n'
        'base_quat = "quat"\nquat_order = "xyzw"\n'
        'joint_pos = ["joints[1:10]", "joints[10]", "joints[11:13]"]\n'
        'joint_vel = "joints[13:25]"\n'
    )
    _, found = take("parquet", tmp_path / "walk.parquet", text, capsys)
    assert len(found) == 2
    for each, truth in zip(found, walked(), strict=False):
        require_alike(each, truth, told=False)
        assert off(each, truth, "joint_vel") < 1e-3


def exported(tmp_path: Path, form: str, capsys: pytest.CaptureFixture[str]) -> Path:
    dataset = Dataset.create(tmp_path / "own")
    dataset.add_episodes(walked())
    out = tmp_path / "out"
    command = ["data", "export", "--dataset", str(dataset.root), "--out", str(out)]
    assert main([*command, "--format", form]) == 0
    capsys.readouterr()
    return out


def by_command(episodes: list[Episode]) -> list[Episode]:
    return sorted(episodes, key=lambda e: e.features[:, column("base_lin_vel_b")].sum())


def test_what_is_exported_for_minari_comes_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = exported(tmp_path, "minari", capsys)
    text = STATES + 'rate_hz = 50\nqpos = "infos/qpos"\nqvel = "infos/qvel"\n'
    _, found = take("minari", out, text, capsys)
    pairs = zip(by_command(found), by_command(list(walked())), strict=True)
    for each, truth in pairs:
        require_alike(each, truth, told=True)


def test_a_lerobot_set_without_a_place_of_the_base_comes_in(
    tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of velocity, gravity and joints in one list; the height is estimated."""
    out = exported(tmp_path, "lerobot", capsys)
    home = [float(angle) for angle in robot.home_joint_pos]
    text = f"""robot = "go1"
[joints]
offsets_rad = {home}
[columns]
base_lin_vel = "observation.state[0:3]"
base_ang_vel = "observation.state[3:6]"
gravity = "observation.state[6:9]"
joint_pos = "observation.state[9:21]"
joint_vel = "observation.state[21:33]"
command = "observation.state[45:48]"
"""
    told, found = take("lerobot", out, text, capsys)
    assert told["estimated"] == ["base_height"]
    pairs = zip(by_command(found), by_command(list(walked())), strict=True)
    for each, truth in pairs:
        # An observation more than there are frames.
        rows, ours = truth.features[: each.num_steps], each.features
        for name, most in (("base_lin_vel_b", 0.01), ("gravity_b", 0.01)):
            error = ours[:, column(name)] - rows[:, column(name)]
            assert np.sqrt(np.mean(error**2)) < most, name
        error = ours[:, column("base_height")] - rows[:, column("base_height")]
        assert np.sqrt(np.mean(error**2)) < 0.01
        assert each.meta.command == truth.meta.command


def test_an_older_lerobot_set_has_a_file_an_episode(
    tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "old"
    (out / "meta").mkdir(parents=True)
    (out / "meta/info.json").write_text(json.dumps({"codebase_version": "v2.1"}))
    (out / "data/chunk-000").mkdir(parents=True)
    for number, truth in enumerate(walked()[:2]):
        rows = len(truth.qpos)
        table = {
            "timestamp": np.arange(rows, dtype=np.float32) * np.float32(0.02),
            "episode_index": np.full(rows, number),
            "state": list(truth.qpos),
        }
        name = f"data/chunk-000/episode_{number:06d}.parquet"
        pq.write_table(pa.table(table), out / name)
    _, found = take("lerobot", out, STATES + 'qpos = "state"\n', capsys)
    for each, truth in zip(found, walked(), strict=False):
        require_alike(each, truth, told=False)
    (out / "meta/info.json").write_text('{"codebase_version": "v1.6"}')
    code, _, error = run("lerobot", out, STATES + 'qpos = "state"\n', capsys)
    assert (code, "versions 2 and 3 are read" in error) == (2, True)


def test_rows_that_cannot_be_are_left_out_and_told(
    tmp_path: Path, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    """NaN, empty cells, times twice and time that goes back."""
    columns = named_columns(walked()[0], robot)
    columns["fr0"] = columns["fr0"].copy()
    columns["fr0"][10] = np.nan
    columns["t"] = np.where(np.arange(201) < 100, columns["t"], columns["t"] - 1.5)
    columns["t"][21] = columns["t"][20]
    columns["t"][22] = np.nan
    place = write_csv(tmp_path / "walk.csv", columns)
    told, found = take("csv", place, NAMED, capsys)
    assert told["left_out"]["rows whose joint_pos is no number that can be"] == 1
    assert told["left_out"]["rows at the time of another"] == 1
    assert told["left_out"]["rows without a time"] == 1
    assert any("time goes back" in line for line in told["told"])
    assert len(found) == 2


def _csv(text: str) -> Callable[[Path], None]:
    def write(place: Path) -> None:
        place.joinpath("x.csv").write_text(text)

    return write


def _npz_of(name: str, content: bytes) -> Callable[[Path], None]:
    def write(place: Path) -> None:
        with zipfile.ZipFile(place / "x.npz", "w") as archive:
            archive.writestr(name, content)

    return write


def _array_head(shape: tuple[int, ...]) -> bytes:
    head = io.BytesIO()
    facts = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(head, facts)
    return head.getvalue()


def _pickled(place: Path) -> None:
    np.savez(place / "x.npz", qpos=np.array([os.system], dtype=object))


def _of_two_lengths(place: Path) -> None:
    rows = {"qpos": np.zeros((501, 19)), "torque": np.zeros((500, 12))}
    np.savez(place / "x.npz", **rows)  # type: ignore[arg-type]


def _linked(place: Path) -> None:
    with h5py.File(place / "x.minari", "w") as file:
        file["qpos"] = h5py.ExternalLink("/etc/passwd", "/")


def _virtual(place: Path) -> None:
    with h5py.File(place / "x.minari", "w") as file:
        layout = h5py.VirtualLayout(shape=(100, 19), dtype="f8")
        layout[:] = h5py.VirtualSource("/etc/passwd", "a", shape=(100, 19))
        file.create_virtual_dataset("qpos", layout)


def _sparse(place: Path) -> None:
    with h5py.File(place / "x.minari", "w") as file:
        file.create_dataset("qpos", shape=(2**40, 19), chunks=(64, 19), dtype="f8")


def _strings(place: Path) -> None:
    pq.write_table(pa.table({"qpos": ["a"] * 9}), place / "x.parquet")


def _ragged(place: Path) -> None:
    pq.write_table(pa.table({"qpos": [[1.0], [1.0, 2.0]] * 9}), place / "x.parquet")


QPOS = STATES + 'rate_hz = 50\nqpos = "qpos"\n'
TORQUES = QPOS + 'joint_torque = "torque"\n'


@pytest.mark.parametrize(
    ("form", "make", "text", "reason"),
    [
        ("csv", _csv("t,x\n"), NAMED, "has 0 rows"),
        ("csv", _csv("a,b\n1,2\n"), NAMED, "has none of the columns"),
        ("csv", _csv("t,t\n1,2\n"), NAMED, "two columns have one name"),
        ("csv", _csv("t,x\n1\n"), NAMED, "line 2: 1 cells, where the first line"),
        ("csv", _csv("t,x\n1,up\n"), NAMED, "line 2: a cell is no number"),
        ("csv", _csv("t,x\n" + "1,2\n" * 9), NAMED, "no column 'y'"),
        ("csv", _csv("\xff\xfe"), NAMED, "has none of the columns"),
        ("npz", _csv(""), QPOS, "is missing"),
        ("npz", _npz_of("qpos.npy", b"no"), QPOS, "qpos is no array"),
        ("npz", _npz_of("qpos.npy", _array_head((2**40, 19))), QPOS, "claims to be"),
        ("npz", _npz_of("qpos.npy", _array_head(())), QPOS, "a row of numbers"),
        ("npz", _pickled, QPOS, "got object"),
        ("npz", _of_two_lengths, TORQUES, "(qpos 501, torque 500)"),
        ("minari", _linked, QPOS, "has none of the columns"),
        ("minari", _virtual, QPOS, "lies in another file"),
        ("minari", _sparse, QPOS, "the limit is"),
        ("parquet", _strings, QPOS, "must hold numbers, got string"),
        ("parquet", _ragged, QPOS, "lists of different lengths"),
        ("parquet", _csv(""), QPOS, "is missing"),
    ],
)
def test_a_hostile_table_is_refused_in_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    form: str,
    make: Callable[[Path], None],
    text: str,
    reason: str,
) -> None:
    make(tmp_path)
    code, _, error = run(form, tmp_path / f"x.{form}", text, capsys)
    assert code == 2
    assert reason in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('robot = "go1"\n', "no table [columns]"),
        (QPOS.replace('robot = "go1"\n', ""), "which robot the log is of"),
        (QPOS.replace("rate_hz = 50\n", ""), "names no time"),
        (QPOS.replace("rate_hz = 50", "rate_hz = 1"), "are 1 s apart"),
        (QPOS.replace("rate_hz = 50", "rate_hz = -1"), "rate_hz must be positive"),
        (QPOS.replace('"qpos"', '"qpos[0:12]"'), "must be 19 numbers"),
        (QPOS.replace('"qpos"', '"qpos[0:99]"'), "is no part of qpos"),
        (QPOS.replace("qpos =", "joint_pos ="), "must be 12 numbers"),
        (QPOS.replace("qpos =", "pose ="), "no field pose"),
        (
            QPOS.replace('"qpos"', '"qpos[7:19]"').replace("qpos =", "joint_pos ="),
            "no 6",
        ),
    ],
)
def test_a_map_that_does_not_fit_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, reason: str
) -> None:
    np.savez(tmp_path / "x.npz", qpos=walked()[0].qpos)
    code, _, error = run("npz", tmp_path / "x.npz", text, capsys)
    assert code == 2
    assert reason in error


def test_states_of_a_program_become_an_episode(tmp_path: Path) -> None:
    """As the recorder has them, but for what nobody told."""
    truth = walked()[2]
    touch = np.vstack([np.ones((1, 4)), truth.features[:, column("foot_contact")]])
    found = steps_from_qpos(
        "go1",
        truth.qpos,
        truth.qvel,
        0.02,
        command=truth.meta.command,
        contact=touch,
        action=np.vstack([np.zeros((1, 12)), truth.action]),
    )
    alike = ("base_lin_vel_b", "base_ang_vel_b", "gravity_b", "base_height", "command")
    alike += ("joint_pos_offset", "joint_vel", "foot_contact", "foot_height", "action")
    for name in alike:
        assert off(found, truth, name) < 1e-5, name
    assert off(found, truth, "foot_speed") < 1e-4
    assert np.isnan(found.features[:, column("joint_torque")]).all()
    assert found.meta.command == truth.meta.command
    dataset = Dataset.create(tmp_path / "set")
    (entry,) = dataset.add_episodes([found])
    assert dataset.read(entry.sha256).num_steps == truth.num_steps


def test_velocities_nobody_told_are_worked_out() -> None:
    truth = walked()[2]
    found = steps_from_qpos("go1", truth.qpos, None, 0.02)
    require_alike(found, truth, told=False)
    assert "joint_vel" in found.meta.extra["derived_features"]
    fallen = steps_from_qpos("go1", truth.qpos, None, 0.02, fell=True)
    assert fallen.end_reason == "terminated"
    assert fallen.features[-1, column("fallen")] == 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"qpos": np.zeros((9, 18))}, r"qpos must be \[9, 19\]"),
        ({"qpos": np.zeros((9, 19))}, "attitude of length 0"),
        ({"qpos": np.zeros((2, 19))}, "it needs 6 or more"),
        ({"qpos": [["a"] * 19] * 9}, "must hold numbers"),
        ({"qvel": np.zeros((3, 18))}, r"qvel must be \[201, 18\]"),
        ({"qvel": np.full((201, 18), np.inf)}, r"qvel\[0\] holds inf"),
        ({"contact": np.zeros((201, 3))}, r"contact must be \[201, 4\]"),
        ({"dt_s": 0.0}, "dt_s must be positive"),
        ({"command": np.zeros((3, 3))}, r"command must be \[201, 3\]"),
    ],
)
def test_states_that_cannot_be_are_refused(
    changes: dict[str, Any], reason: str
) -> None:
    own = {"qpos": walked()[0].qpos, "qvel": None, "dt_s": 0.02} | changes
    with pytest.raises(LogError, match=reason):
        steps_from_qpos("go1", **own)
