"""What the pages say can be typed: commands parse, Python runs, files are there."""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from gaitpref.cli.main import parse
from tests.helpers.older_run import older_run

ROOT = Path(__file__).resolve().parents[2]
PAGES = (
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
)
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"`([\w./]+\.(?:py|toml|sql|pyi))`")
PAGE = re.compile(r"\bdocs/[\w./-]+\.md\b")
ORDER = re.compile(r"^ *(?:\$ )?(gaitpref .*)$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")
PROGRAM = re.compile(r"python -m (benchmarks|studies|examples)\.([a-z]\w*)")
PACKAGES = ("data", "rewardmodel", "policy", "labeling_ui", "gaitpref")
FOLDERS = (*PACKAGES, "benchmarks", "studies", "tests", "examples", "docs")
WHOLE = {"README.md", "quickstart.md", "concepts.md"}
MADE = {"looker.py", "scene.toml", "walk.toml", "wish.py"}
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


def test_a_benchmark_or_study_that_a_page_names_is_there() -> None:
    named = [
        (page.name, *found)
        for page in PAGES
        for found in PROGRAM.findall(page.read_text())
    ]
    assert named
    assert [
        each for each in named if not (ROOT / each[1] / f"{each[2]}.py").exists()
    ] == []


def test_the_python_of_a_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a directory with a finished run, as the page left it. Of a block that uses
    what only the reader has, what it imports."""
    older_run(tmp_path / "runs" / "demo")
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


def test_a_link_beside_the_site_leads_somewhere() -> None:
    """Those of the site are looked at when it is built."""
    dead = {
        (name, link)
        for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
        for link in LINK.findall((ROOT / name).read_text())
        if not (ROOT / link).exists()
    }
    assert dead == set()


def test_a_how_to_is_read_in_two_minutes() -> None:
    words = {
        page.name: len(page.read_text().split())
        for page in (ROOT / "docs" / "how-to").glob("*.md")
    }
    assert words
    # Two of them are tables.
    most = {"own-policy.md": 600, "measure.md": 500}
    long = {name for name, count in words.items() if count > most.get(name, 400)}
    assert long == set()


def test_the_method_is_read_in_ten_minutes() -> None:
    """Lines of tables counted without their bars."""
    text = (ROOT / "docs/method.md").read_text()
    assert 1000 < len(text.replace("|", " ").split()) <= 2000


def test_a_page_that_the_code_names_is_there() -> None:
    named = {
        (path.relative_to(ROOT).as_posix(), name)
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*.py")
        for name in PAGE.findall(path.read_text())
    }
    assert named
    assert {each for each in named if not (ROOT / each[1]).is_file()} == set()


def test_a_file_that_a_page_names_is_there() -> None:
    here = [
        path.relative_to(ROOT).as_posix()
        for folder in FOLDERS
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
