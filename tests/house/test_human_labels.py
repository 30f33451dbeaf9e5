"""Labels that others published, beside the network they fit: on made files."""

from __future__ import annotations

import pickle
from pathlib import Path

import h5py
import numpy as np
import pytest

from data.errors import GaitprefError
from studies.human_labels import HumanLabels, main
from studies.published_labels import labelled_segments, read_transitions

ROWS, STEPS, EPISODE, ANSWERS = 3000, 20, 100, 160


@pytest.fixture
def rows(tmp_path: Path) -> Path:
    """Episodes that drift slowly, so that segments differ; each runs out of time."""
    rng = np.random.default_rng(0)
    seen = np.repeat(rng.normal(size=(ROWS // STEPS, 3)), STEPS, axis=0)
    seen += 0.1 * rng.normal(size=seen.shape)
    timeouts = np.arange(ROWS) % EPISODE == EPISODE - 1
    with h5py.File(tmp_path / "made.hdf5", "w") as file:
        file["observations"] = seen.astype(np.float32)
        file["actions"] = rng.normal(size=(ROWS, 2)).astype(np.float32)
        file["timeouts"] = timeouts
    return tmp_path / "made.hdf5"


def write_labels(directory: Path, rows: Path, names: tuple[str, str, str]) -> Path:
    """Who judges likes what is seen first to be large; close ones are ties."""
    _, values = read_transitions(rows)
    rng = np.random.default_rng(1)
    first, second = rng.integers(0, len(values) - STEPS, size=(2, ANSWERS))
    worth = np.array([values[i : i + STEPS, 0].mean() for i in range(len(values))])
    lead = worth[first] - worth[second]
    label = np.where(np.abs(lead) < 0.2, -1, (lead < 0).astype(int))
    directory.mkdir()
    for name, content in zip(names, (first, second, label), strict=True):
        (directory / name).write_bytes(pickle.dumps(content))
    return directory


TRANSFORMER = ("indices_num160_q20", "indices_2_num160_q20", "label_human")
UNI_RLHF = tuple(
    f"{what}_domain_mujoco_env_hopper-medium-v2_num_160_len_20_1.pkl"
    for what in ("indices_1", "indices_2", "human_label")
)


@pytest.mark.parametrize("names", [TRANSFORMER, UNI_RLHF])
def test_both_layouts_say_the_same(
    tmp_path: Path, rows: Path, names: tuple[str, str, str]
) -> None:
    labels = write_labels(tmp_path / "labels", rows, names)
    (labels / "label_dummy").write_bytes(pickle.dumps([0]))
    segments, answers = labelled_segments(labels, rows)
    assert segments.rows.shape[1:] == (STEPS, 5)
    assert len(answers) == ANSWERS
    for answer in answers:
        lead = (
            segments.rows[answer.left, :, 0].mean()
            - segments.rows[answer.right, :, 0].mean()
        )
        assert answer.target == (0.5 if abs(lead) < 0.2 else float(lead > 0))


def test_rows_are_counted_without_the_last_of_an_episode(rows: Path) -> None:
    """As D4RL's transitions are, which the published indices count."""
    names, values = read_transitions(rows)
    assert names == ("seen 0", "seen 1", "seen 2", "done 0", "done 1")
    assert len(values) == ROWS - ROWS // EPISODE
    with h5py.File(rows) as file:
        seen = np.asarray(file["observations"])
    assert (values[EPISODE - 1, :3] == seen[EPISODE]).all()


def test_models_are_asked_about_the_same_answers(tmp_path: Path, rows: Path) -> None:
    labels = write_labels(tmp_path / "labels", rows, TRANSFORMER)
    ours, theirs = main(
        HumanLabels(labels=labels, rows=rows, kinds=("linear",), splits=2)
    )
    assert ours.model == "gaitpref linear"
    assert theirs.model == "Uni-RLHF MLP"
    assert ours.accuracy > 0.9
    assert theirs.accuracy > 0.7
    assert ours.ties_told > 0.8
    assert ours.log_loss < 0.4


@pytest.mark.parametrize(
    ("break_it", "told"),
    [
        (
            lambda labels, rows: rows.unlink(),
            "D4RL, d4rl/infos.*d4rl/locomotion .AntMaze",
        ),
        (lambda labels, rows: (labels / "label_human").unlink(), "0 lists of labels"),
        (
            lambda labels, rows: (labels / "label_human").write_bytes(
                pickle.dumps([0, 1])
            ),
            "2 labels of 160 first and 160 second",
        ),
        (
            lambda labels, rows: (labels / "label_human").write_bytes(
                pickle.dumps([7] * ANSWERS)
            ),
            "a label is 0, 1 or -1, got 7",
        ),
        (
            lambda labels, rows: (labels / "label_human").write_bytes(
                pickle.dumps(Path("x"))
            ),
            "could run code",
        ),
        (
            lambda labels, rows: (labels / "indices_num160_q20").write_bytes(
                pickle.dumps([ROWS] * ANSWERS)
            ),
            "it is of another task",
        ),
        (lambda labels, rows: rows.write_bytes(b"no HDF5"), "is no file of D4RL"),
    ],
)
def test_what_is_missing_or_damaged_is_named(
    tmp_path: Path, rows: Path, break_it, told: str
) -> None:
    labels = write_labels(tmp_path / "labels", rows, TRANSFORMER)
    break_it(labels, rows)
    with pytest.raises(GaitprefError, match=told.replace("(", r"\(")):
        labelled_segments(labels, rows)
