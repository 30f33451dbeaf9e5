"""What to do about answers that look wrong: nothing, ask again, leave out, turn round.

`python -m benchmarks.wrong_answers --run RUN [RUN ...]` takes finished runs of a
simulated rater who errs. Their questions are answered anew, by the same kind of rater,
and rewards are fitted to as many answers in several ways: to each question once; to
fewer questions, some of them asked again, those whose answers look most wrong or any;
and to each once, without the answers that look wrong, or with these turned round
(as RIME does: Cheng et al. 2024, "RIME: Robust Preference-based Reinforcement Learning
with Noisy Preferences"). An answer looks wrong to a model fitted to others. Rewards are
asked about pairs nobody was asked about, and to order the policies of all the runs.

Shapes: B pairs.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
import tyro
from torch import Tensor

from data.answers import Pair
from data.dataset import Dataset
from gaitpref.criteria import Criterion, load_criterion
from gaitpref.judging import judge
from gaitpref.loop_cfg import LoopCfg
from gaitpref.progress import console
from gaitpref.rater import ClipScores, standards_among
from gaitpref.rewards import criterion_context
from gaitpref.run_config import read_config
from policy.checkpoint import load_policy
from rewardmodel.extensions.label_filter import likelihoods
from rewardmodel.fit import fit_reward
from rewardmodel.held_out_report import accuracy_of
from rewardmodel.kinds import prepare
from rewardmodel.pairs import AnsweredPairs, gather_pairs

from .policy_order import rank_correlation, walks_of
from .preference_fresh import fresh_pairs

_TARGETS = {"a": 1.0, "b": 0.0, "equal": 0.5}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Rewards fitted to answers some of which are wrong."""

    run: tuple[Path, ...]
    """Runs of `gaitpref loop` with a simulated rater who errs, of one criterion."""
    draws: int = 3
    """Times the questions of each run are answered anew."""
    again: float = 0.15
    """Share of the answers that ask again, in the ways that do."""
    unlikely: float = 0.2
    """Probability, foreseen without it, below which an answer is left out or turned
    round."""


@dataclass(frozen=True, eq=False)
class Asked:
    """The questions of a run, in the order they were asked, and who answers them."""

    dataset: Dataset
    cfg: LoopCfg
    criterion: Criterion
    pairs: Sequence[Pair]
    answer: Callable[[Pair, np.random.Generator], float | None]
    """1, 0.5 or 0 of the left clip; None for no preference that could be fitted."""

    @classmethod
    def of(cls, run: Path) -> Asked:
        """Of a finished run."""
        cfg, dataset = read_config(run), Dataset.open(run / "dataset")
        policy = load_policy(run / "rounds/00/policy/policy.pt")
        context = criterion_context(policy.robot(), policy.info.env)
        criterion = load_criterion(cfg.criterion, context)
        scores = ClipScores(dataset.features, criterion)
        with dataset.answers_copy() as store:
            pairs = [pair for pair in store.pairs() if pair.gold is None]
        known = standards_among(pairs, scores, cfg.simulated)

        def answer(pair: Pair, rng: np.random.Generator) -> float | None:
            said = judge(scores(pair.a), scores(pair.b), cfg.simulated, known, rng)
            return _TARGETS.get(said)

        return cls(dataset, cfg, criterion, pairs, answer)

    def answered(
        self, pairs: Sequence[Pair], rng: np.random.Generator
    ) -> AnsweredPairs:
        """What the rater says of `pairs` this time."""
        said = [(pair, self.answer(pair, rng)) for pair in pairs]
        kept = [(pair, target) for pair, target in said if target is not None]
        gathered = gather_pairs([self.dataset], [pair for pair, _ in kept])
        return replace(
            gathered,
            target=torch.tensor([target for _, target in kept]),
            raters=("simulated",) * len(kept),
        )


def _likely(pairs: AnsweredPairs, cfg: LoopCfg, *, seed: int) -> Tensor:
    """Probability [B] of each answer, foreseen by a model fitted to others."""
    model, _ = fit_reward(pairs, cfg.fit_of(cfg.rounds - 1), seed=seed, measured=False)
    found = model.provenance.cfg
    return likelihoods(prepare(pairs, found), found, seed=seed)


def ways(
    asked: Asked, options: Options, rng: np.random.Generator, *, seed: int
) -> Iterator[tuple[str, AnsweredPairs]]:
    """The answers of one draw, as many each, by what is done about those that look
    wrong."""
    once = asked.answered(asked.pairs, rng)
    yield "each once", once
    likely = _likely(once, asked.cfg, seed=seed)
    yield "left out", once.subset(likely >= options.unlikely)
    turned = torch.where(likely < options.unlikely, 1 - once.target, once.target)
    yield "turned round", replace(once, target=turned)
    count = round(options.again * len(asked.pairs))
    first = list(asked.pairs[: len(asked.pairs) - count])
    fewer = asked.answered(first, rng)
    likely = _likely(fewer, asked.cfg, seed=seed)
    rows = likely.argsort()[:count].tolist()
    yield "doubted again", _with(asked, fewer, first, rows, rng)
    rows = rng.permutation(len(fewer))[:count].tolist()
    yield "any again", _with(asked, fewer, first, rows, rng)


def _with(
    asked: Asked,
    answered: AnsweredPairs,
    pairs: Sequence[Pair],
    rows: Sequence[int],
    rng: np.random.Generator,
) -> AnsweredPairs:
    """`answered`, and new answers to the questions of `rows`."""
    if len(answered) != len(pairs):
        raise ValueError("a rater who skips questions cannot be asked again by row")
    again = asked.answered([pairs[row] for row in rows], rng)
    both = gather_pairs([asked.dataset], [*pairs, *(pairs[row] for row in rows)])
    return replace(
        both,
        target=torch.cat([answered.target, again.target]),
        raters=answered.raters + again.raters,
    )


def main(options: Options) -> int:
    """Print a line for every way: means over runs and draws."""
    torch.set_num_threads(1)
    walks = walks_of(options.run)
    found: dict[str, list[tuple[float, float]]] = {}
    for number, run in enumerate(options.run):
        asked = Asked.of(run)
        fresh = fresh_pairs(run, asked.cfg, asked.criterion)
        for draw in range(options.draws):
            rng = np.random.default_rng([number, draw])
            for way, pairs in ways(asked, options, rng, seed=draw):
                fit = asked.cfg.fit_of(asked.cfg.rounds - 1)
                model, _ = fit_reward(pairs, fit, seed=draw, measured=False)
                accuracy = accuracy_of(fresh.leads(model), fresh.target)
                share = accuracy.share if accuracy else float("nan")
                order = rank_correlation(walks, model)
                found.setdefault(way, []).append((share, order))
    console.print("way; fresh pairs foreseen, worst; rank correlation, worst")
    for way, rows in found.items():
        shares, orders = (np.array(column) for column in zip(*rows, strict=True))
        console.print(
            f"{way:14s} {shares.mean():.3f} {shares.min():.2f}  "
            f"{orders.mean():.2f} {orders.min():.2f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, description=__doc__)))
