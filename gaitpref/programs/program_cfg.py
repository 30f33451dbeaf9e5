"""Which program answers: the settings, without anything heavy to import."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from urllib.parse import urlsplit

from data.errors import GaitprefError
from labeling_ui.web.checks import is_loopback

OPENAI = "openai:"
"""Before the address of a vision model."""
KEY_NAME = "GAITPREF_RATER_KEY"
"""Environment variable that holds the key of a vision model that asks for one."""
_WISH_CHARS = 2000


class ProgramError(GaitprefError):
    """A program cannot be asked, or says something that is no answer."""


def is_program(name: str) -> bool:
    """Whether `name` means a rater that is a program."""
    return name.startswith(OPENAI) or ":" in name


@dataclass(frozen=True, kw_only=True)
class ProgramCfg:
    """A rater that is a program.

    Raises:
        ProgramError: it cannot be one.
    """

    name: str
    """`package.module:function`, or `openai:` and the address of a vision model."""
    model: str = ""
    """Model that is asked there."""
    wish: str = ""
    """What a vision model is told to look for; empty: whichever walks better."""
    unchecked: bool = False
    """Whether its answers teach though nobody compared it with people."""
    checked_on: str | None = None
    """Data set in which it answered pairs that people answered too."""

    def __post_init__(self) -> None:
        if not is_program(self.name):
            raise ProgramError(
                f"--rater {self.name}: a program is package.module:function or "
                f"{OPENAI}http://127.0.0.1:PORT/v1"
            )
        if len(self.wish) > _WISH_CHARS:
            raise ProgramError(
                f"--wish has {len(self.wish):,} characters, {_WISH_CHARS:,} at most"
            )
        if self.url is None and (self.model or self.wish):
            raise ProgramError(
                f"--model and --wish are told to a vision model, and {self.name} is a "
                "function: leave them out"
            )
        if self.url is None and not all(self.name.split(":", 1)):
            raise ProgramError(
                f"--rater {self.name}: name a function as package.module:function"
            )
        if self.url is not None:
            if not self.model:
                raise ProgramError(
                    f"which model answers at {self.url}? --model NAME says it"
                )
            _require_url(self.url)

    @property
    def url(self) -> str | None:
        """Where a vision model is reached; None of a function."""
        if not self.name.startswith(OPENAI):
            return None
        return self.name.removeprefix(OPENAI).rstrip("/")

    @property
    def rater_id(self) -> str:
        """What it is called among raters; one told to look for something else, or
        another model, is another rater."""
        if self.url is None:
            return f"program:{self.name}"
        told = hashlib.sha256(self.wish.encode()).hexdigest()[:8]
        wish = f" ({self.wish[:40]} {told})" if self.wish else ""
        return f"program:{self.model[:100]}{wish}"


@dataclass(frozen=True, kw_only=True)
class ReachCfg:
    """How a vision model is reached; nothing of it decides what it says."""

    key_env: str = KEY_NAME
    """Environment variable with its key; what is in it is sent and never stored."""
    timeout_s: float = 60.0
    """How long one question may take."""
    tries: int = 4
    """How often a question is put before it counts as failed; between two tries 1 s,
    2 s, 4 s and so on, or what the server asks for."""
    beyond_loopback: bool = False
    """Let pictures of the clips go to another machine."""

    def __post_init__(self) -> None:
        if not 0.0 < self.timeout_s <= 3600.0:
            raise ProgramError(
                f"--timeout-s must lie in (0, 3600], got {self.timeout_s:g}"
            )
        if not 1 <= self.tries <= 10:
            raise ProgramError(f"--tries must lie in 1 to 10, got {self.tries}")

    def require_reachable(self, url: str) -> None:
        """Do nothing where pictures may go to `url`.

        Raises:
            ProgramError: it is another machine, and nobody said that this may be.
        """
        host = urlsplit(url).hostname or ""
        if not (is_loopback(host) or self.beyond_loopback):
            raise ProgramError(
                f"{url} is another machine: pictures of the clips would be sent there; "
                "if that is meant, add --beyond-loopback, else serve the model on "
                "127.0.0.1"
            )


def _require_url(url: str) -> None:
    try:
        parts = urlsplit(url)
        sound = parts.scheme in ("http", "https") and bool(parts.hostname)
        _ = parts.port
    except ValueError:
        sound, parts = False, None
    if not sound or parts is None or parts.username or parts.query or parts.fragment:
        raise ProgramError(
            f"{url!r} is no address of a model; write it as "
            f"{OPENAI}http://127.0.0.1:PORT/v1, and give a key by the environment"
        )
