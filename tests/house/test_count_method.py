"""What counts as a setting, a constant, a question and a line of code."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.count_method import count, modules_of, table

SOURCES = {
    "rewardmodel/cfg.py": '''
"""Settings."""
from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True)
class MembersCfg:
    """Shared."""

    num_members: int = 3
    """Members."""


@dataclass(frozen=True)
class LinearCfg(MembersCfg):
    REMOVED: ClassVar = ("old",)
    precision: float = 1.0


@dataclass(frozen=True)
class FitCfg:
    kind: str = "linear"
    linear: LinearCfg = LinearCfg()
    extra: "int | None" = None
''',
    "rewardmodel/extensions/rules.py": '''
_STEPS = (1, -2.5, 60 * 60)
SURE, USED = 0.5, True
LIKED: int = 4
NAMES = {"a": 1}
lower = 7
FEW_ERRORS = 0.1


def paid(cfg, model, scorer):  # Two lines of code, and one after this comment.
    """Docstring."""
    if cfg.kind == "linear" and cfg.error_share > FEW_ERRORS:

        return isinstance(scorer, (LinearScorer, Other))
    noisy = context.noisy
    return takes_to_err(cfg), isinstance(cfg, Other), message.kind == "x"


match cfg.kind:
    case _:
        pass
''',
    "gaitpref/method/cfg.py": """
from dataclasses import dataclass

from rewardmodel.cfg import FitCfg


@dataclass
class Short:
    steps: int
    share: float


@dataclass
class Long:
    steps: int


Start = Short | Long


@dataclass
class Method:
    start: Start
    fit: FitCfg | None
    weight: float
""",
    "gaitpref/other.py": "class Short:\n    unlike: int\n",
}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    for name, text in SOURCES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def test_settings_are_followed_through_bases_unions_and_aliases(checkout: Path) -> None:
    settings = count(checkout)["settings"]
    assert settings["FitCfg"] == {"fields": 3, "leaves": 4}
    # Both starts, the fit's four, and the weight.
    assert settings["Method"] == {"fields": 3, "leaves": 3 + 4 + 1}
    assert settings["LoopCfg"] is None


def test_constants_questions_and_lines(checkout: Path) -> None:
    found = count(checkout)["rewardmodel"]
    assert found["numbers_in_constants"] == 3 + 1 + 1 + 1
    assert found["asks_whether_answers_err"] == 2
    assert found["reads_whether_answers_err"] == 1
    assert found["isinstance_of_a_scorer"] == 1
    assert found["comparisons_of_kind"] == 2
    assert found["modules"] == 2
    assert found["code_lines_of_extensions"] == 6 + 5 + 3
    assert found["code_lines"] == 14 + 2 + 3 + 4 + 5
    lines = [len(SOURCES[name].splitlines()) for name in SOURCES if "reward" in name]
    assert found["lines"] == sum(lines)


def test_two_checkouts_stand_side_by_side(checkout: Path) -> None:
    """Fields and what is under them, packages in a row; what there is not, has none."""
    found = count(checkout)
    none = {name: None for name in found["settings"]}
    told = table({"before": found, "after": found | {"settings": none}})
    assert told.startswith("|  | before | after |\n")
    own = found["settings"]["FitCfg"]
    assert (
        f"| settings of `FitCfg`, and under it | {own['fields']}, {own['leaves']} | - |"
        in told
    )
    assert (
        f"| numbers in constants | 0, 6, {found['policy']['numbers_in_constants']} |"
        in told
    )


def test_this_checkout_is_counted_from_the_command_line() -> None:
    command = [sys.executable, "-m", "benchmarks.count_method", "--json"]
    printed = subprocess.run(command, check=True, capture_output=True, text=True)
    found = json.loads(printed.stdout)
    assert found["settings"]["FitCfg"]["leaves"] > found["settings"]["FitCfg"]["fields"]
    assert found["policy"]["modules"] == len(modules_of(Path(), ("policy",)))
