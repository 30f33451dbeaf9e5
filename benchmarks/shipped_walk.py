"""Make the walking policy that ships: `python -m benchmarks.shipped_walk`.

It is the base of the benchmark's styles, so that what docs/benchmarks.md says of a
style holds for who begins with it.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from data.errors import GaitprefError
from data.files.files import sha256_file, write_atomically
from gaitpref.training.symmetry import in_mirror
from policy.robots.shipped import WALK
from policy.training.checkpoint import read_plain, saved_bytes
from policy.training.setup import setting_of
from policy.training.train_cfg import TrainCfg

from .until_it_walks import Parts, until_it_walks


@dataclass(frozen=True, kw_only=True)
class ShippedWalk:
    """Train until the robot walks for each command and from rest, and write it."""

    work: Path = Path("runs/shipped-walk")
    """Directory of the training, which is gone on with or taken as it is."""
    out: Path = WALK
    """The file."""
    seed: int = 1_000
    first_steps: int = 800_000
    """Environment steps before the first look."""
    part_steps: int = 200_000
    """Environment steps between two looks."""
    most_steps: int = 3_000_000
    """Environment steps after which it is given up."""
    episodes: int = 256
    """Episodes of a look."""


def main(options: ShippedWalk) -> int:
    """Train and write."""
    setting = setting_of(None, None)
    ppo = in_mirror(setting.ppo, setting.robot)
    walked = until_it_walks(
        options.work,
        setting.robot,
        TrainCfg(steps=0, env=setting.env, ppo=ppo, seed=options.seed),
        Parts(
            first_steps=options.first_steps,
            steps=options.part_steps,
            most_steps=options.most_steps,
            episodes=options.episodes,
        ),
    )
    if not walked.walking.walks:
        print(f"benchmarks.shipped_walk: no walk after {walked.steps:,} steps")
        return 1
    # Its optimizer's state is two thirds of it, and nothing begins from that.
    payload = {**read_plain(walked.policy), "optimizer_state_dict": {}}
    write_atomically(options.out, saved_bytes(payload))
    print(f"{options.out}: {sha256_file(options.out)}")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(ShippedWalk)))
    except GaitprefError as error:
        sys.exit(f"benchmarks.shipped_walk: {error}")
