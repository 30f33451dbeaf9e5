"""One token per rater: shown once, kept as a hash, revoked at any time.

The file lies in the data set and is readable by its owner only. It is read again when
it changes, so that a running server knows of a revocation at once.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import re
import secrets
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from data.datasets.dataset import LOCK_NAME
from data.errors import GaitprefError
from data.files.files import locked, read_file, write_atomically
from data.files.limits import NAME_CHARS, RATERS_BYTES

TOKENS_NAME = "raters.json"
_NAME = re.compile(rf"[A-Za-z0-9_-]{{1,{NAME_CHARS}}}")
_HEX_32_BYTES = re.compile(r"[0-9a-f]{64}")


class TokenError(GaitprefError):
    """A rater's token cannot be made, revoked or read."""


@dataclass(frozen=True)
class Token:
    """What is kept of a token."""

    sha256: str
    created_utc: str


class TokenStore:
    """The raters who may log in to the page of one data set; safe for threads."""

    def __init__(self, root: Path) -> None:
        """The tokens of the data set at `root`; there need not be any yet."""
        self.path = root / TOKENS_NAME
        self._mutex = threading.Lock()
        self._stamp: tuple[int, int, int] | None = None
        self._tokens: dict[str, Token] = {}
        self._key = b""

    def names(self) -> dict[str, Token]:
        """Raters with a token, in the order they were added.

        Raises:
            TokenError: the file is damaged.
        """
        return dict(self._read()[0])

    def add(self, name: str) -> str:
        """Make a token for a rater; this is the only time it is seen.

        Raises:
            TokenError: the name cannot be used, or has a token already.
        """
        require_name(name)
        with self._locked():
            tokens, key = self._read()
            if name in tokens:
                raise TokenError(
                    f"{name} has a token already; `gaitpref raters --dataset "
                    f"{self.path.parent} revoke {name}` makes room for a new one"
                )
            token = secrets.token_urlsafe(24)
            created = datetime.now(UTC).isoformat(timespec="seconds")
            added = {name: Token(_sha256(token), created)}
            self._write(tokens | added, key or secrets.token_bytes(32))
        return token

    def revoke(self, name: str) -> None:
        """Make a rater's token worthless; whoever is logged in with it is thrown out.

        Raises:
            TokenError: the rater has none.
        """
        with self._locked():
            tokens, key = self._read()
            if name not in tokens:
                known = ", ".join(tokens) or "nobody"
                raise TokenError(f"{name!r} has no token; these have: {known}")
            rest = {other: token for other, token in tokens.items() if other != name}
            self._write(rest, key)

    def rater_of(self, token: str) -> str | None:
        """Who has this token; takes the same time for every wrong one."""
        given = _sha256(token)
        found = None
        for name, known in self._read()[0].items():
            if hmac.compare_digest(given, known.sha256):
                found = name
        return found

    def signature(self, name: str, text: str) -> str | None:
        """Signs `text` for a rater; None without a token.

        It changes with the token: what was signed before a revocation is worthless.
        """
        tokens, key = self._read()
        if name not in tokens:
            return None
        message = "\n".join((name, tokens[name].sha256, text))
        return hmac.new(key, message.encode(), hashlib.sha256).hexdigest()

    def is_signed(self, name: str, text: str, signature: str) -> bool:
        """Whether this text was signed for a rater who still has the same token."""
        expected = self.signature(name, text)
        if expected is None:
            return False
        return hmac.compare_digest(expected.encode(), signature.encode())

    def _read(self) -> tuple[dict[str, Token], bytes]:
        with self._mutex:
            try:
                found = self.path.stat()
                stamp = (found.st_ino, found.st_size, found.st_mtime_ns)
                if stamp != self._stamp:
                    content = read_file(self.path, RATERS_BYTES)
                    self._tokens, self._key = _decoded(content)
                    self._stamp = stamp
            except FileNotFoundError:
                self._stamp, self._tokens, self._key = None, {}, b""
            except OSError as error:
                raise TokenError(
                    f"{self.path} cannot be read ({error.strerror or error}); let "
                    "whoever runs this read it"
                ) from None
            except (ValueError, RecursionError) as error:
                said = " ".join(str(error).split())[:120]
                raise TokenError(
                    f"{self.path} cannot be used ({said}); delete it and add the "
                    "raters again, their answers are kept elsewhere"
                ) from None
            return self._tokens, self._key

    def _write(self, tokens: dict[str, Token], key: bytes) -> None:
        raters = {name: asdict(token) for name, token in tokens.items()}
        content = json.dumps({"key": key.hex(), "raters": raters}, indent=1)
        write_atomically(self.path, content.encode(), mode=0o600)

    @contextmanager
    def _locked(self) -> Iterator[None]:
        with locked(self.path.parent / LOCK_NAME):
            yield


def require_name(name: str) -> None:
    """Make sure that a name can stand in a header, in a cookie and on the page.

    Raises:
        TokenError: it cannot.
    """
    if not _NAME.fullmatch(name):
        raise TokenError(
            f"{name!r} cannot be a rater's name; use 1 to {NAME_CHARS} of a-z, "
            "A-Z, 0-9, - and _, a pseudonym is best"
        )


def _decoded(content: bytes) -> tuple[dict[str, Token], bytes]:
    """Raters and the key of the signatures.

    Raises:
        ValueError, RecursionError: it is not what `_write` writes.
    """
    values = json.loads(content, object_pairs_hook=_unique)
    key, raters = _fields(values, "the file", "key", "raters")
    if not isinstance(key, str) or not _HEX_32_BYTES.fullmatch(key):
        raise ValueError("its key is not 64 hexadecimal digits")
    if not isinstance(raters, dict):
        raise ValueError("its raters are no object")
    tokens = {name: _token(name, entry) for name, entry in raters.items()}
    if len({token.sha256 for token in tokens.values()}) < len(tokens):
        raise ValueError("two raters have the same token")
    return tokens, bytes.fromhex(key)


def _token(name: str, entry: object) -> Token:
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name[:NAME_CHARS]!r} is no rater's name")
    created, sha256 = _fields(entry, f"rater {name}", "created_utc", "sha256")
    if not isinstance(sha256, str) or not _HEX_32_BYTES.fullmatch(sha256):
        raise ValueError(f"the token of {name} is not 64 hexadecimal digits")
    if not isinstance(created, str) or datetime.fromisoformat(created).tzinfo is None:
        raise ValueError(f"the token of {name} has no time in UTC")
    return Token(sha256, created)


def _fields(values: object, owner: str, *names: str) -> list[object]:
    """The values of an object that has these fields and no others."""
    if not isinstance(values, dict) or set(values) != set(names):
        raise ValueError(f"{owner} does not have the fields {' and '.join(names)}")
    return [values[name] for name in names]


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    values = dict(pairs)
    if len(values) < len(pairs):
        raise ValueError("a name is in it twice")
    return values


def _sha256(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
