"""Clips of choices as tables: what the fit of tables sees of episodes on a course.

Shapes: T steps of a clip, C columns of a choice row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from data.datasets.dataset import Dataset
from data.datasets.segments import Segments, TableAnswer
from data.episodes.choices import choices_of
from data.episodes.clips import Clip
from data.episodes.episode_records import Episode
from data.errors import GaitprefError
from policy.env.course import Lane
from policy.options.choice_row import choice_names, choice_rows
from rewardmodel.answers.used import Used

from .choice_sets import Asked, course_of


def rows_of_episode(episode: Episode, gaits: Sequence[str]) -> np.ndarray:
    """Choice rows [T, C] of an episode.

    Raises:
        GaitprefError: it is of no choices among `gaits`.
    """
    said = choices_of(episode.meta.extra, episode.num_steps)
    if said is None or set(said.names) - set(gaits):
        found = "none" if said is None else ", ".join(said.names)
        raise GaitprefError(
            f"an episode is of the gaits {found}, and those given are "
            f"{', '.join(gaits)}: record with a policy of `gaitpref options` that "
            "chooses among these"
        )
    gait = torch.tensor([gaits.index(name) for name in said.names])[
        torch.from_numpy(said.gait)
    ]
    lane = Lane(course_of(episode), torch.device("cpu"))
    # Where the model has the free joint first, as every robot on a course has.
    x = torch.from_numpy(episode.qpos[:, 0].copy())
    changed = torch.zeros(len(gait), dtype=torch.bool)
    changed[1:] = gait[1:] != gait[:-1]
    rows = choice_rows(
        torch.from_numpy(episode.features.copy()),
        lane.ahead(x[:-1].float(), torch.zeros(len(gait))),
        gait,
        changed,
        x.diff(),
        options=len(gaits),
        control_dt_s=episode.meta.control_dt_s,
    )
    return rows.numpy()


@dataclass(frozen=True, eq=False)
class ChoiceClips:
    """Clips of a data set as choice rows; every episode is read once."""

    dataset: Dataset
    gaits: tuple[str, ...]
    asked: Asked | None = None
    """Which robot on which course they must show; None takes any."""

    def segments(self, clips: Sequence[Clip]) -> Segments:
        """What was judged, in the order of `clips`.

        Raises:
            GaitprefError: an episode is of no choices among these gaits, or shows
                something else than is asked.
        """
        rows: dict[str, np.ndarray] = {}
        for clip in clips:
            if clip.rollout not in rows:
                episode = self.dataset.read(clip.rollout)
                rows[clip.rollout] = rows_of_episode(episode, self.gaits)
                if self.asked is not None:
                    self.asked.require(episode)
        longest = max(clip.steps for clip in clips)
        names = choice_names(self.gaits)
        table = np.full((len(clips), longest, len(names)), np.nan, dtype=np.float32)
        for at, clip in enumerate(clips):
            own = rows[clip.rollout][clip.rows]
            table[at, : len(own)] = own
        return Segments(ids=tuple(clip.key for clip in clips), names=names, rows=table)


def asked_about(
    used: Sequence[Used],
) -> tuple[list[Clip], list[TableAnswer]]:
    """The clips that answers are about, and the answers as a table has them."""
    place: dict[Clip, int] = {}
    found = []
    for each in used:
        sides = (each.pair.a, each.pair.b)
        left, right = (place.setdefault(clip, len(place)) for clip in sides)
        found.append(
            TableAnswer(left=left, right=right, target=each.target, rater=each.rater_id)
        )
    return list(place), found
