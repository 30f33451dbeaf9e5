"""One question to a model behind the chat-completions interface, with patience.

Whatever a server sends is taken for hostile: its size, its time, its shape and its
words are checked before anything is made of them.
"""

from __future__ import annotations

import http.client
import json
import os
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from labeling_ui.web.checks import is_loopback

from .program_cfg import ProgramError, ReachCfg

REPLY_BYTES = 2**20
"""Of one reply; a sentence is wanted."""
_AGAIN = (408, 409, 425, 429, 500, 502, 503, 504)
"""What a server says that may answer later."""
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 1.0, 30.0
_MOST_TOKENS = 10**9


@dataclass(frozen=True, kw_only=True)
class Reply:
    """What a model said."""

    text: str
    tokens_in: int
    tokens_out: int
    seconds: float
    """From the first try to the reply."""


class _NotNow(Exception):
    """Worth another try."""

    def __init__(self, told: str, pause_s: float | None = None) -> None:
        super().__init__(told)
        self.pause_s = pause_s


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Pictures go where the user said, and nowhere else."""

    def redirect_request(self, *args: Any, **named: Any) -> None:
        return None


def completion(
    url: str,
    body: dict[str, Any],
    reach: ReachCfg,
    *,
    sleep: Callable[[float], None] = time.sleep,
) -> Reply:
    """The reply to one chat completion.

    Args:
        url: Of the interface, as http://127.0.0.1:PORT/v1.
        body: Model and messages.
        reach: How long and how often is tried; where the key is.
        sleep: Waits between two tries.

    Raises:
        ProgramError: it cannot be reached, refuses, or does not speak the interface.
    """
    reach.require_reachable(url)
    request = _request(f"{url}/chat/completions", body, os.environ.get(reach.key_env))
    began_s, pause_s = time.monotonic(), _FIRST_PAUSE_S
    for number in range(1, reach.tries + 1):
        try:
            text, tokens_in, tokens_out = _read(_sent(request, reach), url)
            seconds = time.monotonic() - began_s
            return Reply(
                text=text, tokens_in=tokens_in, tokens_out=tokens_out, seconds=seconds
            )
        except _NotNow as why:
            if number == reach.tries:
                times = f"{number} times" if number > 1 else "once"
                raise ProgramError(
                    f"{url} was asked {times} and gave no answer ({why}); start the "
                    "model, or give it longer with --timeout-s; the same command goes "
                    "on"
                ) from None
            sleep(min(_LONGEST_PAUSE_S, why.pause_s or pause_s))
            pause_s *= 2
    raise AssertionError("tries is at least 1")


def _request(url: str, body: dict[str, Any], key: str | None) -> urllib.request.Request:
    headers = {"Content-Type": "application/json", "Accept": "application/json"}
    if key:
        if not key.isascii() or not key.isprintable():
            raise ProgramError("the key in the environment is no key: it has odd signs")
        headers["Authorization"] = f"Bearer {key}"
    return urllib.request.Request(url, json.dumps(body).encode(), headers)


def _sent(request: urllib.request.Request, reach: ReachCfg) -> bytes:
    """The bytes of the reply.

    Raises:
        _NotNow: later may be better.
        ProgramError: it never will be.
    """
    handlers: list[urllib.request.BaseHandler] = [_NoRedirect()]
    if is_loopback(urlsplit(request.full_url).hostname or ""):
        # A proxy would be another machine.
        handlers.append(urllib.request.ProxyHandler({}))
    opener = urllib.request.build_opener(*handlers)
    ends_s = time.monotonic() + reach.timeout_s
    try:
        with opener.open(request, timeout=reach.timeout_s) as reply:
            return _all_of(reply, ends_s)
    except urllib.error.HTTPError as error:
        with error:
            told = f"{error.code} {error.reason}"[:80]
            if error.code in _AGAIN:
                raise _NotNow(told, _pause_of(error.headers)) from None
            words = _words_of(error.read(4096))
        raise ProgramError(
            f"{request.full_url} refuses ({told}{words}); look at --model, the address "
            f"and the key in {reach.key_env}"
        ) from None
    except (OSError, http.client.HTTPException) as error:
        reason = getattr(error, "reason", error)
        raise _NotNow(f"{reason}"[:120] or type(error).__name__) from None


def _all_of(reply: Any, ends_s: float) -> bytes:
    """A reply that is neither endless nor drips for ever."""
    found = bytearray()
    while part := reply.read1(65536):
        found += part
        if len(found) > REPLY_BYTES:
            raise ProgramError(
                f"the model's server sent more than {REPLY_BYTES:,} bytes for an "
                "answer of one sentence: this is no chat completion"
            )
        if time.monotonic() > ends_s:
            raise _NotNow("the reply took too long")
    return bytes(found)


def _pause_of(headers: Any) -> float | None:
    """Seconds that the server asks to wait, where it says so."""
    text = headers.get("Retry-After", "")
    return float(text) if text.isascii() and text.isdigit() and len(text) < 6 else None


def _words_of(content: bytes) -> str:
    """What a server says of its refusal, as far as it can be shown."""
    text = content.decode(errors="replace")
    try:
        message = json.loads(text)["error"]["message"]
        text = message if isinstance(message, str) else ""
    except (ValueError, TypeError, KeyError, RecursionError):
        text = ""
    shown = "".join(c for c in " ".join(text.split()) if c.isprintable())[:160]
    return f": {shown}" if shown else ""


def _read(content: bytes, url: str) -> tuple[str, int, int]:
    """Text and tokens of a chat completion.

    Raises:
        ProgramError: it is none.
    """
    try:
        found = json.loads(content)
        text = found["choices"][0]["message"]["content"]
        if not isinstance(text, str):
            raise TypeError(f"its content is a {type(text).__name__}")
    except (ValueError, TypeError, KeyError, IndexError, RecursionError) as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())[:80]
        raise ProgramError(
            f"what {url} sent is no chat completion ({told}); is this the address of "
            "an interface like OpenAI's, with /v1 at its end?"
        ) from None
    usage = found.get("usage")
    usage = usage if isinstance(usage, dict) else {}
    tokens = [usage.get(name) for name in ("prompt_tokens", "completion_tokens")]
    tokens_in, tokens_out = (
        number if type(number) is int and 0 <= number < _MOST_TOKENS else 0
        for number in tokens
    )
    return text, tokens_in, tokens_out
