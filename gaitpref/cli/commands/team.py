"""`gaitpref team`: two robots that share a reward, from training to who earned it."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import torch

from data.datasets.dataset import Dataset
from data.datasets.manifest_file import writable
from data.errors import GaitprefError
from data.files.files import require_directory, write_atomically
from data.files.lock import only_writer
from gaitpref.cli.options import team_options as options
from gaitpref.cli.shared.next_of_answers import next_fit, next_pairs
from gaitpref.cli.shared.shares_told import tell_shares
from gaitpref.cli.shared.training_command import refuse_trained, told_stopped
from gaitpref.console.progress import (
    console,
    counted,
    counting_bar,
    each_counted,
    training_bar,
)
from gaitpref.raters.criterion_scores import criterion_context
from gaitpref.raters.rater_cfg import RaterCfg
from gaitpref.raters.simulated import answer_pairs
from gaitpref.report.fit_summary import fit_summary
from gaitpref.team.team_credit import Credit, credit_of
from gaitpref.team.team_criteria import team_criterion
from gaitpref.team.team_pay import CriterionPay, SharedPay
from gaitpref.team.team_sets import (
    context_of_teams,
    first_team,
    require_alike,
    require_kind,
    require_recorded,
    robot_of_teams,
    standing_of,
)
from gaitpref.training.total_reward import total_reward
from policy.env.known_terms import KnownTermsCfg
from policy.env.team_cfg import TeamCfg
from policy.robots.robot import Robot
from policy.robots.shipped import WALK
from policy.rollouts.record_cfg import LONGEST_S
from policy.team.pair_model import pair_of
from policy.team.team_env import team_runner
from policy.team.team_record import LAZY, TeamRecordCfg, record_team
from policy.team.team_start import as_team
from policy.training.checkpoint import Policy, PolicyError, PolicyInfo, load_policy
from policy.training.ppo import PpoCfg, ScoreFn
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from rewardmodel.answers.answered_pairs import load_pairs
from rewardmodel.cfg import FitCfg
from rewardmodel.fitting.fit_reward import models_fitted
from rewardmodel.team.team_fit import fit_team, rows_in
from rewardmodel.team.team_reward import TeamReward, Walkers
from rewardmodel.team.team_storage import TEAM_FILES, load_team, save_team

_START_STD, _END_STD = 0.3, 0.15
"""Exploration noise: a walk that is there is changed, not found."""
_START_NAME = "start.pt"


def run(command: options.Team) -> int:
    """Run one `gaitpref team` command; gives the exit code."""
    match action := command.action:
        case options.TeamTrain():
            with only_writer(action.out, console.print):
                return _train(action)
        case options.TeamRecord():
            _record(action)
        case options.TeamAnswer():
            _answer(action)
        case options.TeamFit():
            with only_writer(action.out, console.print, replaced=True):
                _fit(action)
        case options.TeamShares():
            _shares(action)
    return 0


def _train(command: options.TeamTrain) -> int:
    if not command.resume:
        refuse_trained(command.out)
    _require_possible(command)
    start = _start(command)
    policy = load_policy(start)
    info, robot = policy.info, policy.robot()
    cfg = TrainCfg(
        steps=command.steps,
        env=info.env,
        ppo=PpoCfg(
            hidden_sizes=info.ppo.hidden_sizes,
            num_envs=command.robots,
            policies=info.ppo.policies,
        ),
        seed=command.seed,
        checkpoints=command.checkpoints,
        exploration_std=_START_STD,
        final_std=_END_STD,
    )
    reward_fn = _paid(command, robot, info)
    with training_bar("training", command.steps) as bar:
        result = train(
            command.out,
            robot,
            cfg,
            reward_fn=reward_fn,
            reward_name=f"team {command.reward}",
            init=start,
            resume=command.resume,
            on_iteration=bar,
            engine=team_runner,
        )
    if not result.finished:
        return told_stopped(result.steps)
    console.print(f"the policy is {result.policy}")
    console.next(
        f"`gaitpref team record --policy {result.policy} --dataset DIR --lazy 0.5` "
        "records what people can judge"
    )
    return 0


def _require_possible(command: options.TeamTrain) -> None:
    """
    Raises:
        GaitprefError: options that do not go together, before anything is written.
    """
    learned = Path(command.reward).is_dir()
    if learned:
        _require_fitted(load_team(Path(command.reward)), command.init or WALK)
    if command.pay != options.TeamTrain.pay and not learned:
        raise GaitprefError(
            f"--pay {command.pay} is of a learned reward, whose shares are known, and "
            f"--reward {command.reward} pays both alike: give the directory of "
            "`gaitpref team fit`, or leave it out"
        )
    if command.weight != options.TeamTrain.weight and command.reward == "task":
        raise GaitprefError(
            f"--weight {command.weight:g} is of a reward beside the task: give another "
            "--reward, or leave it out"
        )
    if command.robots % 2:
        raise GaitprefError(
            f"--robots {command.robots}: two walk in every world; give an even number"
        )


def _require_fitted(model: TeamReward, init: Path) -> None:
    """
    Raises:
        GaitprefError: the reward is of other robots than those that would be trained.
    """
    model.require(_walkers_of(load_policy(init)), str(init))


def _walkers_of(policy: Policy) -> Walkers:
    both, _ = pair_of(policy.robot())
    return Walkers(both.name, both.model_sha256, policy.info.env.control_dt_s)


def _start(command: options.TeamTrain) -> Path:
    """The policy of a team that a training begins from.

    Raises:
        PolicyError: it cannot be used, or holds two where one is asked for.
    """
    init, out = command.init or WALK, command.out
    info = load_policy(init).info
    has_two = info.ppo.policies is not None
    if has_two and command.policies == 1:
        raise PolicyError(
            f"{init} holds a policy for each robot, and nobody can tell which of them "
            "both should share: give --policies 2, or an --init that is shared"
        )
    if info.env.team is not None and has_two == (command.policies == 2):
        return init
    start = out / _START_NAME
    content = as_team(init, TeamCfg(), policies=command.policies)
    with writable(out):
        out.mkdir(parents=True, exist_ok=True)
        write_atomically(start, content)
    return start


def _paid(command: options.TeamTrain, robot: Robot, info: PolicyInfo) -> ScoreFn | None:
    """What is paid; None is the environment's own."""
    if command.reward == "task":
        return None
    score: ScoreFn
    if Path(command.reward).is_dir():
        score = SharedPay(
            load_team(Path(command.reward)),
            command.pay,
            standing_of(robot),
            info.env.control_dt_s,
        )
    else:
        context = criterion_context(robot, info.env)
        score = CriterionPay(team_criterion(command.reward, context))
    return total_reward(
        score,
        robot,
        info.env,
        known=KnownTermsCfg(),
        weight=command.weight,
        keep_task=True,
    )


def _record(command: options.TeamRecord) -> None:
    if not 0.0 <= command.lazy <= 1.0:
        raise GaitprefError(f"--lazy must lie in [0, 1], got {command.lazy:g}")
    if not 0.0 < command.episode_s <= LONGEST_S:
        raise GaitprefError(
            f"--episode-s must lie in (0, {LONGEST_S:g}] seconds, got "
            f"{command.episode_s:g}"
        )
    if command.lazy_robot is not None and not command.lazy:
        raise GaitprefError("--lazy-robot needs --lazy, the share in which it is lazy")
    policy = load_policy(command.policy)
    cfg = TeamRecordCfg(
        episodes=command.episodes,
        episode_s=command.episode_s,
        lazy_share=command.lazy,
        lazy_robot=command.lazy_robot,
    )
    dataset = Dataset.create(command.dataset)
    require_kind(dataset, team=True)
    if dataset.entries():
        require_recorded(dataset, _walkers_of(policy))
    with counted(f"recording {cfg.episodes} episodes, steps") as tell:
        recorded = list(
            record_team(policy, cfg, seed=command.seed, round=command.round, tell=tell)
        )
    with each_counted("writing episodes", recorded, len(recorded)) as episodes:
        entries = dataset.add_episodes(episodes)
    falls = sum(entry.end_reason == "terminated" for entry in entries)
    console.print(
        f"{len(entries)} episodes of teams are in {command.dataset}; {falls} of them "
        "end in a fall"
    )
    console.next(next_pairs(dataset, 60))


def _answer(command: options.TeamAnswer) -> None:
    if not 0.0 <= command.mistakes <= 1.0:
        raise GaitprefError(f"--mistakes must lie in [0, 1], got {command.mistakes:g}")
    dataset = Dataset.open(command.dataset)
    robot, control_dt_s = robot_of_teams(dataset)
    criterion = team_criterion(command.criterion, context_of_teams(robot, control_dt_s))
    with counted("answering") as tell:
        count = answer_pairs(
            dataset,
            criterion,
            rater_id=f"simulated:{command.criterion}",
            seed=command.seed,
            cfg=RaterCfg(mistakes=command.mistakes),
            features_of=rows_in([dataset]),
            tell=tell,
        )
    console.print(
        f"{count} pairs of {command.dataset} were answered by {command.criterion}"
    )
    console.next(next_fit(dataset))


def _fit(command: options.TeamFit) -> None:
    require_directory(command.out, TEAM_FILES)
    datasets = [Dataset.open(path) for path in command.dataset]
    require_alike(datasets)
    pairs = load_pairs(datasets)
    told = f"fitting a reward of teams to {len(pairs)} answers, models"
    with counting_bar(told, models_fitted(FitCfg())) as bar:
        model = fit_team(
            pairs,
            rows_in(datasets),
            seed=command.seed,
            walkers=Walkers.of(first_team(datasets[0]).meta),
            advance=lambda: bar.advance(bar.task_ids[0]),
        )
    with writable(command.out.resolve().parent):
        save_team(model, command.out)
    if command.json:
        print(json.dumps(asdict(model.report) | {"largest": _largest(model)}))
        return
    console.print(f"team: {fit_summary(model.report)}; the reward is {command.out}")
    liked = ", ".join(f"{name} {weight:+.2f}" for name, weight in _largest(model))
    console.print(f"most of all it looks at {liked}")
    console.next(
        f"`gaitpref team shares --reward {command.out} --dataset {command.dataset[0]}` "
        "says who earns it"
    )


def _largest(model: TeamReward) -> list[tuple[str, float]]:
    """Habits with the largest weights, and these: what one deviation more is worth."""
    own, pair = model.agreed
    weights = [*own.tolist(), *pair.tolist()]
    named = [
        (name, round(weight, 3))
        for name, weight in zip(model.names, weights, strict=True)
    ]
    return sorted(named, key=lambda item: -abs(item[1]))[:5]


def _shares(command: options.TeamShares) -> None:
    model = load_team(command.reward)
    dataset = Dataset.open(command.dataset)
    model.require(Walkers.of(first_team(dataset).meta), str(dataset.root))
    robot, control_dt_s = robot_of_teams(dataset)
    entries = [
        entry
        for entry in dataset.entries()
        if command.round in (None, entry.meta.round) and entry.end_reason != "aborted"
    ]
    if not entries:
        raise GaitprefError(f"{command.dataset} has no episode of that --round")
    rows, standing = rows_in([dataset]), standing_of(robot)
    credits: list[Credit] = []
    with counted("sharing out") as tell:
        for done, entry in enumerate(entries):
            tell(done, len(entries))
            found = torch.from_numpy(rows(entry.sha256))
            credits.append(credit_of(model, found, standing, control_dt_s=control_dt_s))
    who = {"1": 1, "2": 2}
    lazy = [who.get(entry.meta.extra.get(LAZY, ""), 0) for entry in entries]
    tell_shares(command, credits, lazy)
