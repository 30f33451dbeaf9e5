"""Uni-RLHF's preference files: three lists, whose indices point into one flat array.

dataset.hdf5                          all episodes one behind the other, as D4RL
episodes.json                         which rows are which episode
indices_1_num_N_len_L.pkl             first row of the first clip of each query
indices_2_num_N_len_L.pkl             of the second
human_label_num_N_len_L.pkl           0: the first is better, 1: the second, -1: equal
"""

from __future__ import annotations

import bisect
import json
import operator
import pickle
import uuid
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from data.answers.answer_records import Answer, Choice, Pair, now_utc
from data.datasets.dataset import Dataset
from data.episodes.clips import Clip
from data.errors import DatasetError
from data.files.files import read_json

from .export_source import Exported, Source, new_directory
from .hdf5 import write_flat
from .pickles import load_integers

NAMESPACE = uuid.UUID("4f1d6c0e-8f0a-4a53-9f44-2a2f1f5f6f10")
_LABELS: dict[int, Choice] = {0: "a", 1: "b", -1: "equal"}
_EPISODES_NAME = "episodes.json"


def export_uni_rlhf(source: Source, out: Path) -> Exported:
    """Write the flat array and the queries; clips of another length are left out.

    A directory holds queries of one length: that which most answers are about.

    Raises:
        GaitprefError: `out` is there, an episode cannot be used, or h5py is missing.
    """
    used, without = source.preferences()
    offsets = source.offsets()
    here = [
        (pair, answer)
        for pair, answer in used
        if {pair.a.rollout, pair.b.rollout} <= set(offsets)
        and pair.a.steps == pair.b.steps
    ]
    lengths = Counter(pair.a.steps for pair, _ in here)
    length = lengths.most_common(1)[0][0] if lengths else 0
    here = [row for row in here if row[0].a.steps == length]
    lists: dict[str, list[int]] = {"indices_1": [], "indices_2": [], "human_label": []}
    for pair, answer in here:
        target = answer.target
        label = -1 if target == 0.5 else int((target or 0.0) < 0.5)
        lists["indices_1"].append(offsets[pair.a.rollout] + pair.a.start)
        lists["indices_2"].append(offsets[pair.b.rollout] + pair.b.start)
        lists["human_label"].append(label)
    with new_directory(source, out) as partial:
        write_flat(source, partial / "dataset.hdf5")
        rows = [
            {"sha256": e.sha256, "first_row": offsets[e.sha256], "steps": e.num_steps}
            for e in source.entries
        ]
        (partial / _EPISODES_NAME).write_text(json.dumps(rows, indent=0))
        for name, values in lists.items():
            path = partial / f"{name}_num_{len(here)}_len_{length}.pkl"
            path.write_bytes(pickle.dumps(values, protocol=2))
    return Exported(
        out=str(out),
        episodes=len(source.entries),
        steps=source.steps,
        preferences=len(here),
        left_out_episodes=source.left_out,
        left_out_answers=without + len(used) - len(here),
    )


def import_uni_rlhf(dataset: Dataset, directory: Path, rater_id: str) -> int:
    """Add the answers of a directory that `export_uni_rlhf` made; gives how many.

    Labels may be of others by now; the episodes must be in `dataset`. Importing again
    adds nothing.

    Raises:
        DatasetError: a file is missing, damaged, or about other episodes.
    """
    try:
        episodes = read_json(directory / _EPISODES_NAME)
    except OSError as error:
        raise DatasetError(
            f"{directory / _EPISODES_NAME} cannot be read ({error}); without it nobody "
            "knows which episodes the indices mean. `gaitpref data export --format "
            "uni-rlhf` writes it"
        ) from None
    left, right, labels, length = _queries(directory)
    known = {entry.sha256: entry.num_steps for entry in dataset.entries()}
    spans = _spans(episodes, known, directory / _EPISODES_NAME)
    rows: list[tuple[Pair, Answer]] = []
    for number, (a, b, label) in enumerate(zip(left, right, labels, strict=True)):
        clips = [_clip(spans, row, length) for row in (a, b)]
        pair = Pair.make(clips[0], clips[1], strategy="uni-rlhf", round=0)
        if label not in _LABELS:
            raise DatasetError(f"{directory}: label {label} is none of 0, 1 and -1")
        rows.append((pair, imported_answer(pair, rater_id, number, _LABELS[label])))
    return add_answers(dataset, rater_id, rows)


def imported_answer(pair: Pair, rater_id: str, number: int, choice: Choice) -> Answer:
    """An answer whose id follows from what it says: a second import adds none."""
    text = f"{pair.pair_id} {rater_id} {number} {choice}"
    return Answer(
        answer_id=str(uuid.uuid5(NAMESPACE, text)),
        pair_id=pair.pair_id,
        rater_id=rater_id,
        choice=choice,
        shown_left="a",
        note="imported",
        created_utc=now_utc(),
    )


def add_answers(
    dataset: Dataset, rater_id: str, rows: list[tuple[Pair, Answer]]
) -> int:
    """Add pairs and those answers that are not there; gives how many."""
    with dataset.answers() as store, store.transaction():
        # Nobody knows who they were, and they are no function either.
        store.add_rater(rater_id, "human")
        store.add_pairs(pair for pair, _ in rows)
        new = [a for _, a in rows if store.find_answer(a.answer_id) is None]
        for answer in new:
            store.add_answer(answer)
    return len(new)


def _queries(directory: Path) -> tuple[list[int], list[int], list[int], int]:
    """First rows of both clips, labels and the length of the clips."""
    lists: list[list[int]] = []
    lengths: set[str] = set()
    for name in ("indices_1", "indices_2", "human_label"):
        files = sorted(directory.glob(f"{name}_*len_*.pk*"))
        if len(files) != 1:
            raise DatasetError(
                f"{directory} has {len(files)} files {name}_num_N_len_L.pkl, it needs 1"
            )
        lengths.add(files[0].stem.rpartition("len_")[2].partition("_")[0])
        lists.append(load_integers(files[0]))
    if len({len(values) for values in lists}) != 1 or len(lengths) != 1:
        raise DatasetError(f"{directory}: its three lists do not belong together")
    text = lengths.pop()
    if not text.isdecimal() or int(text) < 1:
        raise DatasetError(f"{directory}: no clip has a length of {text!r} steps")
    return lists[0], lists[1], lists[2], int(text)


def _spans(
    episodes: Any, known: Mapping[str, int], path: Path
) -> list[tuple[int, int, str]]:
    """First row, number of steps and hash of every episode, in the order of rows.

    Raises:
        DatasetError: the file is not what an export writes; an episode that is not in
            the data set has no steps.
    """
    try:
        return sorted(
            (
                operator.index(episode["first_row"]),
                known.get(episode["sha256"], 0),
                str(episode["sha256"]),
            )
            for episode in episodes
        )
    except (TypeError, LookupError) as error:
        raise DatasetError(
            f"{path} does not list episodes as `gaitpref data export --format "
            f"uni-rlhf` does ({type(error).__name__}: {error}); get it again"
        ) from None


def _clip(spans: list[tuple[int, int, str]], row: int, length: int) -> Clip:
    place = bisect.bisect_right(spans, row, key=lambda span: span[0]) - 1
    if row < 0 or place < 0:
        raise DatasetError(f"no episode has row {row}")
    first_row, num_steps, sha256 = spans[place]
    start = row - first_row
    if start + length > num_steps:
        raise DatasetError(
            f"the clip of {length} steps at row {row} is in no episode of this data set"
        )
    return Clip(sha256, start, length)
