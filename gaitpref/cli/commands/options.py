"""`gaitpref options`: one policy that chooses among gaits."""

from __future__ import annotations

from pathlib import Path

from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from data.files.files import write_atomically
from data.files.lock import only_writer
from gaitpref.cli.options import options
from gaitpref.console.progress import (
    console,
    counted,
    counting_bar,
    each_counted,
    working,
)
from gaitpref.console.terminal import EXIT_INTERRUPTED, complain
from gaitpref.options.choice_fit import fit_choices
from gaitpref.options.choice_rater import answer_choices, parse_wish, wisher_of
from gaitpref.options.choice_sets import Asked, about
from gaitpref.options.choice_storage import save_choices
from gaitpref.options.gait_files import Gaits, load_gaits, named_files
from gaitpref.options.measure import measured, table
from gaitpref.options.train_options import (
    LookStats,
    OptionsCfg,
    OptionsTraining,
    train_options,
)
from policy.env.course import CourseCfg, Obstacle, stands_on
from policy.options.choice_row import TASK, ChoiceReward, written_reward
from policy.options.choosing import ChoosingCfg
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import load_policy
from policy.training.training_dir import POLICY_NAME, RESUME_NAME
from rewardmodel.fitting.fit_reward import models_fitted
from rewardmodel.fitting.tables import TABLE_FIT

UNTAUGHT_NAME, DATASET_NAME = "untaught.pt", "dataset"
_LENGTHS_M = {"steps": 2.0, "bar": 0.4, "slope": 1.2}
_OPEN_M = 1.2
"""Open ground before every obstacle, and behind the last."""
_CLIPS, _CLIP_S = 32, 8.0
"""Episodes that a simulated rater is asked about."""


def run(command: options.Options) -> int:
    """Run the command; gives the exit code."""
    files = named_files(command.policy)
    if command.dataset is not None and command.wish is not None:
        raise GaitprefError(
            "--dataset and --wish are two raters: the answers of a data set, or a "
            "simulated rater; leave one out"
        )
    wish = None if command.wish is None else parse_wish(command.wish)
    _require_used(command)
    with working("loading the gaits"):
        gaits = load_gaits(files)
    cfg = _cfg(command)
    stands_on(gaits.robot, cfg.course)
    with only_writer(command.out, console.print):
        return _learn(command, gaits, cfg, wish)


def _learn(
    command: options.Options,
    gaits: Gaits,
    cfg: OptionsCfg,
    wish: dict[str, float] | None,
) -> int:
    """Find out what is paid, learn, and compare."""
    reward = _reward(command, gaits, cfg, wish)
    if not _train(command.out, gaits, cfg, reward):
        complain("stopped; the same command goes on")
        return EXIT_INTERRUPTED
    policy_file = command.out / POLICY_NAME
    env = load_policy(policy_file).info.env
    save_choices(about(reward, gaits.robot, env), command.out)
    with counted("comparing it with each gait alone, steps") as tell:
        rows = measured(policy_file, gaits, reward, tell=tell)
    console.print(table(rows, gaits.names))
    console.print(f"the policy is {policy_file}")
    console.next(
        f"`gaitpref film --policy {policy_file} --out course.gif` shows which gait "
        f"runs when, `gaitpref record --policy {policy_file} --dataset DIR` logs clips "
        "to be judged"
    )
    return 0


def _require_used(command: options.Options) -> None:
    """
    Raises:
        GaitprefError: an option is about what is not there, or the place is taken.
    """
    kinds = ("steps", "bar", "slope")
    of_kind = zip(("step_m", "bar_m", "slope_rad"), kinds, strict=True)
    unused = [
        (name, f"there is no {kind} on the course")
        for name, kind in of_kind
        if kind not in command.course
    ]
    if command.wish is None:
        unused.append(("answers", "--wish gives them"))
    if command.termination == "learned":
        unused.append(("length_s", "--termination learned says when a gait ends"))
    for name, why in unused:
        if getattr(command, name) != getattr(options.Options, name):
            raise GaitprefError(f"--{name.replace('_', '-')}: {why}; leave it out")
    most = _CLIPS * (_CLIPS - 1) // 2
    if command.answers > most:
        raise GaitprefError(
            f"--answers {command.answers}: {_CLIPS} clips make {most} pairs; ask for "
            "fewer"
        )
    taken = (command.out / POLICY_NAME).exists()
    if taken and not (command.out / RESUME_NAME).exists():
        raise GaitprefError(f"{command.out} holds another policy: give another --out")


def _cfg(command: options.Options) -> OptionsCfg:
    """What the command line says.

    Raises:
        GaitprefError: something is out of range.
    """
    if not 0.1 <= command.speed_m_s <= 2.0:
        raise GaitprefError(
            f"--speed-m-s must lie in [0.1, 2], got {command.speed_m_s:g}"
        )
    at, obstacles = _OPEN_M, []
    for kind in command.course:
        obstacles.append(Obstacle(kind=kind, start_m=at, length_m=_LENGTHS_M[kind]))
        at += _LENGTHS_M[kind] + _OPEN_M
    course = CourseCfg(
        obstacles=tuple(obstacles),
        length_m=at,
        step_m=command.step_m,
        bar_m=command.bar_m,
        slope_rad=command.slope_rad,
    )
    try:
        choosing = ChoosingCfg(
            termination=command.termination,
            length_s=command.length_s,
            interrupt_margin=command.interrupt,
        )
    except ValueError as error:
        raise GaitprefError(
            f"{error}: give another --length-s, or --interrupt"
        ) from None
    return OptionsCfg(
        course=course,
        choosing=choosing,
        speed_m_s=command.speed_m_s,
        # Time for everybody who does not stand before an obstacle.
        episode_s=round(1.6 * at / command.speed_m_s, 1),
        envs=command.envs,
        steps=command.steps,
        seed=command.seed,
    )


def _reward(
    command: options.Options,
    gaits: Gaits,
    cfg: OptionsCfg,
    wish: dict[str, float] | None,
) -> ChoiceReward:
    """What is paid: what answers say, or metres less energy and changes."""
    place, rater_id = command.dataset, None
    if wish is not None:
        # A name that is wrong is told before anything is recorded.
        written_reward(wish, gaits.names, "wish")
        place = command.out / DATASET_NAME
        rater_id = wisher_of(wish)
        _ask_wish(command, gaits, cfg, wish, place)
    if place is None:
        return written_reward(TASK, gaits.names, "metres, energy and changes")
    dataset = Dataset.open(place)
    told = "fitting the reward to the answers, models"
    with counting_bar(told, models_fitted(TABLE_FIT)) as bar:
        reward, report = fit_choices(
            dataset,
            gaits.names,
            seed=command.seed,
            rater_id=rater_id,
            advance=lambda: bar.advance(bar.task_ids[0]),
            asked=Asked(gaits.robot, gaits.env.control_dt_s, cfg.course),
        )
    held_out = report.held_out_accuracy
    foreseen = "" if held_out is None else f"; foresees {held_out:.0%} of unseen ones"
    console.print(f"fitted to {reward.told}{foreseen}")
    return reward


def _ask_wish(
    command: options.Options,
    gaits: Gaits,
    cfg: OptionsCfg,
    wish: dict[str, float],
    place: Path,
) -> None:
    """Record clips of gaits that change at random, and answer about them."""
    untaught = command.out / UNTAUGHT_NAME
    task = written_reward(TASK, gaits.names, "nothing")
    content = OptionsTraining(gaits, cfg, task).policy()
    dataset = Dataset.create(place)
    if dataset.entries():
        if not untaught.exists() or untaught.read_bytes() != content:
            raise GaitprefError(
                f"{place} shows other gaits, another course, speed or seed: give the "
                "same, or another --out"
            )
    else:
        write_atomically(untaught, content)
        shown = RecordCfg(episodes=_CLIPS, episode_s=_CLIP_S, noisy_share=1.0)
        policies = [load_policy(untaught)]
        recorded = record(untaught, shown, seed=command.seed, policies=policies)
        with each_counted("recording", recorded, _CLIPS) as episodes:
            dataset.add_episodes(episodes)
    answer_choices(dataset, gaits.names, wish, count=command.answers, seed=command.seed)


def _train(out: Path, gaits: Gaits, cfg: OptionsCfg, reward: ChoiceReward) -> bool:
    with counted("learning to choose") as tell:

        def look(stats: LookStats) -> None:
            tell(min(stats.steps, cfg.steps), cfg.steps)

        return train_options(out, gaits, cfg, reward, tell=look)
