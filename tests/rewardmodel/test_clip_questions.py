"""From episodes to questions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.walks import walk, walking_dataset
from data.answers.answer_records import Answer, Choice, Pair
from data.answers.strategy_names import APPROVAL
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.episodes.episode import Episode
from data.errors import GaitprefError
from data.features import column
from gaitpref.cli.main import main
from gaitpref.cli.options.options import Loop
from gaitpref.cli.shared.loop_arguments import resolve
from gaitpref.loop.run_dir import Round
from gaitpref.loop.show_stage import duel_of, pairs_of_both
from gaitpref.method.acceptance import Duel
from labeling_ui.page.panel_html import command_words
from labeling_ui.scene.clip_motion import MotionCache
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot
from policy.training.checkpoint import load_policy
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from rewardmodel.asking.clip_questions import ClipCfg, ask, with_known_answer
from rewardmodel.asking.visible import Visible, showing


def test_the_robot_that_does_not_fall_is_the_known_answer(tmp_path: Path) -> None:
    """Three of twelve robots fall, so there are three such pairs, and no more."""
    entries = walking_dataset(tmp_path / "set", pairs=0).entries()
    falls = {
        entry.sha256: entry.num_steps for entry in entries if entry.num_steps < 300
    }
    assert len(falls) == 3
    pairs = with_known_answer(
        entries,
        ClipCfg(),
        10,
        known=(),
        round_number=2,
        rng=np.random.default_rng(0),
    )
    assert len(pairs) == 3
    for pair in pairs:
        sides = {"a": pair.a, "b": pair.b}
        better = sides.pop(pair.gold or "")
        (worse,) = sides.values()
        assert better.rollout not in falls
        assert worse.stop == falls[worse.rollout]
        assert pair.round == 2


def test_people_are_asked_about_clips_that_they_can_tell_apart(tmp_path: Path) -> None:
    """Of five robots one takes more steps: four pairs show it, six do not."""
    dataset = Dataset.create(tmp_path / "set")
    dataset.add_episodes(
        walk(60, seed=index, step_hz=3.0 if index == 4 else 2.0) for index in range(5)
    )
    entries, visible = dataset.entries(), Visible(dataset)

    def asked(count: int, told_apart: Visible | None) -> list[Pair]:
        return ask(
            dataset,
            entries,
            ClipCfg(),
            count,
            known=(),
            model=None,
            round_number=0,
            uniform_share=1.0,
            told_apart=told_apart,
            rng=np.random.default_rng(0),
        )

    for count in (1, 2, 4):
        assert visible.share(asked(count, visible)) == 1.0
    everything = asked(10, visible)
    assert visible.share(everything[:4]) == 1.0
    assert visible.share(everything[4:]) == 0.0
    assert visible.told_of(everything) == (
        "4 of 10 pairs differ by what people notice, most often in steps (4)"
    )
    assert 0.0 < visible.share(asked(10, None)) < 1.0


def test_who_asked_for_finer_pairs_is_told_of_these(tmp_path: Path) -> None:
    """One robot takes a few more steps: two thirds of what people just notice."""
    dataset = Dataset.create(tmp_path / "set")
    entries = dataset.add_episodes(
        walk(60, seed=index, step_hz=2.3 if index == 2 else 2.0) for index in range(3)
    )
    clips = [Clip(entry.sha256, 0, 60) for entry in entries]
    fine, alike = (
        Pair.make(clips[0], other, strategy="uniform", round=0)
        for other in (clips[2], clips[1])
    )
    asked = Visible(dataset, 0.5)
    assert asked.told_of([fine, alike]) == (
        "1 of 2 pairs differ by 0.5 times what people notice, most often in steps (1)"
    )
    assert asked.share([fine, alike]) == 0.5
    # Who asks for any two is told of what is noticed.
    assert Visible(dataset, 0).told_of([fine]) == (
        "0 of 1 pairs differ by what people notice"
    )


def test_pairs_of_wanted_episodes_come_first(tmp_path: Path) -> None:
    """Those that show one of them and can be told apart; then others."""
    dataset = Dataset.create(tmp_path / "set")
    entries = dataset.add_episodes(
        walk(60, seed=index, step_hz=3.0 if index == 4 else 2.0) for index in range(5)
    )
    name, visible = entries[0].sha256, Visible(dataset)
    asked = ask(
        dataset,
        entries,
        ClipCfg(),
        2,
        known=(),
        model=None,
        round_number=0,
        uniform_share=1.0,
        told_apart=showing({name}, visible),
        rng=np.random.default_rng(0),
    )
    first, other = ({pair.a.rollout, pair.b.rollout} for pair in asked)
    assert first == {name, entries[4].sha256}
    assert other != first


def told_every_second(entry: int, *, steps: int, policy: str = "0" * 64) -> Episode:
    """A walk whose command changes every second; one that is not 300 steps falls."""
    walked = walk(steps, seed=entry, step_hz=1.5 + 0.1 * entry, fell=steps < 300)
    extra = {"command_change_steps": "50"}
    meta = replace(walked.meta, policy_sha256=policy, extra=extra)
    return replace(walked, meta=meta)


def test_of_a_manoeuvre_a_fall_is_known_beside_what_was_told_the_same(
    tmp_path: Path,
) -> None:
    """Whoever stands was told the same from the first step of the clip on."""
    dataset = Dataset.create(tmp_path / "set")
    lengths = (300, 300, 233, 190)
    entries = dataset.add_episodes(
        told_every_second(index, steps=steps) for index, steps in enumerate(lengths)
    )
    pairs = with_known_answer(
        entries,
        ClipCfg.of(3.0),
        10,
        known=(),
        round_number=0,
        rng=np.random.default_rng(0),
    )
    assert len(pairs) == 2
    assert {pair.a.start - pair.b.start for pair in pairs} == {0}


def test_of_a_manoeuvre_policies_are_compared_where_they_were_told_the_same(
    manoeuvres: Dataset, tmp_path: Path
) -> None:
    """What the new one does later has nothing beside it: the old one has fallen."""
    new, old = map(load_policy, two_policies(manoeuvres, tmp_path))
    names = (new.sha256, old.sha256)
    dataset = Dataset.create(tmp_path / "set")
    entries = dataset.add_episodes(
        told_every_second(index, steps=steps, policy=names[index])
        for index, steps in enumerate((300, 140))
    )
    round = Round(tmp_path / "run", 1)
    round.root.mkdir(parents=True)
    round.shown.write_text(json.dumps([entry.sha256 for entry in entries]))
    cfg = replace(resolve(Loop(run=Path("r"))), clips=ClipCfg.of(3.0))
    pairs = pairs_of_both(cfg, round, dataset, new.sha256, old.sha256)
    assert pairs
    assert {pair.a.start - pair.b.start for pair in pairs} == {0}


def test_beside_people_a_program_has_no_say_about_policies(tmp_path: Path) -> None:
    """It is never counted as a person; where nobody else answered, it is heard."""
    dataset = Dataset.create(tmp_path / "set")
    first, second = dataset.add_episodes(
        told_every_second(index, steps=200, policy=name * 64)
        for index, name in enumerate("ef")
    )
    sides = Clip(first.sha256, 0, 100), Clip(second.sha256, 0, 100)
    later = Clip(first.sha256, 50, 100), Clip(second.sha256, 50, 100)
    round = Round(tmp_path / "run", 1)
    pairs = [Pair.make(*both, strategy=APPROVAL, round=1) for both in (sides, later)]
    with dataset.answers() as store:
        store.add_pairs(pairs)
        store.add_rater("program:x", "model")
        for pair in pairs:
            store.add_answer(answer(pair, "program:x", "b"))
        assert duel_of(round, dataset, "f" * 64, "e" * 64) == Duel(for_new=2, for_old=0)
        store.add_rater("ann", "human")
        store.add_answer(answer(pairs[0], "ann", "a"))
    assert duel_of(round, dataset, "f" * 64, "e" * 64) == Duel(for_new=0, for_old=1)


def answer(pair: Pair, rater: str, choice: Choice) -> Answer:
    return Answer(
        answer_id=f"{rater} {pair.pair_id}",
        pair_id=pair.pair_id,
        rater_id=rater,
        choice=choice,
        shown_left="a",
        created_utc="2030-01-31T12:00:00Z",
    )


def two_policies(dataset: Dataset, folder: Path) -> tuple[Path, Path]:
    """Files of the policy that recorded `dataset`, and of one that leans on a hip."""
    first = dataset.root.parent / "p" / "policy.pt"
    payload = torch.load(first, weights_only=True)
    payload["actor_state_dict"]["mlp.2.bias"][0] = 0.1
    torch.save(payload, folder / "other.pt")
    return first, folder / "other.pt"


def could_be_moved(clip: Clip, feet: np.ndarray) -> bool:
    """Whether the foot with contact `feet` [T] comes down less than half the 30 steps
    to the next clip away, and the episode goes on for as long as the clip."""
    down = [t for t in range(1, len(feet)) if (feet[t - 1], feet[t]) == (0.0, 1.0)]
    return any(abs(t - clip.start) < 15 and t + clip.steps <= len(feet) for t in down)


def test_robots_that_walk_begin_with_the_same_foot(tmp_path: Path) -> None:
    """Steps at 1.5 to 2.6 Hz: the front right foot comes down as a clip begins; where
    one falls or stands, or takes long steps and its foot comes down no nearer than half
    way to the next clip, both stay where they were cut. Nothing comes twice."""
    dataset = walking_dataset(tmp_path / "set", pairs=0)
    standing = walk(300, seed=99)
    features = standing.features.copy()
    features[:, column("foot_contact")] = 1.0
    dataset.add_episodes([replace(standing, features=features)])
    entries = {entry.sha256: entry for entry in dataset.entries()}
    known: list[Pair] = []
    aligned = 0
    for batch in range(6):
        pairs = ask(
            dataset,
            list(entries.values()),
            ClipCfg(),
            10,
            known=known,
            model=None,
            round_number=0,
            uniform_share=1.0,
            rng=np.random.default_rng(batch),
        )
        known += pairs
    for pair in known:
        clips = (pair.a, pair.b)
        ends = [clip.stop == entries[clip.rollout].num_steps for clip in clips]
        falls = [entries[clip.rollout].end_reason == "terminated" for clip in clips]
        contact = [
            dataset.features(clip.rollout)[:, column("foot_contact")][:, 0]
            for clip in clips
        ]
        stands = any(feet.all() for feet in contact)
        if stands or any(e and f for e, f in zip(ends, falls, strict=True)):
            assert any(clip.start % 30 == 0 for clip in clips)
            continue
        if min(clip.start for clip in clips) == 0:
            continue  # The first step of an episode may be no touchdown.
        if all(clip.start % 30 == 0 for clip in clips):
            assert not all(map(could_be_moved, clips, contact))
            continue
        for clip, feet in zip(clips, contact, strict=True):
            assert (feet[clip.start - 1], feet[clip.start]) == (0.0, 1.0)
        aligned += 1
    assert aligned > 25
    asked = {frozenset((pair.a, pair.b)) for pair in known}
    assert len(asked) == len(known) == 60


@pytest.fixture(scope="module")
def manoeuvres(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Episodes of 6 s that change their command every 2 s, of a robot that stands."""
    folder = tmp_path_factory.mktemp("manoeuvres")
    robot = load_robot(physics_dt_s=EnvCfg().physics_dt_s)
    ppo = PpoCfg(num_envs=8, hidden_sizes=(8,))
    cfg = TrainCfg(steps=192, env=EnvCfg(), ppo=ppo, exploration_std=0.05)
    policy = train(folder / "p", robot, cfg)
    payload = torch.load(policy.policy, weights_only=True)
    for name in ("mlp.2.weight", "mlp.2.bias"):
        payload["actor_state_dict"][name].zero_()
    torch.save(payload, policy.policy)
    record = ["record", "--policy", str(policy.policy), "--dataset", str(folder / "d")]
    sizes = ["--episodes", "20", "--episode-s", "6", "--change-s", "2"]
    assert main([*record, *sizes, "--varied", "0.5"]) == 0
    return Dataset.open(folder / "d")


def test_a_whole_manoeuvre_is_asked_about_and_learned_from(
    manoeuvres: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Clips of 5 s through all stages; both robots were told the same throughout."""
    there = ["--dataset", str(manoeuvres.root)]
    assert main(["pairs", *there, "--count", "12", "--clip-s", "5"]) == 0
    with manoeuvres.answers() as store:
        pairs = store.pairs()
    whole = [pair for pair in pairs if pair.a.steps == pair.b.steps == 250]
    assert len(whole) >= 6, "of the others, a robot falls"
    for pair in whole:
        rows = map(manoeuvres.clip_features, (pair.a, pair.b))
        left, right = (row[:, column("command")] for row in rows)
        assert np.array_equal(left, right)
        assert len(np.unique(left, axis=0)) == 3
    motions = MotionCache(manoeuvres).of_pair(whole[0])
    words = command_words(motions[0].commands)
    assert words.count(", then ") == 2
    assert words == command_words(motions[1].commands)
    assert main(["answer", *there, "--criterion", "task"]) == 0
    assert main(["fit", *there, "--out", str(tmp_path / "reward")]) == 0
    assert "12 answers" in capsys.readouterr().err


def test_clips_longer_than_any_episode_are_refused_by_name(
    manoeuvres: Dataset, capsys: pytest.CaptureFixture[str]
) -> None:
    there = ["--dataset", str(manoeuvres.root), "--count", "3"]
    assert main(["pairs", *there, "--clip-s", "8"]) == 2
    told = capsys.readouterr().err
    assert "holds a clip of 8 s, the longest lasts 6 s" in told
    assert "--episode-s" in told
    with pytest.raises(GaitprefError, match=r"--clip-s must lie in \(0, 60\], got 90"):
        ClipCfg.of(90.0)


@pytest.mark.parametrize(
    ("option", "told"),
    [
        (("--varied", "2"), "--varied must lie in [0, 1], got 2"),
        (("--change-s", "-1"), "--change-s must lie in (0, 600] seconds, got -1"),
        (("--episode-s", "inf"), "--episode-s must lie in (0, 600] seconds, got inf"),
    ],
)
def test_what_cannot_be_recorded_is_refused_before_anything_is_made(
    option: tuple[str, str],
    told: str,
    manoeuvres: Dataset,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    policy = manoeuvres.root.parent / "p" / "policy.pt"
    record = ["record", "--policy", str(policy), "--dataset", str(tmp_path / "d")]
    assert main([*record, *option]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize("seconds", ["0", "-1", "601"])
def test_a_loop_is_refused_what_cannot_be_recorded(
    seconds: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    assert main(["loop", "--run", str(run), "--change-s", seconds]) == 2
    told = f"--change-s must lie in (0, 600] seconds, got {seconds}"
    assert told in capsys.readouterr().err
    assert not run.exists()


def test_a_loop_records_episodes_that_hold_its_clips() -> None:
    cfg = resolve(Loop(run=Path("r"), clip_s=8.0, change_s=4.0))
    assert (cfg.clips.clip_s, cfg.clips.stride_s) == (8.0, 4.0)
    assert (cfg.record.episode_s, cfg.record.change_s) == (24.0, 4.0)
    assert resolve(Loop(run=Path("r"))).clips == ClipCfg()


def asked_of(lengths: tuple[int, ...], count: int, root: Path) -> list[Pair]:
    """Questions about walks of the same command of these lengths, in steps."""
    dataset = Dataset.create(root)
    walks = [
        walk(steps, seed=index, step_hz=1.5 + 0.1 * index)
        for index, steps in enumerate(lengths)
    ]
    entries = dataset.add_episodes(walks)
    rng = np.random.default_rng(0)
    how = {"model": None, "round_number": 0, "uniform_share": 0.0}
    return ask(
        dataset, entries, ClipCfg(), count, known=[], strategy="uniform", rng=rng, **how
    )


def test_stretches_of_one_long_episode_meet_and_never_overlap(tmp_path: Path) -> None:
    """A log of a robot may be one episode; no pair comes twice."""
    pairs = asked_of((1000,), 30, tmp_path / "one")
    assert len({frozenset((pair.a, pair.b)) for pair in pairs}) == 30
    for pair in pairs:
        first, second = sorted((pair.a, pair.b))
        assert first.rollout == second.rollout
        assert first.stop <= second.start


def test_few_episodes_meet_again_before_one_meets_itself(tmp_path: Path) -> None:
    """Two of 3 s give 25 pairs of clips, of which some show nearly the same."""
    pairs = asked_of((150, 150), 9, tmp_path / "two")
    apart = [pair.a.rollout != pair.b.rollout for pair in pairs]
    assert sum(apart) > 3
    assert apart == sorted(apart, reverse=True)


def test_an_episode_too_short_for_two_clips_is_said(tmp_path: Path) -> None:
    with pytest.raises(GaitprefError, match="lie apart"):
        asked_of((100,), 1, tmp_path / "short")
