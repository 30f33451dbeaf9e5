"""The two worked examples of the contributing page, done in a copy of the checkout."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(diff|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)
PACKAGES = ("benchmarks", "data", "gaitpref", "policy", "rewardmodel", "tests")
SMALL = """
import pytest
from tests.helpers.curves_of_reports import blank
from tests.helpers.few_evaluated import evaluate_few
evaluate_few(pytest.MonkeyPatch())
cfg = replace(
    cfg,
    evaluation_episodes=4,
    env=replace(cfg.env, episode_s=2.0),
    record=replace(cfg.record, episodes=40, episode_s=2.0),
)
with blank(): print("""
"""What stands in place of the last `print(`: fewer and shorter episodes, no curves."""


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy with both diffs of the page applied."""
    copy = tmp_path_factory.mktemp("checkout")
    for package in PACKAGES:
        left_out = shutil.ignore_patterns("__pycache__", "stored")
        shutil.copytree(ROOT / package, copy / package, ignore=left_out)
    for language, text in blocks():
        if language == "diff":
            # Who tries the page in the checkout itself has done this already.
            if git_apply(copy, text, "--reverse", "--check"):
                continue
            assert git_apply(copy, text)
    return copy


def git_apply(copy: Path, diff: str, *options: str) -> bool:
    """Apply a diff of two files; whether it could be."""
    assert diff.count("\n+++ ") == 2
    command = ["git", "apply", *options, "-"]
    return subprocess.run(command, cwd=copy, input=diff, text=True).returncode == 0


def blocks() -> list[tuple[str, str]]:
    found = BLOCK.findall((ROOT / "CONTRIBUTING.md").read_text())
    assert [language for language, _ in found] == ["diff", "diff", "python"]
    return found


def run(copy: Path, *arguments: str) -> str:
    """Python in the copy, which alone it imports from; what it printed."""
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=copy,
        env=os.environ | {"PYTHONPATH": str(copy)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def test_the_tests_in_the_examples_pass(changed: Path) -> None:
    tests = (
        "tests/rewardmodel/test_descriptors.py",
        "tests/gaitpref/test_method_exploration.py",
    )
    told = run(changed, "-m", "pytest", "-q", *tests, "-k", "splay or steady or hand")
    assert "3 passed" in told


def test_a_loop_runs_with_the_descriptor_and_the_decision(changed: Path) -> None:
    _, program = blocks()[-1]
    head, asked, tail = program.rpartition("print(")
    assert asked
    told = run(changed, "-c", head + SMALL + tail)
    assert "runs/steady/report/index.html" in told
    fitted = changed / "runs/steady/rounds/00/reward/reward.json"
    assert "splay_sq" in json.loads(fitted.read_text())["descriptors"]
    assert "class: Steady" in (changed / "runs/steady/config.yaml").read_text()
