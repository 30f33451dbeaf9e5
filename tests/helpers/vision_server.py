"""A server of the chat-completions interface that looks at the pictures it gets.

It prefers the clip whose footfall strip shows more feet in the air, counted in pixels.
"""

from __future__ import annotations

import base64
import io
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np
from PIL import Image

_STANDING = np.array([37, 99, 168])
"""Colour of a foot on the ground."""

Reply = tuple[int, dict[str, str], bytes]
"""Status, headers, body."""


@dataclass
class Seen:
    """What came in."""

    bodies: list[dict[str, Any]] = field(default_factory=list)
    keys: list[str | None] = field(default_factory=list)
    shapes: list[list[tuple[int, ...]]] = field(default_factory=list)


def pictures_of(body: dict[str, Any]) -> list[np.ndarray]:
    """The pictures [H, W, 3] of a question, decoded."""
    content = body["messages"][0]["content"]
    found = []
    for part in content:
        if part["type"] != "image_url":
            continue
        kind, _, data = part["image_url"]["url"].partition(",")
        assert kind == "data:image/png;base64"
        picture = Image.open(io.BytesIO(base64.b64decode(data, validate=True)))
        assert picture.format == "PNG"
        found.append(np.asarray(picture.convert("RGB")))
    return found


def standing(footfalls: np.ndarray) -> int:
    """Pixels of a footfall strip that show a foot on the ground."""
    return int((footfalls == _STANDING).all(axis=-1).sum())


def completion_of(text: str) -> bytes:
    """A chat completion that says `text`."""
    return json.dumps(
        {
            "choices": [{"message": {"role": "assistant", "content": text}}],
            "usage": {"prompt_tokens": 1000, "completion_tokens": 10},
        }
    ).encode()


def looks(body: dict[str, Any]) -> Reply:
    """What it says after looking."""
    _, feet_a, _, feet_b = pictures_of(body)
    a, b = standing(feet_a), standing(feet_b)
    word = "A" if a < b else "B" if b < a else "equal"
    text = json.dumps({"better": word, "why": f"{a} against {b} pixels"})
    return 200, {}, completion_of(f"```json\n{text}\n```")


@contextmanager
def vision_server(
    reply: Callable[[dict[str, Any]], Reply] = looks,
) -> Iterator[tuple[str, Seen]]:
    """Its address, and what it saw."""
    seen = Seen()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            assert self.path == "/v1/chat/completions"
            seen.bodies.append(body)
            seen.keys.append(self.headers.get("Authorization"))
            seen.shapes.append([picture.shape for picture in pictures_of(body)])
            status, headers, content = reply(body)
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/v1", seen
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
