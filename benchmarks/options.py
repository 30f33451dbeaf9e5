"""What choosing among gaits wins: over the best of them alone, and over a rule.

    python -m benchmarks.options --policy walk=FILE --policy high=FILE ... \
        [--quick] [--seeds 3] [--results DIR] [--json FILE]

One row, a file each, for every way to end a gait and every seed; what is there is not
done again. All are measured from the line, on the same starts, under the same reward:
metres, less energy and changes. A crouch is made of the first gait where none is given:
its knees are bent, which no training is needed for.

Then the same answers of a rater with another wish teach both which gait to run and how
the best of them moves (`options_answers.py`): what each answer wins at either level.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import product
from pathlib import Path
from statistics import mean
from typing import Annotated

import torch
import tyro
from torch import Tensor

from data.files.files import write_atomically
from gaitpref.options.gait_files import Gaits, course_env, load_gaits, named_files
from gaitpref.options.measure import (
    Chosen,
    Measured,
    alone,
    chosen_by,
    measure,
)
from gaitpref.options.train_options import OptionsCfg, train_options
from policy.env.course import AHEAD_DIM, KINDS, CourseCfg, Obstacle
from policy.env.feature_row import OBS_DIM
from policy.options.choice_row import NEAR_M, TASK, ChoiceReward, written_reward
from policy.options.choosing import ChoosingCfg
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import read_plain, saved_bytes

from .harness import Figure, publish
from .options_answers import (
    LEVELS,
    WISH,
    Asked,
    answer_and_fit,
    trained_at_joints,
    trained_on_choices,
)

WAYS = {
    "learned": ChoosingCfg(termination="learned"),
    "fixed_0.4s": ChoosingCfg(termination="fixed", length_s=0.4),
    "fixed_1s": ChoosingCfg(termination="fixed", length_s=1.0),
    "fixed_2s": ChoosingCfg(termination="fixed", length_s=2.0),
    "fixed_2s_cut": ChoosingCfg(
        termination="fixed", length_s=2.0, interrupt_margin=0.05
    ),
}
"""When a gait ends."""
GOALS = {"learned_over_best_alone": "> 0", "learned_over_rule": ">= 0"}
BENT_RAD = 0.14
"""Of the thighs of a crouch, and twice of the knees."""
_STARTS_SEED = 7000


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure what choosing among gaits wins."""

    policy: tyro.conf.UseAppendAction[tuple[str, ...]]
    """NAME=FILE of a gait; `high` is one that climbs, `crouch` one that passes bars."""
    quick: bool = False
    """One seed, one way, a bar after 0.7 m, few steps, and no answers."""
    steps: int = 150_000
    """Environment steps of a training."""
    envs: int = 64
    """Robots side by side."""
    seeds: int = 3
    """Trainings of every way."""
    episodes: int = 32
    """Episodes that measure."""
    episode_s: float = 20.0
    """Time after which an episode is cut."""
    ways: tuple[str, ...] = tuple(WAYS)
    """Which of them."""
    answers: tuple[int, ...] = (20, 60)
    """Of so many the gain per answer is measured; they must rise."""
    joint_steps: int = 600_000
    """Environment steps of a training at the level of joints, which has more to
    learn."""
    clips: tyro.conf.Suppress[RecordCfg] = field(
        default_factory=lambda: RecordCfg(episodes=32, episode_s=8.0, noisy_share=1.0)
    )
    """What is judged: gaits that change at random."""
    course: tyro.conf.Suppress[CourseCfg] = field(default_factory=CourseCfg)
    """What is walked along."""
    results: Path = Path("docs/results/options")
    """Directory of the finished rows."""
    work: Path = Path("runs/benchmark-options")
    """Directory of the trainings."""
    json: Path | None = None
    """Write the figures here."""


def _quick(options: Options) -> Options:
    """So small that it says only whether all of it runs."""
    bar = Obstacle(kind="bar", start_m=0.7, length_m=0.3)
    return replace(
        options,
        steps=160,
        envs=8,
        seeds=1,
        episodes=4,
        episode_s=1.0,
        ways=("fixed_1s",),
        answers=(),
        course=CourseCfg(obstacles=(bar,), length_m=1.6),
    )


def bent(file: Path, out: Path) -> Path:
    """The policy of `file` with bent knees: its last layer asks for other angles."""
    payload = read_plain(file)
    scale = json.loads(payload["infos"]["gaitpref"])["env"]["action_scale_rad"]
    actor = payload["actor_state_dict"]
    biases = [n for n in actor if n.startswith("mlp.") and n.endswith("bias")]
    shift = torch.tensor([0.0, BENT_RAD, -2 * BENT_RAD] * 4)
    actor[biases[-1]] = actor[biases[-1]] + shift / scale
    write_atomically(out, saved_bytes(payload))
    return out


def rule_of(names: Sequence[str]) -> Callable[[Tensor], Tensor]:
    """The gait [N] somebody would write down for what is ahead [N, 6]: `high` on steps,
    `crouch` below a bar, else the first."""
    for_kind = {"steps": "high", "bar": "crouch"}

    def rule(ahead: Tensor) -> Tensor:
        gait = torch.zeros(len(ahead), dtype=torch.long)
        near = ahead[:, len(KINDS)] <= NEAR_M
        for column, kind in enumerate(KINDS):
            name = for_kind.get(kind)
            if name in names:
                at = near & (ahead[:, column] > 0)
                gait[at] = names.index(name)
        return gait

    return rule


def by_rule(gaits: Gaits, rule: Callable[[Tensor], Tensor]) -> Chosen:
    """The gait [N] that `rule` gives of what is ahead [N, 6]."""

    def act(obs: Tensor) -> tuple[Tensor, Tensor]:
        gait = rule(obs[:, OBS_DIM : OBS_DIM + AHEAD_DIM])
        actions = torch.stack([p(obs[:, :OBS_DIM]) for p in gaits.policies])
        return actions[gait, torch.arange(len(obs))], gait

    return act


def rows_without_learning(
    gaits: Gaits, options: Options, reward: ChoiceReward
) -> list[Measured]:
    """Each gait alone, and the rule."""
    cfg = OptionsCfg(course=options.course, episode_s=options.episode_s)
    env = course_env(
        gaits, options.course, speed_m_s=cfg.speed_m_s, episode_s=cfg.episode_s
    )
    ways = [(f"{name} alone", alone(gaits, i)) for i, name in enumerate(gaits.names)]
    ways.append(("rule", by_rule(gaits, rule_of(gaits.names))))
    return [
        _once(
            options.results / f"{name.replace(' ', '-')}.json",
            lambda name=name, act=act: measure(
                name,
                act,
                gaits,
                env,
                reward,
                episodes=options.episodes,
                seed=_STARTS_SEED,
            ),
        )
        for name, act in ways
    ]


def row_of_learning(
    way: str, seed: int, gaits: Gaits, options: Options, reward: ChoiceReward
) -> Measured:
    """Train, or go on, and measure."""
    cfg = OptionsCfg(
        course=options.course,
        episode_s=options.episode_s,
        choosing=WAYS[way],
        envs=options.envs,
        steps=options.steps,
        seed=seed,
    )
    out = options.work / f"{way}-{seed}"

    def row() -> Measured:
        if not train_options(out, gaits, cfg, reward):
            raise KeyboardInterrupt
        env = course_env(
            gaits, cfg.course, speed_m_s=cfg.speed_m_s, episode_s=cfg.episode_s
        )
        act = chosen_by(out / "policy.pt")
        return measure(
            way,
            act,
            gaits,
            env,
            reward,
            episodes=options.episodes,
            seed=_STARTS_SEED,
        )

    return _once(options.results / f"{way}-seed{seed}.json", row)


def _once(path: Path, row: Callable[[], Measured]) -> Measured:
    """The row in `path`, made where it is not there."""
    if path.exists():
        values = json.loads(path.read_text())
        return Measured(**{**values, "shares": tuple(values["shares"])})
    found = row()
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, (json.dumps(asdict(found), indent=1) + "\n").encode())
    return found


def main(options: Annotated[Options, tyro.conf.FlagCreatePairsOff]) -> None:
    """Measure everything and publish it."""
    torch.set_num_threads(1)
    if options.quick:
        options = _quick(options)
    files = _files(options)
    gaits = load_gaits(files)
    reward = written_reward(TASK, gaits.names, "metres, energy and changes")
    plain = rows_without_learning(gaits, options, reward)
    rule, best = plain[-1], max(plain[:-1], key=lambda row: row.reward)
    figures: dict[str, Figure] = {
        "best_alone": best.name,
        "best_alone_reward": best.reward,
        "rule_reward": rule.reward,
    }
    for way in options.ways:
        rows = [
            row_of_learning(way, seed, gaits, options, reward)
            for seed in range(options.seeds)
        ]
        rewards = [row.reward for row in rows]
        figures |= {
            f"{way}_reward": mean(rewards),
            f"{way}_worst": min(rewards),
            f"{way}_changes": mean(row.changes for row in rows),
            f"{way}_falls": sum(row.falls for row in rows),
            f"{way}_over_best_alone": mean(rewards) - best.reward,
            f"{way}_over_rule": mean(rewards) - rule.reward,
        }
    figures |= gain_per_answer(gaits, files, options)
    publish("options", figures, GOALS, options.json)


def gain_per_answer(
    gaits: Gaits, files: dict[str, Path], options: Options
) -> dict[str, Figure]:
    """What an answer wins over the best gait alone, at the level of choices and at that
    of joints, by the wish itself."""
    if not options.answers:
        return {}
    wish = written_reward(WISH, gaits.names, "wish")
    cfg = OptionsCfg(
        course=options.course,
        episode_s=options.episode_s,
        envs=options.envs,
        steps=options.steps,
    )
    env = course_env(
        gaits, cfg.course, speed_m_s=cfg.speed_m_s, episode_s=cfg.episode_s
    )

    def row(name: str, way: Callable[[], Chosen]) -> Measured:
        return _once(
            options.results / f"wish-{name}.json",
            lambda: measure(
                name,
                way(),
                gaits,
                env,
                wish,
                episodes=options.episodes,
                seed=_STARTS_SEED,
            ),
        )

    plain = [
        row(f"{name}-alone", partial(alone, gaits, index)).reward
        for index, name in enumerate(gaits.names)
    ]
    best = max(range(len(plain)), key=plain.__getitem__)
    figures: dict[str, Figure] = {
        "wish_best_alone": gaits.names[best],
        "wish_best_alone_reward": plain[best],
    }
    found: dict[tuple[str, int], list[float]] = {}
    for seed, count in product(range(options.seeds), options.answers):
        asked = Asked(
            work=options.work / f"wish-{seed}",
            gaits=gaits,
            files=tuple(files.values()),
            cfg=replace(cfg, seed=seed),
            clips=options.clips,
            joint_steps=options.joint_steps,
        )
        answer_and_fit(asked, count)
        ways = (
            partial(trained_on_choices, asked, count),
            partial(trained_at_joints, asked, count, best),
        )
        for level, way in zip(LEVELS, ways, strict=True):
            done = row(f"{level}-{count}-seed{seed}", way)
            found.setdefault((level, count), []).append(done.reward - plain[best])
    for (level, count), gains in found.items():
        figures[f"{level}_{count}_gain"] = mean(gains)
        figures[f"{level}_{count}_gain_worst"] = min(gains)
        figures[f"{level}_{count}_gain_per_answer"] = mean(gains) / count
    return figures


def _files(options: Options) -> dict[str, Path]:
    """The gaits that were given, and a crouch."""
    texts = options.policy
    if not any(text.startswith("crouch=") for text in texts):
        options.work.mkdir(parents=True, exist_ok=True)
        first = Path(texts[0].partition("=")[2])
        texts = (*texts, f"crouch={bent(first, options.work / 'crouch.pt')}")
    return named_files(texts)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
