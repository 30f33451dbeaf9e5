"""Every command as somebody would type it in a small world, for those who break things.

`python -m tests.helpers.command_table DIRECTORY` makes the world: a policy, a data set
with answers, a reward, an archive, a bag and what else commands read.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

from data.features import JOINTS
from gaitpref.cli.main import main
from gaitpref.loop.run_config import claim
from gaitpref.loop.run_inputs import inputs_of
from policy.env.env_cfg import EnvCfg
from policy.env.team_cfg import TeamCfg
from policy.robots.robot import load_robot
from policy.robots.shipped import WALK
from policy.team.team_start import as_team
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.log_tables import write_tables
from tests.helpers.ros2_bag import Motion, write_bag
from tests.helpers.small_loop import small_cfg
from tests.helpers.small_sweep import small_plan

_INPUTS = {
    "policy": "train/policy.pt",
    "shipped": "shipped.pt",
    "dataset": "set",
    "reward": "reward",
    "archive": "set.zip",
    "bag": "walk.mcap",
    "map": "map.toml",
    "columns": "columns.toml",
    "csv": "walk.csv",
    "lerobot": "lerobot",
    "minari": "minari",
    "xml": "go1.xml",
    "run": "run",
    "guidelines": "guidelines.md",
    "episode": "cut.mcap",
    "queries": "queries",
    "plan": "plan.yaml",
    "theirs": "theirs/policy.onnx",
    "place": "place",
    "team": "team.pt",
    "teams": "teams",
    "shared": "team-reward",
}
_FIRST = "first.txt"
"""Holds the hash of an episode."""
_PARTS = {
    "dataset": ("set/manifest.json", "set/preferences.sqlite", "set/raters.json"),
    "reward": ("reward/reward.json", "reward/reward.safetensors"),
    "teams": ("teams/manifest.json", "teams/preferences.sqlite"),
    "shared": ("team-reward/team.json", "team-reward/team.safetensors"),
    "run": ("run/config.yaml", "run/rounds/00/report.json"),
    "queries": ("queries/episodes.json",),
    "lerobot": ("lerobot/meta/info.json", "lerobot/data/chunk-000/file-000.parquet"),
    "minari": ("minari/data/main_data.hdf5",),
    "xml": ("go1.toml",),
}
"""Files in, or beside, an input that is read with it."""


@dataclass(frozen=True)
class Typed:
    """One way to use a command."""

    line: str
    """Options; {name} is an input, {out} what is written."""
    writes_set: bool = False
    """Whether it writes into the data set it reads."""

    @property
    def words(self) -> tuple[str, ...]:
        """The command itself."""
        words = self.line.split()
        return tuple(words[: 1 + (words[0] in ("data", "team"))])

    @property
    def writes_out(self) -> bool:
        """Whether it writes somewhere else than into the data set."""
        return "{out}" in self.line

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of what it reads."""
        return tuple(name for name in _INPUTS if f"{{{name}}}" in self.line)

    def parts(self) -> tuple[str, ...]:
        """Paths, in the world, of all that it reads."""
        own = [_INPUTS[name] for name in self.inputs]
        inside = [part for name in self.inputs for part in _PARTS.get(name, ())]
        return tuple(own + inside)

    def args(self, world: Path, out: Path) -> list[str]:
        """The arguments in `world`, writing to `out`."""
        places = {name: str(world / place) for name, place in _INPUTS.items()}
        places["first"] = (world / _FIRST).read_text() if "{first}" in self.line else ""
        return [word.format(out=out, **places) for word in self.line.split()]


TABLE = (
    Typed("loop --run {out} --preset quick --robot {xml}"),
    Typed("sweep --out {out} --plan {plan}"),
    Typed("train --out {out} --reward task --steps 96 --envs 4 --init {policy}"),
    Typed("train --out {out} --reward {reward} --steps 96 --envs 4"),
    Typed("record --policy {policy} --dataset {out} --episodes 2 --episode-s 1"),
    Typed("pairs --dataset {dataset} --count 1", writes_set=True),
    Typed("answer --dataset {dataset} --criterion task", writes_set=True),
    Typed("fit --dataset {dataset} --out {out} --model linear"),
    Typed("relabel --reward {reward} --dataset {dataset} --out {out}"),
    Typed(
        "options --out {out} --policy walk={shipped} --policy other={policy} "
        "--steps 64 --envs 4 --course bar"
    ),
    Typed("team train --out {out} --init {team} --steps 96 --robots 4"),
    Typed("team record --policy {team} --dataset {out} --episodes 2 --episode-s 1"),
    Typed("team answer --dataset {teams}", writes_set=True),
    Typed("team fit --dataset {teams} --out {out}"),
    Typed("team shares --reward {shared} --dataset {teams}"),
    Typed("evaluate --policy {policy} --reward {reward} --episodes 2"),
    Typed("report --run {run}"),
    Typed("method --run {run}"),
    Typed("doctor"),
    Typed("watch {run} --port 0"),
    Typed("trust --reward {reward} --dataset {dataset}"),
    Typed("explain --reward {reward} --dataset {dataset} --out {out}"),
    Typed("raters --dataset {dataset} list"),
    Typed("raters --dataset {dataset} stats"),
    Typed("raters --dataset {dataset} add new", writes_set=True),
    Typed("raters --dataset {dataset} revoke ada", writes_set=True),
    Typed("raters --dataset {dataset} leave-out ada", writes_set=True),
    Typed("raters --dataset {dataset} take-in ada", writes_set=True),
    Typed("raters --dataset {dataset} gold"),
    Typed(
        "label --dataset {dataset} --no-auth --port 0 --guidelines {guidelines}",
        writes_set=True,
    ),
    Typed("play --policy {policy} --port 0"),
    Typed("play --policy {policy} --against {shipped} --dataset {out} --port 0"),
    Typed("arena --out {out} --policy a={policy} --policy b={shipped} --episodes 5"),
    Typed("film --policy {policy} --out {out}.gif --duration-s 1 --fps 2"),
    Typed("export --policy {policy} --out {out}"),
    Typed("policy import {theirs} --out {out}"),
    Typed("robot inspect {xml}"),
    Typed("data info --dataset {dataset}"),
    Typed("data verify --dataset {dataset}"),
    Typed("data recover --dataset {dataset}", writes_set=True),
    Typed("data recover --dataset {out} --file {episode}"),
    Typed("data merge --dataset {out} --source {dataset}"),
    Typed("data split --dataset {dataset} --out {out}"),
    Typed("data subset --dataset {dataset} --out {out}"),
    Typed("data pack --dataset {dataset} --out {out}"),
    Typed("data unpack --dataset {out} --archive {archive}"),
    Typed("data push {dataset} {out}"),
    Typed("data pull {out} {place}"),
    Typed("data card --dataset {dataset} --out {out}"),
    Typed("data labels --dataset {dataset}"),
    Typed("data labels --dataset {dataset} --format parquet --out {out}"),
    Typed("data view --dataset {dataset} --episode {first} --out {out}"),
    Typed("data import ros2 {bag} --map {map} --dataset {out}"),
    Typed("data import csv {csv} --map {columns} --dataset {out}"),
    Typed("data import lerobot {lerobot} --map {columns} --dataset {out}"),
    Typed("data import minari {minari} --map {columns} --dataset {out}"),
    Typed("data import uni-rlhf {queries} --dataset {dataset}", True),
    Typed("data export --format minari --dataset {dataset} --out {out}"),
    Typed("data export --format lerobot --dataset {dataset} --out {out}"),
    Typed("data export --format hf --dataset {dataset} --out {out}"),
    Typed("data export --format uni-rlhf --dataset {dataset} --out {out}"),
)


def make_world(world: Path) -> None:
    """Write everything that `TABLE` reads; a few seconds."""
    ppo = PpoCfg(num_envs=4, hidden_sizes=(8,))
    robot = load_robot(physics_dt_s=EnvCfg().physics_dt_s)
    (world / "shipped.pt").write_bytes(WALK.read_bytes())
    (world / "team.pt").write_bytes(as_team(WALK, TeamCfg()))
    train(world / "train", robot, TrainCfg(steps=96, env=EnvCfg(), ppo=ppo))
    for line in (
        "record --policy {policy} --dataset {dataset} --episodes 20 --episode-s 2",
        "pairs --dataset {dataset} --count 24",
        "answer --dataset {dataset} --criterion crouch",
        "fit --dataset {dataset} --out {reward} --model linear",
        "team record --policy {team} --dataset {teams} --episodes 10 --episode-s 2",
        "pairs --dataset {teams} --count 16",
        "team answer --dataset {teams}",
        "team fit --dataset {teams} --out {shared}",
        "raters --dataset {dataset} add ada",
        "data pack --dataset {dataset} --out {archive}",
        "data export --format uni-rlhf --dataset {dataset} --out {queries}",
        "data push {dataset} {place}",
        "export --policy {policy} --out {out}/theirs",
    ):
        if code := main(Typed(line).args(world, world)):
            raise RuntimeError(f"{line} ended with {code}")
    names = [f"{joint.lower()}_joint" for joint in JOINTS]
    write_bag(world / "walk.mcap", Motion(robot), names)
    write_tables(world, robot)
    (world / "go1.xml").write_text(robot.mjcf)
    (world / "map.toml").write_text(
        f'robot = "go1.xml"\ncommand = [0.5, 0.0, 0.0]\n[joints]\n'
        f'names = {json.dumps(names)}\n[base]\ntopic = "/base"\n'
    )
    (world / "guidelines.md").write_text("Look.\n")
    (world / "go1.toml").write_text("")
    small_plan(world)
    whole = next((world / "set" / "rollouts").glob("*/*.mcap"))
    (world / _FIRST).write_text(whole.stem)
    (world / "cut.mcap").write_bytes(whole.read_bytes()[:-500])
    _make_run(world / "run")


def _make_run(run: Path) -> None:
    """A run of one round, as its report reads it."""
    claim(run, small_cfg(), inputs_of(small_cfg()).contents)
    evaluation = {
        "return_mean": 1.0,
        "return_ci95": 0.1,
        "tracking_error_m_s": 0.2,
        "falls_per_minute": 0.0,
        "power_w": 20.0,
        "episodes": 8,
    }
    told = {"round": 0, "policy_steps": 1536, "evaluation": evaluation}
    folder = run / "rounds" / "00"
    folder.mkdir(parents=True)
    (folder / "report.json").write_text(json.dumps(told))


if __name__ == "__main__":
    make_world(Path(sys.argv[1]))
