"""Two policies side by side: recorded alike, asked about, and what the answers say.

Where answers err, a reward may be right about most pairs and still ruin what is trained
on it. So the first questions of a round are about its new policy beside the one it was
to better. A style's last policy is judged in any case: after it nobody is asked.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

import numpy as np

from data.answers import Pair
from data.clips import Clip
from data.dataset import Dataset
from data.files import read_json, sha256_file, write_atomically
from policy.checkpoint import Policy, load_policy
from policy.record import record
from policy.train import POLICY_NAME
from rewardmodel.acquisition import asked_for, in_step
from rewardmodel.noise_level import ERROR_SHARES
from rewardmodel.storage import load_reward

from .by_method import recorded_by
from .loop_cfg import LoopCfg
from .method.acceptance import Verdict
from .method.clips import ClipSources
from .method.context import RoundContext
from .method.method import Method
from .people import People
from .questions import clips_of
from .rounds import Round, began_from, place_of, seed_of

STRATEGY = "approval"
_EPISODES = 10
"""Of either policy: two of every command that is recorded."""
_LEAST_CLIP_S = 0.1
"""A fall is seen in no time, and one who falls at once is to be judged too."""


def labels_kept(method: Method, context: RoundContext) -> int:
    """Answers that are kept for judging the last policy."""
    if method.accept is None:
        return 0
    return method.budget.most_kept(context, method.accept.labels(context))


def both_policies(
    method: Method, round: Round, context: RoundContext
) -> tuple[Policy, Policy] | None:
    """The new policy of a round and the one it was to better, where the round's
    questions are about them.

    One that leaves a standstill is not judged: it need not please yet.
    """
    if method.accept is None or not method.accept.judges(context):
        return None
    if not labels_kept(method, context) or round.standstill.exists():
        return None
    file = round.candidate / POLICY_NAME if context.is_last else round.policy
    if not file.exists():
        return None
    new, old = load_policy(file), load_policy(began_from(round))
    return None if new.sha256 == old.sha256 else (new, old)


def show_stage(
    cfg: LoopCfg,
    round: Round,
    context: RoundContext,
    dataset: Dataset,
    people: People,
) -> None:
    """Log both policies as they would be used, from equal starts."""
    if round.shown.exists() or round.reward.exists():
        return
    policies = both_policies(cfg.method, round, context)
    if policies is None:
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
    policies: tuple[Policy, Policy],
    *,
    known: Sequence[Pair],
) -> list[Pair]:
    """All pairs of the two policies that are not known, every command in turn.

    Both clips of a pair begin as near to the same step as the episodes allow.
    """
    names = set(read_json(round.shown))
    entries = {e.sha256: e for e in dataset.entries() if e.sha256 in names}
    new, old = (
        [e for e in entries.values() if e.meta.policy_sha256 == policy.sha256]
        for policy in policies
    )
    rng = np.random.default_rng(seed_of(cfg, round.number, 11))
    taken = {frozenset((pair.a, pair.b)) for pair in known}
    cut = replace(cfg.clips, min_clip_s=min(_LEAST_CLIP_S, cfg.clips.min_clip_s))
    by_command: dict[tuple[float, ...], list[Pair]] = {}
    clips = clips_of(new, cut)
    for index in rng.permutation(len(clips)):
        clip, entry = clips[index], entries[clips[index].rollout]
        meta = entry.meta
        alike = [other for other in old if other.meta.env_index == meta.env_index]
        # Who falls in the middle of a manoeuvre was told less than the other.
        beside = _nearest(
            clip,
            [
                other
                for other in clips_of(alike, cut)
                if asked_for(entries[other.rollout], other) == asked_for(entry, clip)
            ],
        )
        if beside is None:
            continue
        sides = (clip, beside) if rng.random() < 0.5 else (beside, clip)
        pair = in_step(
            Pair.make(*sides, strategy=STRATEGY, round=round.number),
            entries,
            dataset.clip_features,
            reach_s=cfg.clips.stride_s / 2,
        )
        if frozenset((pair.a, pair.b)) not in taken:
            by_command.setdefault(meta.command, []).append(pair)
    turns = zip_longest(*by_command.values())
    return [pair for turn in turns for pair in turn if pair is not None]


def _nearest(clip: Clip, others: Sequence[Clip]) -> Clip | None:
    return min(others, key=lambda other: abs(other.start - clip.start), default=None)


def verdict_of(
    round: Round, dataset: Dataset, new: Path, *, needed: float
) -> Verdict | None:
    """What the round's answers say of its new policy, the file `new`; None where nobody
    was asked."""
    with dataset.answers() as store:
        if all(pair.strategy != STRATEGY for pair in store.pairs(round=round.number)):
            return None
        answers = store.current_answers(round=round.number)
    preferred = [
        pair.a if answer.choice == "a" else pair.b
        for pair, answer in answers
        if pair.strategy == STRATEGY and answer.choice in ("a", "b")
    ]
    by_sha256 = {entry.sha256: entry for entry in dataset.entries()}
    preferred = [clip for clip in preferred if clip.rollout in by_sha256]
    # However sure a fit is that nobody errs, one answer is no proof.
    share = load_reward(round.before.reward).provenance.cfg.error_share
    new_sha256 = sha256_file(new)
    for_new = sum(
        by_sha256[clip.rollout].meta.policy_sha256 == new_sha256 for clip in preferred
    )
    return Verdict(
        for_new=for_new,
        for_old=len(preferred) - for_new,
        error_share=max(share, ERROR_SHARES[0]),
        needed=needed,
    )
