"""A package of an extra that is not installed: one line with the command that brings
it, before anything is begun."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gaitpref.cli.main import main
from tests.data.test_decay import make_dataset


@pytest.mark.parametrize(
    ("command", "modules", "extra"),
    [
        ("train --out {new} --reward task --actors 2", ("ray",), "scale"),
        ("sweep --out {new} --criterion high_step --ray local", ("ray",), "scale"),
        ("data push {set} {new}", ("fsspec", "fsspec.core"), "remote"),
    ],
    ids=["train", "sweep", "push"],
)
def test_it_is_told_with_its_extra(
    command: str,
    modules: tuple[str, ...],
    extra: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As on a machine without it: Python does not import a module that is None."""
    make_dataset(tmp_path / "set")
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)
    places = {"new": tmp_path / "new", "set": tmp_path / "set"}
    assert main([word.format(**places) for word in command.split()]) == 2
    line = capsys.readouterr().err.strip()
    assert modules[0] in line
    assert f"pip install -e '.[{extra}]' -c constraints.txt" in line
    assert "\n" not in line
    assert not (tmp_path / "new").exists()
