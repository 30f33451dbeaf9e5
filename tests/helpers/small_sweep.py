"""A sweep of loops of a few thousand steps, as a file of what it varies."""

from __future__ import annotations

from pathlib import Path

from data.files.files import sha256_file

PLAN = """
criterion: high_step
seed: [0, 1]
loop:
  base: none
  rounds: 1
  labels: 12
  steps: {round: 1536, last: 1536}
  evaluation_episodes: 8
  env: {episode_s: 2.0}
  ppo: {num_envs: 32, hidden_sizes: [16]}
  record: {episodes: 40, episode_s: 2.0}
"""


def small_plan(folder: Path) -> Path:
    """The file, in `folder`."""
    path = folder / "plan.yaml"
    path.write_text(PLAN)
    return path


def made_by(run: Path) -> dict[str, str]:
    """Hashes of all policies, rewards and episodes of a run by their path."""
    files = [
        *run.glob("rounds/*/policy/policy.pt"),
        *run.glob("rounds/*/reward/*"),
        *run.glob("dataset/rollouts/*/*.mcap"),
    ]
    return {str(file.relative_to(run)): sha256_file(file) for file in files}
