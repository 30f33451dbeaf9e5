"""Options of raters that are programs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .bounds import Count


@dataclass(frozen=True, kw_only=True)
class Asking:
    """How a vision model is asked, where `--rater openai:URL` names one."""

    model: str = ""
    """Name of the model at that address."""
    wish: str = ""
    """What it is told to look for, going on with "Which one": "walks lower". By default
    "walks better: steadily, without stumbling, as it was told to"."""
    key_env: str = "GAITPREF_RATER_KEY"
    """Environment variable with the key, where it asks for one; it is not stored."""
    timeout_s: float = 60.0
    """How long one question may take."""
    tries: Count = 4
    """How often a question is put before the command gives up, with growing pauses."""
    beyond_loopback: bool = False
    """Send pictures of the clips to another machine, where the address is one."""


@dataclass(frozen=True, kw_only=True)
class Teaching:
    """Why answers of a program may teach."""

    checked_on: Path | None = None
    """Data set in which the program answered pairs that people answered too: it has to
    prefer what they prefer in 70 % of at least 30 answers."""
    unchecked: bool = False
    """Let its answers teach though nobody compared it with people."""
