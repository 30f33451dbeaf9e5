"""Policies recorded alike, and questions about two of them under the same command."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.answers.answer_records import Pair
from data.answers.curation import answers_heard
from data.answers.strategy_names import ARENA
from data.datasets.dataset import Dataset, EpisodeEntry
from data.episodes.clips import Clip
from data.errors import GaitprefError
from data.files.telling import Tell, one_of, silent
from policy.rollouts.record import record
from policy.rollouts.record_cfg import RecordCfg
from policy.training.checkpoint import load_policy
from rewardmodel.asking.clip_questions import ClipCfg, clips_of

from .strengths import Match


@dataclass(frozen=True, kw_only=True)
class Player:
    """A policy in an arena.

    Raises:
        GaitprefError: the file holds no policy.
    """

    name: str
    file: Path
    sha256: str

    @classmethod
    def of(cls, told: str) -> Player:
        """The player of NAME=FILE."""
        name, equals, file = told.partition("=")
        if not equals or not name or not file:
            raise GaitprefError(
                f"--policy takes NAME=FILE, as walk=runs/walk/policy.pt, got {told!r}"
            )
        return cls(name=name, file=Path(file), sha256=load_policy(Path(file)).sha256)


def players_of(told: Sequence[str]) -> tuple[Player, ...]:
    """All of them, each of another name and another policy.

    Raises:
        GaitprefError: there are less than two, or two are alike.
    """
    players = tuple(Player.of(each) for each in told)
    if len(players) < 2:
        raise GaitprefError(
            "an arena takes two policies or more: --policy a=FILE --policy b=FILE"
        )
    for what, values in (
        ("name", [player.name for player in players]),
        ("policy", [player.sha256 for player in players]),
    ):
        if len(set(values)) < len(values):
            raise GaitprefError(
                f"two players have the same {what}: "
                f"{', '.join(f'{p.name}={p.file}' for p in players)}"
            )
    return players


def record_alike(
    dataset: Dataset,
    players: Sequence[Player],
    *,
    episodes: int,
    seed: int,
    tell: Tell = silent,
) -> None:
    """Add episodes of each player that has none, without noise, from equal starts.

    `tell` gets the control steps that are done, of those of all.
    """
    there = {entry.meta.policy_sha256 for entry in dataset.entries()}
    cfg = RecordCfg(episodes=episodes, noisy_share=0.0)
    new = [player for player in players if player.sha256 not in there]
    dataset.add_episodes(
        episode
        for number, player in enumerate(new)
        for episode in record(
            player.file,
            cfg,
            seed=seed,
            policies=[load_policy(player.file)],
            tell=one_of(len(new), number, tell),
        )
    )


def questions(
    dataset: Dataset,
    first: Player,
    second: Player,
    known: Sequence[Pair],
    rng: np.random.Generator,
) -> Iterator[Pair]:
    """Pairs of clips of both, at the same time of the same command, that nobody was
    asked about."""
    entries = dataset.entries()
    asked = {frozenset((pair.a, pair.b)) for pair in known}
    both = [
        {
            (e.meta.env_index, e.meta.command, clip.start): clip
            for e, clip in _clips(entries, player)
        }
        for player in (first, second)
    ]
    shared = sorted(both[0].keys() & both[1].keys())
    for number in rng.permutation(len(shared)):
        sides = [clips[shared[number]] for clips in both]
        if frozenset(sides) not in asked:
            a, b = sides if rng.random() < 0.5 else sides[::-1]
            yield Pair.make(a, b, strategy=ARENA, round=0)


def _clips(
    entries: Sequence[EpisodeEntry], player: Player
) -> Iterator[tuple[EpisodeEntry, Clip]]:
    own = [e for e in entries if e.meta.policy_sha256 == player.sha256]
    by_hash = {entry.sha256: entry for entry in own}
    for clip in clips_of(own, ClipCfg()):
        yield by_hash[clip.rollout], clip


@dataclass(frozen=True, kw_only=True)
class Answered:
    """A match, and who said so about what."""

    match: Match
    rater: str
    command: tuple[float, ...]
    note: str


def answered(dataset: Dataset, players: Sequence[Player]) -> list[Answered]:
    """What was answered about any two of the players; skips and bad clips are none."""
    numbers = {player.sha256: number for number, player in enumerate(players)}
    entries = {entry.sha256: entry for entry in dataset.entries()}
    with dataset.answers() as store:
        given = answers_heard(store)
    found = []
    for pair, answer in given:
        a, b = (entries.get(clip.rollout) for clip in (pair.a, pair.b))
        score = {"a": 1.0, "b": 0.0, "equal": 0.5}.get(answer.choice)
        if pair.strategy != ARENA or score is None or a is None or b is None:
            continue
        first = numbers.get(a.meta.policy_sha256)
        second = numbers.get(b.meta.policy_sha256)
        if first is None or second is None:
            continue
        match = Match(first=first, second=second, score=score, question=pair.pair_id)
        found.append(
            Answered(
                match=match,
                rater=answer.rater_id,
                command=tuple(a.meta.command),
                note=answer.note,
            )
        )
    return found
