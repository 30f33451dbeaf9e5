"""What the pages say can be typed: commands parse, Python runs, files are there."""

from __future__ import annotations

import ast
import re
import shlex
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from gaitpref.cli.main import parse

ROOT = Path(__file__).resolve().parents[2]
PAGES = (
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(path for path in (ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "how-to").glob("*.md")),
)
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"`([\w./]+\.(?:py|toml|sql|pyi))`")
ORDER = re.compile(r"^ *(?:\$ )?(gaitpref .*)$", re.MULTILINE)
FOLDERS = ("data", "rewardmodel", "policy", "labeling_ui", "gaitpref", "benchmarks")
STORED = ROOT / "tests" / "stored" / "run_of_one_room.tar.xz"
WHOLE = {"README.md", "quickstart.md", "concepts.md"}
MADE = {"motion.py", "robot.toml", "go2.toml", "hints.toml", "spot.toml"}
"""Names of files that are the reader's own."""


def blocks(language: str) -> Iterator[tuple[str, str]]:
    """Name of the page and text of each block of a language."""
    for page in PAGES:
        for found in BLOCK.finditer(page.read_text()):
            if found[1] == language:
                yield page.name, found[2]


def orders() -> Iterator[tuple[str, str]]:
    """Name of the page and each command a reader could type."""
    for page in PAGES:
        text = page.read_text()
        for found in BLOCK.finditer(text):
            if found[1] in ("", "sh", "bash"):
                joined = re.sub(r"\\\n *", "", found[2])
                for order in ORDER.findall(joined):
                    yield page.name, order


@pytest.mark.parametrize(("page", "order"), sorted(set(orders())))
def test_a_command_of_a_page_is_one_there_is(page: str, order: str) -> None:
    # What stands in brackets may be left out, and so may be given.
    words = shlex.split(re.sub(r"[][]", "", order), comments=True)[1:]
    end = {"&", "&&", "|", ">", "<", ";"}
    cut = next((i for i, word in enumerate(words) if word in end), len(words))
    if "--help" in words[:cut] or "--version" in words[:cut]:
        with pytest.raises(SystemExit) as left:
            parse(words[:cut])
        assert not left.value.code
    else:
        assert parse(words[:cut])


def test_the_python_of_a_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a directory with a finished run, as the page left it. Of a block that uses
    what only the reader has, what it imports."""
    with tarfile.open(STORED) as archive:
        archive.extractall(tmp_path / "runs" / "demo", filter="data")
    monkeypatch.chdir(tmp_path)
    seen = list(blocks("python"))
    assert seen
    for page, text in seen:
        tree = ast.parse(text, page)
        if page not in WHOLE:
            tree.body = [
                n for n in tree.body if isinstance(n, ast.Import | ast.ImportFrom)
            ]
        exec(compile(tree, page, "exec"), {"__name__": "page"})


def test_a_file_that_a_page_names_is_there() -> None:
    here = [
        path.relative_to(ROOT).as_posix()
        for folder in (*FOLDERS, "tests", "examples", "docs")
        for path in (ROOT / folder).rglob("*")
    ] + [path.name for path in ROOT.iterdir()]
    missing = {
        (page.name, name)
        for page in PAGES
        if page.name != "tried.md"
        for name in FILE.findall(page.read_text())
        if name not in MADE
        and not any(f"/{path}".endswith(f"/{name}") for path in here)
    }
    assert missing == set()
