"""Which policy a reward would choose: what answers are worth without training on them.

`python -m benchmarks.choosing --run RUN [RUN ...]` takes finished runs on one task,
turns a share of their answers round, fits rewards of several sizes of ensemble, and
lets each, with more or less caution, choose among all policies of all runs. Accuracy on
clips hardly tells such rewards apart; what they choose does, because a policy that was
trained on a wrong reward is among what there is to choose from.

Shapes: T steps, N episodes, F feature columns, P policies, B pairs, K steps.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
import tyro
from torch import Tensor

from data.dataset import Dataset
from gaitpref.criteria import load_criterion
from gaitpref.progress import console, counting_bar
from gaitpref.rewards import criterion_context, score_of_criterion
from gaitpref.run_config import read_config
from policy.checkpoint import load_policy
from policy.evaluate import rollout_features
from policy.rollout import hold_home
from rewardmodel.caution import CautiousReward
from rewardmodel.cfg import FitCfg, LinearCfg
from rewardmodel.fit import fit_reward
from rewardmodel.model import RewardModel
from rewardmodel.pairs import AnsweredPairs, load_pairs

_EPISODES = 16
_EVERY = 5
"""Steps of an episode between two that a reward is asked about."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the policy that a reward chooses is worth."""

    run: tuple[Path, ...]
    """Runs of `gaitpref loop` with one criterion."""
    beside: tuple[Path, ...] = ()
    """Others whose policies there are to choose from too."""
    mistakes: float = 0.2
    """Share of the answers that are turned round, beside what the raters got wrong."""
    members: tuple[int, ...] = (5, 50)
    """Sizes of the ensemble."""
    caution: tuple[float, ...] = (0.0,)
    """Deviations by which a habit that the ensemble disagrees about is paid less."""
    draws: int = 2
    """Fits for every run, each with other mistakes."""
    seed: int = 0
    """Where chance comes from."""


@dataclass(frozen=True)
class Shown:
    """What a policy does, and what it is worth."""

    rows: Tensor
    """[K, F] steps of its episodes."""
    value: float
    """Mean score of a step under the criterion; 0 is holding the home pose and 1 the
    best policy of all."""


def shown_policies(runs: tuple[Path, ...]) -> list[Shown]:
    """All policies of all rounds, and the home pose, on the same episodes."""
    found = [path for run in runs for path in _policies(run)]
    criterion = read_config(runs[0]).criterion
    rows, scores = [], []
    with counting_bar("looking at policies", len(found) + 1) as bar:
        for path in [None, *found]:
            policy = load_policy(path or found[0])
            features, lengths = rollout_features(
                policy if path else hold_home,
                policy.robot(),
                policy.info.env,
                episodes=_EPISODES,
                seed=1_000_005,
            )
            step = torch.arange(len(features))[:, None]
            there = step < lengths
            context = criterion_context(policy.robot(), policy.info.env)
            score = score_of_criterion(load_criterion(criterion, context))
            scored = score(features, (step == 0).expand(there.shape))
            # A fallen robot earns nothing more, so falls count.
            scores.append(float((scored * there).sum() / there.numel()))
            rows.append(features[there & (step % _EVERY == 0)])
            bar.advance(bar.task_ids[0])
    home = scores[0]
    # Where none is better than the home pose, values are differences of scores.
    scale = (max(scores) - home) or 1.0
    return [
        Shown(seen, (score - home) / scale)
        for seen, score in zip(rows, scores, strict=True)
    ]


def _policies(run: Path) -> Iterator[Path]:
    for round in sorted((run / "rounds").iterdir())[1:]:
        if (path := round / "policy/policy.pt").exists():
            yield path


def mistaken(
    pairs: AnsweredPairs, share: float, rng: np.random.Generator
) -> AnsweredPairs:
    """`pairs` with a share of the answers turned round."""
    wrong = torch.tensor(rng.random(len(pairs)) < share)
    return replace(pairs, target=torch.where(wrong, 1 - pairs.target, pairs.target))


def chosen(model: RewardModel, caution: float, shown: list[Shown]) -> float:
    """Value of the policy that a careful `model` pays most for a step."""
    reward = CautiousReward(model, caution)
    paid = [
        reward(policy.rows[None], torch.zeros(1, len(policy.rows))).mean()
        for policy in shown
    ]
    return shown[int(torch.stack(paid).argmax())].value


def main(options: Options) -> int:
    torch.set_num_threads(1)
    shown = shown_policies(options.run + options.beside)
    answered = [load_pairs([Dataset.open(run / "dataset")]) for run in options.run]
    for members in options.members:
        cfg = FitCfg(linear=LinearCfg(num_members=members))
        rng = np.random.default_rng(options.seed)
        models = [
            fit_reward(
                mistaken(pairs, options.mistakes, rng), cfg, seed=draw, measured=False
            )[0]
            for draw in range(options.draws)
            for pairs in answered
        ]
        for caution in options.caution:
            values = [chosen(model, caution, shown) for model in models]
            console.print(
                f"{members} members, caution {caution:g}, {len(values)} fits: the "
                f"policy chosen of {len(shown)} is worth {np.mean(values):.2f}, at "
                f"worst {min(values):.2f}"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
