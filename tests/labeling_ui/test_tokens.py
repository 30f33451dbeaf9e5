"""Tokens of raters: shown once, kept as a hash, revoked at any time."""

import json
import os
import stat
from pathlib import Path

import pytest

from data.datasets.dataset import Dataset
from data.errors import GaitprefError
from data.files.limits import RATERS_BYTES
from gaitpref.cli.main import main
from labeling_ui.web.tokens import TokenError, TokenStore


@pytest.fixture
def tokens(tmp_path: Path) -> TokenStore:
    return TokenStore(tmp_path)


def test_a_token_names_its_rater(tokens: TokenStore) -> None:
    """And nobody else's does, nor a part of it."""
    ada, bob = tokens.add("ada"), tokens.add("bob")
    assert len(ada) >= 32
    assert (tokens.rater_of(ada), tokens.rater_of(bob)) == ("ada", "bob")
    for wrong in ("", ada[:-1], ada + "x", ada.swapcase(), "ä"):
        assert tokens.rater_of(wrong) is None
    assert list(tokens.names()) == ["ada", "bob"]


def test_the_file_holds_hashes_and_is_private(tokens: TokenStore) -> None:
    """Whoever reads a copy of it cannot log in as anybody."""
    token = tokens.add("ada")
    assert token not in tokens.path.read_text()
    tokens.add("bob")
    assert stat.S_IMODE(tokens.path.stat().st_mode) == 0o600


def test_a_revoked_token_is_worthless_at_once(tokens: TokenStore) -> None:
    """Also to a server that runs, and with all that was signed for it."""
    server = TokenStore(tokens.path.parent)
    token = tokens.add("ada")
    signature = server.signature("ada", "text")
    assert signature is not None
    assert server.is_signed("ada", "text", signature)
    assert not server.is_signed("ada", "other", signature)
    assert not server.is_signed("bob", "text", signature)
    tokens.revoke("ada")
    assert server.rater_of(token) is None
    assert server.signature("ada", "text") is None
    assert not server.is_signed("ada", "text", signature)
    tokens.add("ada")
    assert not server.is_signed("ada", "text", signature), "a new token is a new start"


def test_a_signature_survives_a_restart(tokens: TokenStore) -> None:
    """So that raters need not log in again."""
    tokens.add("ada")
    signature = tokens.signature("ada", "text")
    assert signature is not None
    assert TokenStore(tokens.path.parent).is_signed("ada", "text", signature)


def test_errors_say_what_to_do(tokens: TokenStore) -> None:
    """One line each."""
    tokens.add("ada")
    with pytest.raises(TokenError, match=r"ada has a token already; .* revoke ada"):
        tokens.add("ada")
    with pytest.raises(TokenError, match="'bob' has no token; these have: ada"):
        tokens.revoke("bob")
    for name in ("", "a b", "a.b", "ä", "x" * 41, "a\nb"):
        with pytest.raises(TokenError, match="cannot be a rater's name"):
            tokens.add(name)


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"raters": {"a": 1}, "key": ""}'])
def test_a_damaged_file_lets_nobody_in(tokens: TokenStore, content: str) -> None:
    """The message says what to do."""
    tokens.path.write_text(content)
    with pytest.raises(TokenError, match="delete it and add the raters again"):
        tokens.rater_of("")


KEY, HASH, TIME = "0" * 64, "1" * 64, "2030-01-31T12:00:00+00:00"


def written(key: object = KEY, raters: object = None, **more: object) -> str:
    """A file of tokens; as it should be where nothing is given."""
    known = {"ada": {"sha256": HASH, "created_utc": TIME}}
    return json.dumps({"key": key, "raters": raters or known} | more)


def entry(**changes: object) -> dict[str, object]:
    return {"sha256": HASH, "created_utc": TIME} | changes


WRONG = {
    "an empty key": written(""),
    "a short key": written("00"),
    "a key of spaces": written(" " * 64),
    "a key in other digits": written("٣" * 64),
    "a key that is a number": written(5),
    "no key": json.dumps({"raters": {}}),
    "another field": written(version=2),
    "raters in a list": written(raters=["ada"]),
    "a rater who is a text": written(raters={"ada": HASH}),
    "a field too many": written(raters={"ada": entry(admin=True)}),
    "a hash that is none": written(raters={"ada": entry(sha256="x")}),
    "a hash that is a number": written(raters={"ada": entry(sha256=1)}),
    "a hash in letters": written(raters={"ada": entry(sha256="ä" * 64)}),
    "a time that is none": written(raters={"ada": entry(created_utc="soon")}),
    "a time without an offset": written(raters={"ada": entry(created_utc=TIME[:19])}),
    "a time that is a number": written(raters={"ada": entry(created_utc=1)}),
    "an empty name": written(raters={"": entry()}),
    "a name with a dot": written(raters={"a.b": entry()}),
    "a name that draws": written(raters={"\x1b[31m": entry()}),
    "a name of two lines": written(raters={"a\nb": entry()}),
    "half a character": '{"key": "' + KEY + '", "raters": {"\\ud800": {}}}',
    "a long name": written(raters={"a" * 41: entry()}),
    "one token for two": written(raters={"ada": entry(), "bob": entry()}),
    "a name twice": written().replace('"ada": {', '"ada": {}, "ada": {'),
    "a key twice": written().replace('"key"', '"key": "", "key"', 1),
    "a deep hole": "[" * 100_000,
    "a deep rater": '{"key": ' + '{"a": ' * 50_000,
    "a long number": written().replace('"' + HASH + '"', "9" * 5000),
    "no text": "\x00\x01",
    "a list": "[]",
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_file_nobody_wrote_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    """By every command that reads it, in one line, and nobody is let in by it."""
    root = Dataset.create(tmp_path / "set").root
    tokens = TokenStore(root)
    tokens.path.write_text(WRONG[kind])
    for command in (
        ["raters", "--dataset", str(root), "list"],
        ["raters", "--dataset", str(root), "add", "bob"],
        ["raters", "--dataset", str(root), "revoke", "ada"],
        ["label", "--dataset", str(root), "--port", "0"],
    ):
        assert main(command) == 2
        said = capsys.readouterr().err
        assert "raters.json cannot be used (" in said
        assert "delete it and add the raters again" in said
        assert said.count("\n") == 1
        assert said.rstrip("\n").isprintable()
        assert len(said) < 500
    assert tokens.path.read_text() == WRONG[kind]


def test_the_file_as_it_should_be_is_taken(tokens: TokenStore) -> None:
    """Without this, all those would be refused for nothing."""
    tokens.path.write_text(written())
    assert list(tokens.names()) == ["ada"]


@pytest.mark.parametrize("kind", ["folder", "pipe", "book"])
def test_what_is_no_such_file_is_refused(tokens: TokenStore, kind: str) -> None:
    """And nobody waits for its end."""
    if kind == "book":
        tokens.path.write_text(written() + " " * RATERS_BYTES)
    else:
        (os.mkfifo if kind == "pipe" else os.mkdir)(tokens.path)
    wrong = "read up to" if kind == "book" else "where a file is wanted"
    with pytest.raises(GaitprefError, match=wrong):
        tokens.names()


def test_what_is_kept_of_a_token(tokens: TokenStore) -> None:
    """Its hash, and since when."""
    tokens.add("ada")
    kept = json.loads(tokens.path.read_text())["raters"]["ada"]
    assert set(kept) == {"sha256", "created_utc"}
