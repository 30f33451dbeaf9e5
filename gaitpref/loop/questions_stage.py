"""The stage of a round that asks: choose pairs, have them answered, choose again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from data.answers.answer_records import Pair
from data.answers.strategy_names import APPROVAL
from data.datasets.dataset import Dataset, EpisodeEntry
from data.episodes.visible_habits import NOTICED
from data.files.files import read_json
from gaitpref.console.progress import console
from gaitpref.method.context import RoundContext
from gaitpref.raters.criteria import Criterion
from gaitpref.report.fit_summary import what_remains
from policy.rollouts.babble import BABBLE_SHA256
from rewardmodel.answers.answered_pairs import MIN_ANSWERS, count_evidence, load_pairs
from rewardmodel.asking.asked_meanwhile import (
    answered_before,
    asked_and_left,
)
from rewardmodel.asking.clip_questions import ask, with_known_answer
from rewardmodel.asking.visible import Visible
from rewardmodel.fitting.fit_reward import fit_reward
from rewardmodel.models.model import RewardModel

from .collect import Collector
from .loop_cfg import LoopCfg
from .people import People
from .run_dir import Round, seed_of
from .show_stage import pairs_of_both, to_compare

GOLD_SHARE = 0.05
"""Pairs with a known answer to every pair that people are asked."""


def questions_stage(
    cfg: LoopCfg,
    round: Round,
    context: RoundContext,
    dataset: Dataset,
    criterion: Criterion,
    people: People,
) -> None:
    """Ask the round's questions in batches, each where the answers so far leave doubt.

    Within one batch, questions about the same doubt are as good as one.
    """
    if round.reward.exists():
        return
    collector = Collector(
        cfg=cfg,
        round=round,
        dataset=dataset,
        criterion=criterion,
        people=people,
        ask_more=partial(_add_pairs, cfg, round, context, dataset),
    )
    budget = cfg.method.budget
    count = budget.labels_of(
        context,
        kept=cfg.method.labels_kept(context),
        planned=cfg.method.labels_planned(context),
    )
    with dataset.answers() as store:
        if meanwhile := cfg.method.meanwhile:
            answered = answered_before(store, round.number)
            count = meanwhile.still_asked(count, answered)
        while True:
            asked, _ = asked_and_left(store, round.number)
            last = asked >= count
            if asked and not collector.answered(count, last=last):
                return
            if last or (asked and _enough(cfg, context, dataset)):
                return
            batch = min(cfg.method.questions.batch, count - asked)
            _add_pairs(cfg, round, context, dataset, batch)


def _add_pairs(
    cfg: LoopCfg, round: Round, context: RoundContext, dataset: Dataset, count: int
) -> None:
    """Choose `count` more pairs of a round: first of its policy beside the one before,
    where that is to be judged."""
    with dataset.answers() as store:
        known = store.pairs()
    # More pairs for the same round are others, even after a restart.
    before = [p for p in known if p.round == round.number and p.meanwhile is None]
    asked_before = len(before)
    entries = episodes_asked_about(cfg, round, dataset)
    rng = np.random.default_rng([seed_of(cfg, round.number, 3), asked_before])
    chosen: list[Pair] = []
    both = to_compare(cfg.method, round, context)
    if both and cfg.method.accept:
        judged = sum(pair.strategy == APPROVAL for pair in before)
        most = min(count, cfg.method.accept.noisy_labels - judged)
        shas = (policy.sha256 for policy in both)
        beside = pairs_of_both(cfg, round, dataset, *shas, known=known)
        chosen = beside[: max(0, most)]
    if len(chosen) < count:
        seed = seed_of(cfg, round.number, 7, asked_before)
        chosen += ask(
            dataset,
            entries,
            cfg.clips,
            count - len(chosen),
            known=[*known, *chosen],
            model=doubting(cfg, context, dataset, seed=seed),
            round_number=round.number,
            uniform_share=cfg.method.questions.uniform_share,
            strategy=cfg.method.questions.strategy,
            # A program sees what no eye does.
            told_apart=seen_apart(cfg, dataset) if cfg.rater == "human" else None,
            rng=rng,
        )
    if cfg.rater == "human":
        chosen += with_known_answer(
            entries,
            cfg.clips,
            _gold_wanted(before, count),
            known=[*known, *chosen],
            round_number=round.number,
            rng=rng,
        )
    with dataset.answers() as store:
        store.add_pairs(chosen)


def seen_apart(cfg: LoopCfg, dataset: Dataset) -> Visible:
    """Marks the pairs that the run's people can tell apart."""
    apart = cfg.method.questions.apart
    return Visible(dataset, NOTICED if apart is None else apart)


def doubting(
    cfg: LoopCfg, context: RoundContext, dataset: Dataset, *, seed: int
) -> RewardModel | None:
    """A reward whose doubt chooses the next questions; None while there are too few
    answers for one."""
    informed_from = cfg.method.questions.informed_from
    with dataset.answers() as store:
        if count_evidence(store, dataset, unchecked=cfg.unchecked) < informed_from:
            return None
    pairs = load_pairs([dataset], at_least=informed_from, unchecked=cfg.unchecked)
    # Only its doubt is asked for; the round's own fit is the one measured.
    fit = cfg.method.fit_of(context)
    return fit_reward(pairs, fit, seed=seed, measured=False)[0]


def episodes_asked_about(
    cfg: LoopCfg, round: Round, dataset: Dataset
) -> list[EpisodeEntry]:
    """The round's own episodes, and some of what earlier policies did; not those that
    are gone."""
    by_sha256 = {entry.sha256: entry for entry in dataset.entries()}
    own, *before = (
        [
            by_sha256[name]
            for name in read_json(Round(round.run, n).recorded)
            if name in by_sha256
        ]
        for n in range(round.number, -1, -1)
    )
    earlier = [
        entry
        for entries in before
        for entry in entries
        if entry.meta.policy_sha256 != BABBLE_SHA256
    ]
    count = min(len(earlier), int(cfg.method.clips.earlier_share * len(own)))
    rng = np.random.default_rng(seed_of(cfg, round.number, 8))
    return own + [earlier[i] for i in rng.permutation(len(earlier))[:count]]


def _enough(cfg: LoopCfg, context: RoundContext, dataset: Dataset) -> bool:
    """Whether the round's questions end here, because more answers will not help."""
    if not cfg.stop_asking:
        return False
    with dataset.answers() as store:
        if count_evidence(store, dataset, unchecked=cfg.unchecked) < MIN_ANSWERS:
            return False
    seed = seed_of(cfg, context.number, 5)
    fit = cfg.method.fit_of(context)
    pairs = load_pairs([dataset], unchecked=cfg.unchecked)
    _, report = fit_reward(pairs, fit, seed=seed)
    if report.enough:
        console.print(
            f"round {context.number}: {what_remains(report)}, so it stops asking"
        )
    return report.enough


def _gold_wanted(before: Sequence[Pair], count: int) -> int:
    """Pairs with a known answer that go with `count` more pairs of a round."""
    gold = sum(pair.gold is not None for pair in before)
    return max(0, math.ceil(GOLD_SHARE * (len(before) - gold + count)) - gold)
