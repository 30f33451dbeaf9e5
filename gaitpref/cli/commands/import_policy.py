"""`gaitpref policy import`: a policy that others trained, as one of ours."""

from __future__ import annotations

from gaitpref.cli.options import options
from gaitpref.console.progress import console, counted
from gaitpref.console.terminal import say
from policy.env.env_cfg import EnvCfg
from policy.imported.alternatives import tried
from policy.imported.bring import bring, understand
from policy.imported.meaning.law_toml import law_toml
from policy.imported.whose_robot import given, robot_of
from policy.law.law import LawError
from policy.law.origin import table
from policy.robots.robot import load_robot
from policy.training.training_dir import POLICY_NAME


def run(command: options.Policy) -> int:
    """Import the policy; gives the exit code."""
    xml = given(command.robot)
    known = understand(
        command.file,
        law=command.law,
        preset=command.preset,
        explain=command.explain,
        robot=load_robot(xml, physics_dt_s=EnvCfg().physics_dt_s),
    )
    if command.explain:
        say(law_toml(known.draft))
        return 0
    if command.out is None:
        raise LawError("give --out DIR, which gets policy.pt; or --explain to look")
    if (command.out / POLICY_NAME).exists():
        raise LawError(f"{command.out} holds a policy already: give another --out")
    robot = robot_of(known, command.robot)
    # Who cannot write there learns it before the minute that the trial takes.
    command.out.mkdir(parents=True, exist_ok=True)
    with counted("trying the policy on the robot, steps") as tell:
        policy = bring(known, robot.xml, command.out, tell)
    origin = policy.info.origin
    assert origin is not None
    say(f"{known.file.name} is {origin.kind}; what it means says {origin.meaning}")
    say(f"the robot is {robot.because}\n")
    say(table(origin.acceptance))
    say(f"it is {origin.verdict}\n")
    for name, why in origin.guessed.items():
        say(f"guessed    {name}: {why}")
    with counted("trying it otherwise") as tell:
        others = list(tried(known, robot.xml, tell))
    for line in others:
        say(f"tried      {line}")
    if not origin.accepted:
        say(
            "What it does not do as asked it cannot, or something of its law is wrong: "
            "--explain prints the law as a TOML to correct, which --law takes"
        )
    file = command.out / POLICY_NAME
    say(f"the policy is {file}")
    console.next(
        f"`gaitpref play --policy {file} --open` shows it, `gaitpref loop --run RUN "
        f"--base {file}` makes it better (with --rater human --no-auth by your answers)"
    )
    return 0
