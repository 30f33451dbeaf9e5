"""`gaitpref raters`, and that a labeler's machine needs no torch."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from labeling_ui.web.tokens import TokenStore
from rewardmodel.answers.answered_pairs import load_pairs
from tests.helpers.answered_sets import fill, gaits
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


def test_the_owner_says_who_teaches_and_what_is_known(
    root: Path, capsys: Output
) -> None:
    """Each in one line, which the other commands go by."""
    assert raters(root, "leave-out", "ada") == 0
    said = "the 2 answers of ada are kept and teach nothing, from the next fit on\n"
    assert capsys.readouterr().out == said
    assert raters(root, "take-in", "ada") == 0
    assert capsys.readouterr().out == "the 2 answers of ada teach again\n"
    assert raters(root, "gold") == 0
    assert "no answer is known" in capsys.readouterr().out
    with Dataset.open(root).answers() as store:
        first = store.pairs()[0].pair_id
    assert raters(root, "gold", first[:8], "--known", "a") == 0
    assert "it measures raters, teaches nothing" in capsys.readouterr().out
    assert raters(root, "gold") == 0
    shown = capsys.readouterr()
    assert "  B is better, as the owner says so; nobody was asked yet\n" in shown.out
    assert "--out known.gif` shows it" in shown.out + shown.err
    assert raters(root, "gold", "--json") == 0
    (told,) = json.loads(capsys.readouterr().out)["known"]
    assert (told["known"], told["given"]) == ("b", {"hits": 0, "of": 0})
    assert raters(root, "gold", told["pair_id"][:9], "--withdraw") == 0
    assert "is asked no more and measures nobody" in capsys.readouterr().out
    assert raters(root, "gold") == 0
    assert "  withdrawn: it is asked no more\n" in capsys.readouterr().out


def test_a_fit_says_who_was_left_out(tmp_path: Path, capsys: Output) -> None:
    """It learns from the others alone, as if nobody else had answered."""
    dataset = gaits(tmp_path / "set", 30)
    fill(dataset, "ann", lambda n, likes_a, side: "a" if likes_a else "b")
    alone = load_pairs([dataset]).answers_sha256
    fill(dataset, "bob", lambda n, likes_a, side: "a")
    assert load_pairs([dataset]).answers_sha256 != alone
    assert raters(dataset.root, "leave-out", "bob") == 0
    assert load_pairs([dataset]).answers_sha256 == alone
    fit = ["fit", "--dataset", str(dataset.root), "--out", str(tmp_path / "fit")]
    assert main(fit) == 0
    said = "answers: the 30 of bob are left out, as the owner says\n"
    assert said in capsys.readouterr().err
    assert main([*fit, "--for", "bob"]) == 2
    assert "take-in bob` takes them in again" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["add"], "gaitpref: whom?"),
        (["leave-out", "eve"], "there is no rater 'eve'; there are ada, bob"),
        (["gold", "ff"], "which answer to ff is known?"),
        (["gold", "zz", "--known", "a"], "0 of 2 pairs begin with 'zz'"),
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
