"""Hostile files, given to `gaitpref policy import`: one line says what is wrong."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gaitpref.cli.main import main

pytest.importorskip("onnx", reason="the extra onnx is not installed")

from tests.helpers.hostile_policies import ALONE, BESIDE, beside, env_yaml, write_onnx


@pytest.mark.parametrize("name", ALONE | BESIDE)
def test_a_hostile_policy_is_told_in_one_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No traceback, no gigabytes, no minutes."""
    make, told = (ALONE | BESIDE)[name]
    file = tmp_path / "run" / ("model_1.pt" if "normal" in name else "policy.onnx")
    file.parent.mkdir()
    make(file)
    command = ["policy", "import", str(file)]
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert told in lines[0]
    # The draft says it too, where it is only what lies beside the policy.
    explained = main([*command, "--explain"])
    said = capsys.readouterr()
    assert told in " ".join((said.out if explained == 0 else said.err).split())


def test_aliases_as_isaac_lab_writes_them_are_followed(tmp_path: Path) -> None:
    """What stands twice in a configuration is written once."""
    beside("env.yaml", "a: &id001 !!python/tuple [1]\nb: *id001\n" + env_yaml())(
        tmp_path / "policy.onnx"
    )
    assert main(["policy", "import", str(tmp_path / "policy.onnx"), "--explain"]) == 0


def test_without_the_package_an_onnx_is_refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It says which extra brings it."""
    write_onnx(tmp_path / "policy.onnx")
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert main(["policy", "import", str(tmp_path / "policy.onnx"), "--explain"]) == 2
    assert "pip install -e '.[onnx]'" in capsys.readouterr().err
