"""Which policy a reward would choose: what answers are worth without training on them.

`python -m benchmarks.choosing --run RUN [RUN ...]` takes finished runs on one task,
turns a share of their answers round, fits rewards of several sizes of ensemble and
strengths of opinion, and lets each, with more or less caution, choose among all
policies of all runs, and put them in order. Accuracy on clips hardly tells such rewards
apart; what they choose does, because a policy that was trained on a wrong reward is
among what there is to choose from.

Shapes: T steps, N episodes, F feature columns, P policies, B pairs, K steps.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
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
from rewardmodel.pairs import AnsweredPairs, load_pairs

from .harness import spearman

_EPISODES = 16
_EVERY = 5
"""Steps of an episode between two that a reward is asked about."""
_GOOD = 0.93
"""Worth of a policy, of the best, from which on it is a good one."""


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
    precision: tuple[float, ...] = (LinearCfg.prior_precision,)
    """How weak opinions are expected to be."""
    caution: tuple[float, ...] = (0.0,)
    """Deviations by which a habit that the ensemble disagrees about is paid less."""
    sure: tuple[float, ...] = (0.0,)
    """Deviations that a weight must be above 0 to pay at all (`LoopCfg.sure`)."""
    told_most: bool = False
    """Expect strong opinions of doing what the robot is told, as a run from scratch
    does (`LinearCfg.told_most`)."""
    round: int | None = None
    """Look at the answers up to this round only, counted from 0."""
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


@dataclass(frozen=True)
class Judged:
    """What a reward makes of policies."""

    worth: float
    """Value of the policy that it pays most for a step."""
    order: float
    """Rank correlation of what it pays with what they are worth."""
    lead: float
    """Of good policies over the home pose, in deviations over all policies."""


def judged(reward: CautiousReward, shown: list[Shown]) -> Judged:
    """What a `reward` makes of policies, the first of which holds home."""
    paid = torch.stack(
        [
            reward(policy.rows[None], torch.zeros(1, len(policy.rows))).mean()
            for policy in shown
        ]
    )
    value = torch.tensor([policy.value for policy in shown])
    # Where nothing is better than the home pose, that is the best there is.
    good = value >= value.max().clamp_max(_GOOD)
    return Judged(
        worth=float(value[paid.argmax()]),
        order=spearman(paid, value),
        lead=float((paid[good].mean() - paid[0]) / paid.std()),
    )


def answers_of(run: Path, last: int | None) -> AnsweredPairs:
    """The answers of a run up to its round `last`."""
    pairs = load_pairs([Dataset.open(run / "dataset")])
    if last is None:
        return pairs
    return pairs.subset(torch.tensor(pairs.rounds) <= last)


def main(options: Options) -> int:
    torch.set_num_threads(1)
    shown = shown_policies(options.run + options.beside)
    answered = [answers_of(run, options.round) for run in options.run]
    for members, precision in product(options.members, options.precision):
        linear = LinearCfg(
            num_members=members,
            prior_precision=precision,
            told_most=options.told_most,
        )
        cfg = FitCfg(linear=linear)
        rng = np.random.default_rng(options.seed)
        models = [
            fit_reward(
                mistaken(pairs, options.mistakes, rng), cfg, seed=draw, measured=False
            )[0]
            for draw in range(options.draws)
            for pairs in answered
        ]
        for caution, sure in product(options.caution, options.sure):
            careful = partial(
                CautiousReward, caution=caution, sure=sure, pays_effort=caution == 0.0
            )
            found = [judged(careful(model), shown) for model in models]
            worth, lead = ([getattr(f, n) for f in found] for n in ("worth", "lead"))
            console.print(
                f"{members} members, precision {precision:g}, caution {caution:g}, "
                f"sure {sure:g}, {len(found)} fits: the policy chosen of {len(shown)} "
                f"is worth {np.mean(worth):.2f}, at worst {min(worth):.2f}; "
                f"rank correlation {np.mean([f.order for f in found]):.2f}; "
                f"lead over standing {np.median(lead):.2f}, at worst {min(lead):.2f}"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, config=(tyro.conf.OmitArgPrefixes,))))
