"""What is exported of a data set, and the directory it is written to.

Shapes: T steps of an episode, F columns of the feature row.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.answers.answer_records import Answer, Pair
from data.datasets.dataset import Dataset, EpisodeEntry
from data.datasets.manifest_file import writable
from data.episodes.episode import Episode
from data.episodes.model_store import ModelStore
from data.errors import DatasetError
from data.files.files import replace_directory
from data.files.telling import Tell, silent


@dataclass(frozen=True)
class Exported:
    """What was written, and what the format has no place for."""

    out: str
    episodes: int
    steps: int
    preferences: int
    left_out_episodes: int
    """Aborted ones, and those without observations or actions, as from hardware."""
    left_out_answers: int
    """Answers that prefer nothing and are no tie, or whose clips the format cannot
    hold."""


@dataclass(frozen=True, eq=False)
class Source:
    """The episodes of a data set that other projects can learn from."""

    dataset: Dataset
    entries: tuple[EpisodeEntry, ...]
    left_out: int
    tell: Tell = silent
    """Gets how many of them are read, or preferences where the format holds these."""

    @staticmethod
    def of(
        dataset: Dataset, *, with_actions: bool = True, tell: Tell = silent
    ) -> Source:
        """Look for episodes that are whole, with observations and actions.

        Args:
            dataset: Where to look.
            with_actions: Hardware often does not tell them; False takes it anyway.
            tell: Gets how far an export is.

        Raises:
            DatasetError: there is none.
        """
        every = dataset.entries()
        entries = tuple(
            entry
            for entry in every
            if entry.end_reason != "aborted"
            and not (with_actions and _has_no_action(entry))
        )
        if not entries:
            raise DatasetError(
                f"none of the {len(every)} episodes of {dataset.root} has observations "
                "and actions and was not aborted; there is nothing to export"
            )
        return Source(dataset, entries, len(every) - len(entries), tell)

    @property
    def steps(self) -> int:
        """Control steps of all episodes."""
        return sum(entry.num_steps for entry in self.entries)

    @property
    def control_hz(self) -> float:
        """The control rate, which must be one.

        Raises:
            DatasetError: episodes differ in it.
        """
        rates = {round(1 / entry.meta.control_dt_s, 6) for entry in self.entries}
        if len(rates) != 1:
            raise DatasetError(
                f"this format holds one control rate, the episodes have "
                f"{sorted(rates)} Hz; make a subset of one"
            )
        return rates.pop()

    def episodes(self) -> Iterator[Episode]:
        """Every episode, in the order of `entries`."""
        for done, entry in enumerate(self.entries):
            self.tell(done, len(self.entries))
            episode = self.dataset.read(entry.sha256)
            if not (
                np.isfinite(episode.obs).all() and np.isfinite(episode.action).all()
            ):
                raise DatasetError(
                    f"episode {entry.sha256} holds observations or actions that are "
                    "not finite; leave it out with `gaitpref data subset`"
                )
            yield episode

    def offsets(self) -> dict[str, int]:
        """First row of each episode where all of them lie one behind the other."""
        found: dict[str, int] = {}
        row = 0
        for entry in self.entries:
            found[entry.sha256] = row
            row += entry.num_steps
        return found

    def put_models(self, folder: Path) -> None:
        """Copy the models that lie beside the episodes, of which no format has any."""
        for sha256 in sorted({entry.mjcf_sha256 for entry in self.entries} - {""}):
            ModelStore(folder).put(sha256, self.dataset.models.content(sha256))

    def preferences(self) -> tuple[list[tuple[Pair, Answer]], int]:
        """Answers with a target, in the order of pairs; and how many have none."""
        with self.dataset.answers_copy() as store:
            current = store.current_answers()
        used = [row for row in current if row[1].target is not None]
        return used, len(current) - len(used)


def _has_no_action(entry: EpisodeEntry) -> bool:
    return "action" in entry.meta.extra.get("missing_features", "").split()


@contextmanager
def new_directory(source: Source, out: Path) -> Iterator[Path]:
    """A directory that gets its name when the block ends, and is gone if it fails.

    Models of robots that lie beside the episodes of `source` go along.

    Raises:
        DatasetError: `out` is there already, or cannot be written.
    """
    if out.exists():
        raise DatasetError(f"{out} is there already; give another --out")
    partial = out.with_name(f".{out.name}.{secrets.token_hex(8)}.tmp")
    with writable(out.parent):
        try:
            partial.mkdir(parents=True)
            yield partial
            source.put_models(partial)
            replace_directory(partial, out)
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def task_text(entry: EpisodeEntry) -> str:
    """What the robot was asked for, in words."""
    forward, left, yaw = entry.meta.command
    return (
        f"{entry.meta.task}: {forward:g} m/s ahead, {left:g} m/s to the left, "
        f"{yaw:g} rad/s"
    )
