"""`gaitpref evaluate`: what a policy earns, and how it follows commands."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

from gaitpref.cli.options import options
from gaitpref.console.progress import console, counted
from gaitpref.raters.criterion_scores import criterion_context
from gaitpref.report.return_text import return_text
from gaitpref.training.total_reward import load_score
from policy.rollouts.evaluate import rollout_features, summarise
from policy.rollouts.walking import table, walking
from policy.training.checkpoint import load_policy


def run(command: options.Evaluate) -> int:
    """Run the command; gives the exit code."""
    policy = load_policy(command.policy)
    robot, env = policy.robot(), policy.info.env
    if command.terrain is not None:
        env = replace(env, terrain=replace(env.terrain, kind=command.terrain))
    score = load_score(command.reward, criterion_context(robot, env))
    with counted("evaluating, steps") as tell:
        features, lengths = rollout_features(
            policy,
            robot,
            env,
            episodes=command.episodes,
            seed=command.seed,
            tell=tell,
        )
    result = summarise(features, lengths, score, control_dt_s=env.control_dt_s)
    with counted("setting off from rest, steps") as tell:
        walked = walking(
            policy, robot, env, features, lengths, seed=command.seed, tell=tell
        )
    if command.json:
        told = asdict(result) | asdict(walked) | {"walks": walked.walks}
        print(json.dumps(told))
        return 0
    earned = return_text(result.return_mean, result.return_ci95)
    print(f"return          {earned} under {command.reward}")
    print(f"tracking error  {result.tracking_error_m_s:.3f} m/s")
    print(f"falls           {result.falls} ({result.falls_per_minute:.2f} a minute)")
    print(
        f"episode         {result.episode_length_s:.1f} s, {result.episodes} episodes"
    )
    print(f"power           {result.power_w:.0f} W")
    if walked.commands:
        verdict = "yes" if walked.walks else "NO"
        print(f"walks           {verdict}, for each command and from rest")
        print(f"\n{table(walked)}")
    console.next(f"`gaitpref play --policy {command.policy} --open` shows it")
    return 0
