"""Tokens of raters: shown once, kept as a hash, revoked at any time."""

import json
import stat
from pathlib import Path

import pytest

from labeling_ui.tokens import TokenError, TokenStore


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


def test_what_is_kept_of_a_token(tokens: TokenStore) -> None:
    """Its hash, and since when."""
    tokens.add("ada")
    kept = json.loads(tokens.path.read_text())["raters"]["ada"]
    assert set(kept) == {"sha256", "created_utc"}
