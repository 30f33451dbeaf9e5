"""`gaitpref raters`, and that a labeler's machine needs no torch."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from labeling_ui.web.tokens import TokenStore
from tests.labeling_ui.test_figures import row


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A data set where ada answered twice and bob once."""
    dataset = Dataset.create(tmp_path / "set")
    with dataset.answers() as store:
        for name in ("ada", "bob"):
            store.add_rater(name, "human")
        store.add_rater("simulated", "scripted")
        for pair, answer in (
            row("ada", 0, 1.0),
            row("ada", 1, 1.0),
            row("bob", 0, 0.0),
        ):
            store.add_pairs([pair])
            store.add_answer(answer)
    return dataset.root


Output = pytest.CaptureFixture[str]


def raters(root: Path, *args: str) -> int:
    return main(["raters", "--dataset", str(root), *args])


def test_a_token_is_shown_once_and_works(root: Path, capsys: Output) -> None:
    """Then there is only its hash."""
    assert raters(root, "add", "ada") == 0
    token = capsys.readouterr().out.split()[0]
    assert TokenStore(root).rater_of(token) == "ada"
    assert raters(root, "add", "bob", "--url", "https://g.example.org/x/") == 0
    token_of_bob, said = capsys.readouterr().out.split(maxsplit=1)
    assert f"\nhttps://g.example.org/x/login#token={token_of_bob}\n" in said
    assert raters(root, "revoke", "bob") == 0
    assert raters(root) == 0
    shown = capsys.readouterr().out
    assert "2 answers" in shown
    assert token not in shown
    assert raters(root, "revoke", "ada") == 0
    assert TokenStore(root).rater_of(token) is None


def test_everything_is_there_as_json(root: Path, capsys: Output) -> None:
    """One object each."""
    assert raters(root, "add", "ada", "--json") == 0
    assert set(json.loads(capsys.readouterr().out)) == {"name", "token", "link"}
    assert raters(root, "list", "--json") == 0
    (listed,) = json.loads(capsys.readouterr().out)["raters"]
    assert (listed["name"], listed["answers"]) == ("ada", 2)
    assert raters(root, "stats", "--json") == 0
    stats = json.loads(capsys.readouterr().out)
    assert [of_rater["rater_id"] for of_rater in stats["raters"]] == ["ada", "bob"]
    assert stats["all"]["answers"] == 3
    assert stats["all"]["agreement"] == {"hits": 0, "of": 1, "share": 0.0}
    assert raters(root, "stats") == 0
    shown = capsys.readouterr().out
    for words in ("chosen", "agrees with", "Krippendorff's alpha; 1 is full"):
        assert words in shown


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["add"], "gaitpref: whom?"),
        (["revoke", "cy"], "'cy' has no token; these have: nobody"),
        (["add", "a b"], "cannot be a rater's name"),
        (["add", "simulated"], "is scripted, not human"),
    ],
)
def test_mistakes_are_one_line(
    root: Path, capsys: Output, args: list[str], message: str
) -> None:
    """With the exit code for bad input, and without a trace in the data set."""
    assert raters(root, *args) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not TokenStore(root).names()


def test_a_labelers_machine_needs_no_torch(root: Path) -> None:
    """Neither do the options of any command."""
    code = (
        "import sys; from gaitpref.cli.main import main; "
        f"main(['raters', '--dataset', {str(root)!r}]); "
        "sys.exit('torch' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
