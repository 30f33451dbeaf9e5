"""The last policy is shown beside the one before it, and the answers decide.

Where answers err, a reward may be right about most pairs and still ruin what is trained
on it, and no questions follow the last training that could say so. So some answers are
kept for it (`asking.labels_kept`): the policy before it stays unless they speak for the
new one.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, dataclass, replace
from itertools import zip_longest

import numpy as np

from data.answers import Pair
from data.dataset import Dataset, EpisodeEntry
from data.files import replace_directory, write_atomically
from policy.checkpoint import Policy, load_policy
from policy.record import record
from policy.train import POLICY_NAME
from policy.variation import VariationCfg
from rewardmodel.acquisition import in_step
from rewardmodel.storage import load_reward

from .asking import Patience, answered, labels_kept
from .criteria import Criterion
from .people import People
from .progress import console
from .questions import clips_of
from .rounds import Round, place_of, seed_of
from .run_config import LoopCfg

STRATEGY = "approval"
ODDS = 3.0
"""How much likelier than not the answers must make it that the new policy is better."""
_EPISODES = 10
"""Of either policy: two of every command that is recorded."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the answers say of a new policy beside the one before it."""

    for_new: int
    """Answers that prefer it."""
    for_old: int
    """Answers that prefer the one before it."""
    error_share: float
    """Share of answers that are random, as the newest reward found it, in (0, 1)."""

    @property
    def odds(self) -> float:
        """That the new policy is better, if either was as likely before."""
        wrong = self.error_share / 2
        return ((1 - wrong) / wrong) ** (self.for_new - self.for_old)

    @property
    def approved(self) -> bool:
        return self.odds >= ODDS


def approval_stage(
    cfg: LoopCfg, round: Round, dataset: Dataset, criterion: Criterion, people: People
) -> None:
    """Have the policy that waits for approval judged; it or the one before it stays."""
    file = round.candidate / POLICY_NAME
    if round.policy.exists() or not file.exists():
        return
    new, old = load_policy(file), load_policy(round.before.policy)
    _record(cfg, round, dataset, (new, old), people)
    with dataset.answers() as store:
        if not store.pairs(round=round.number):
            store.add_pairs(_pairs(cfg, round, dataset, new, old))
        count = len(store.pairs(round=round.number))
    answered(cfg, round, dataset, criterion, Patience(people), count, last=True)
    verdict = _verdict(round, dataset, new)
    shown = f"{verdict.for_new} of {verdict.for_new + verdict.for_old} answers"
    stays = "it stays" if verdict.approved else "the one before it stays"
    console.print(
        f"round {round.number}: shown beside the policy before it, the new one is "
        f"preferred in {shown}: {stays}"
    )
    found = {**asdict(verdict), "odds": verdict.odds, "approved": verdict.approved}
    write_atomically(round.approval, json.dumps(found, indent=1).encode())
    if verdict.approved:
        replace_directory(round.candidate, round.policy.parent)
        return
    partial = round.root / "policy.partial"
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir()
    write_atomically(partial / POLICY_NAME, round.before.policy.read_bytes())
    replace_directory(partial, round.policy.parent)


def _record(
    cfg: LoopCfg,
    round: Round,
    dataset: Dataset,
    policies: tuple[Policy, Policy],
    people: People,
) -> None:
    """Log both policies as they would be used, from equal starts."""
    if round.recorded.exists():
        return
    people.tell(f"{place_of(cfg, round)}: recording what the new policy does")
    plain = replace(
        cfg.record,
        episodes=_EPISODES,
        noisy_share=0.0,
        variation=VariationCfg(),
        babble_share=0.0,
    )
    entries = dataset.add_episodes(
        episode
        for policy in policies
        for episode in record(
            round.before.policy,
            plain,
            seed=seed_of(cfg, round.number, 2),
            round=round.number,
            policies=[policy],
        )
    )
    names = sorted(entry.sha256 for entry in entries)
    write_atomically(round.recorded, json.dumps(names, indent=0).encode())


def _pairs(
    cfg: LoopCfg, round: Round, dataset: Dataset, new: Policy, old: Policy
) -> list[Pair]:
    """Pairs of the two policies under every recorded command in turn.

    Both clips of a pair begin as near to the same step as the episodes allow.
    """
    names = set(json.loads(round.recorded.read_text()))
    entries = {e.sha256: e for e in dataset.entries() if e.sha256 in names}
    rng = np.random.default_rng(seed_of(cfg, round.number, 3))
    by_command: dict[tuple[float, ...], list[Pair]] = {}
    clips = clips_of(_of(entries, new), cfg.clips)
    for index in rng.permutation(len(clips)):
        clip, meta = clips[index], entries[clips[index].rollout].meta
        alike = [e for e in _of(entries, old) if e.meta.env_index == meta.env_index]
        others = clips_of(alike, cfg.clips)
        if not others:
            continue
        beside = min(others, key=lambda other: abs(other.start - clip.start))
        sides = (clip, beside) if rng.random() < 0.5 else (beside, clip)
        pair = Pair.make(*sides, strategy=STRATEGY, round=round.number)
        by_command.setdefault(meta.command, []).append(pair)
    turns = zip_longest(*by_command.values())
    drawn = [pair for turn in turns for pair in turn if pair is not None]
    kept = labels_kept(cfg, round.run, dataset)
    reach_s = cfg.clips.stride_s / 2
    return [
        in_step(pair, entries, dataset.clip_features, reach_s=reach_s)
        for pair in drawn[:kept]
    ]


def _of(entries: dict[str, EpisodeEntry], policy: Policy) -> list[EpisodeEntry]:
    return [e for e in entries.values() if e.meta.policy_sha256 == policy.sha256]


def _verdict(round: Round, dataset: Dataset, new: Policy) -> Verdict:
    by_sha256 = {entry.sha256: entry for entry in dataset.entries()}
    votes = {True: 0, False: 0}
    with dataset.answers() as store:
        for pair, answer in store.current_answers(round=round.number):
            if answer.choice in ("a", "b"):
                clip = pair.a if answer.choice == "a" else pair.b
                meta = by_sha256[clip.rollout].meta
                votes[meta.policy_sha256 == new.sha256] += 1
    cfg = load_reward(round.before.reward).provenance.cfg
    return Verdict(
        for_new=votes[True], for_old=votes[False], error_share=cfg.error_share
    )
