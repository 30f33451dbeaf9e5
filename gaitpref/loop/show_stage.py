"""Policies side by side: recorded alike, asked about, and what the answers say."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from data.answers.answer_records import Pair
from data.answers.curation import answers_heard
from data.answers.strategy_names import APPROVAL
from data.datasets.dataset import Dataset
from data.files.files import read_json, write_atomically
from gaitpref.method.acceptance import Duel
from gaitpref.method.clip_sources import ClipSources
from gaitpref.method.context import RoundContext
from gaitpref.method.method import Method
from gaitpref.training.by_method import recorded_by
from policy.rollouts.record import record
from policy.training.checkpoint import Policy, load_policy
from policy.training.training_dir import POLICY_NAME
from rewardmodel.acquisition import asked_for, in_step
from rewardmodel.answers.program_agreement import PROGRAM
from rewardmodel.asking.clip_questions import clips_of

from .loop_cfg import LoopCfg
from .people import People
from .run_dir import Round, began_from, place_of, seed_of

_EPISODES = 10
"""Episodes of either policy: two of every command that is recorded."""
_LEAST_CLIP_S = 0.1
"""A fall is seen in no time, and one who falls at once is to be judged too."""


def to_compare(
    method: Method, round: Round, context: RoundContext
) -> tuple[Policy, ...]:
    """The policies that answers of the round compare, the newest first: none, or it and
    the one it was to better, and in the last round the first of all.

    One that leaves a standstill is not judged before the last round: it need not please
    yet.
    """
    if method.accept is None:
        return ()
    last = context.is_last and bool(method.labels_kept(context))
    if not last and not method.accept.judges(context):
        return ()
    before = load_policy(began_from(round)) if round.number else None
    if last:
        waits = round.candidate / POLICY_NAME
        new = load_policy(waits if waits.exists() else round.policy)
        first = load_policy(Round(round.run, 0).policy)
        found = (new, before or new, first)
    elif not round.standstill.exists():
        found = (load_policy(round.policy), before) if before else ()
    else:
        return ()
    different = {policy.sha256: policy for policy in found}
    return tuple(different.values()) if len(different) > 1 else ()


def show_stage(
    cfg: LoopCfg,
    round: Round,
    context: RoundContext,
    dataset: Dataset,
    people: People,
) -> None:
    """Log the policies that are compared as they would be used, from equal starts."""
    if round.shown.exists() or round.reward.exists() or round.verdict.exists():
        return
    policies = to_compare(cfg.method, round, context)
    if not policies:
        return
    people.tell(f"{place_of(cfg, round)}: showing the new policy beside the last")
    alike = ClipSources(noisy_share=0.0, posture_share=0.0)
    plain = recorded_by(alike, replace(cfg.record, episodes=_EPISODES))
    entries = dataset.add_episodes(
        episode
        for policy in policies
        for episode in record(
            round.policy,
            plain,
            seed=seed_of(cfg, round.number, 10),
            round=round.number,
            policies=[policy],
        )
    )
    names = sorted(entry.sha256 for entry in entries)
    write_atomically(round.shown, json.dumps(names, indent=0).encode())


def pairs_of_both(
    cfg: LoopCfg,
    round: Round,
    dataset: Dataset,
    new: str,
    old: str,
    *,
    known: Sequence[Pair] = (),
) -> list[Pair]:
    """All pairs of two policies, by their SHA-256, that are not `known`, every command
    in turn.

    Both clips of a pair begin as near to the same step as the episodes allow.
    """
    names = set(read_json(round.shown))
    entries = {e.sha256: e for e in dataset.entries() if e.sha256 in names}
    news, olds = (
        [e for e in entries.values() if e.meta.policy_sha256 == sha256]
        for sha256 in (new, old)
    )
    rng = np.random.default_rng(seed_of(cfg, round.number, 11))
    taken = {frozenset((pair.a, pair.b)) for pair in known}
    cut = replace(cfg.clips, min_clip_s=min(_LEAST_CLIP_S, cfg.clips.min_clip_s))
    by_command: dict[tuple[float, ...], list[Pair]] = {}
    clips = clips_of(news, cut)
    for index in rng.permutation(len(clips)):
        clip, entry = clips[index], entries[clips[index].rollout]
        meta = entry.meta
        alike = [other for other in olds if other.meta.env_index == meta.env_index]
        # Who falls in the middle of a manoeuvre was told less than the other.
        others = [
            other
            for other in clips_of(alike, cut)
            if asked_for(entries[other.rollout], other) == asked_for(entry, clip)
        ]
        if not others:
            continue
        beside = min(others, key=lambda other: abs(other.start - clip.start))
        sides = (clip, beside) if rng.random() < 0.5 else (beside, clip)
        pair = in_step(
            Pair.make(*sides, strategy=APPROVAL, round=round.number),
            entries,
            dataset.clip_features,
            reach_s=cfg.clips.stride_s / 2,
        )
        if frozenset((pair.a, pair.b)) not in taken:
            taken.add(frozenset((pair.a, pair.b)))
            by_command.setdefault(meta.command, []).append(pair)
    turns = zip_longest(*by_command.values())
    return [pair for turn in turns for pair in turn if pair is not None]


def duel_of(round: Round, dataset: Dataset, new: str, old: str) -> Duel:
    """What the round's answers say of two policies, by their SHA-256: for each pair
    once, where those who answered it agree. Beside people, programs say nothing."""
    played = {e.sha256: e.meta.policy_sha256 for e in dataset.entries()}
    with dataset.answers() as store:
        answers, kinds = answers_heard(store, round.number), store.raters()
    if any(kinds[answer.rater_id] == "human" for _, answer in answers):
        answers = [row for row in answers if kinds[row[1].rater_id] != PROGRAM]
    said: dict[str, set[str | None]] = {}
    for pair, answer in answers:
        both = {played.get(pair.a.rollout), played.get(pair.b.rollout)}
        if pair.strategy != APPROVAL or both != {new, old}:
            continue
        if answer.choice in ("a", "b"):
            clip = pair.a if answer.choice == "a" else pair.b
            said.setdefault(pair.pair_id, set()).add(played[clip.rollout])
    preferred = [next(iter(own)) for own in said.values() if len(own) == 1]
    return Duel(for_new=preferred.count(new), for_old=preferred.count(old))


def shown_by(round: Round, dataset: Dataset, policy: str) -> bool:
    """Whether an episode that was recorded for it shows a policy, by its SHA-256."""
    shown = set(read_json(round.shown)) if round.shown.exists() else set[str]()
    return any(
        e.sha256 in shown and e.meta.policy_sha256 == policy for e in dataset.entries()
    )
