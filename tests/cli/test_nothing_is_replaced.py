"""What a fit writes takes the place of an earlier fit, and of nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from data.datasets.dataset import Dataset
from gaitpref.cli.main import main


def contents(root: Path) -> dict[Path, bytes]:
    """Every file below `root`."""
    return {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}


@pytest.mark.parametrize("words", [["fit"], ["team", "fit"]])
@pytest.mark.parametrize("out", ["set", "."])
def test_a_data_set_stays(
    words: list[str],
    out: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Whoever types the data set after --out too has it still, and is told."""
    dataset = Dataset.create(tmp_path / "set")
    with dataset.answers() as store:
        store.add_rater("ann", "human")
    before = contents(dataset.root)
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--dataset", "set", "--out", out]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{out} holds " in line
    assert "would be replaced as a whole; give a directory that is new" in line
    assert contents(dataset.root) == before


def test_what_is_beside_a_reward_stays(tmp_path: Path) -> None:
    """An earlier reward is replaced; with a file of somebody else in it, it is not."""
    out = tmp_path / "reward"
    out.mkdir()
    (out / "reward.json").write_text("{}")
    (out / "notes.md").write_text("mine")
    (tmp_path / "set").mkdir()
    Dataset.create(tmp_path / "set")
    words = ["fit", "--dataset", str(tmp_path / "set"), "--out", str(out)]
    assert main(words) == 2
    assert (out / "notes.md").read_text() == "mine"
