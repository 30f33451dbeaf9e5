"""A directory behind a URL: whole files by name, on whatever fsspec speaks.

Needs the extra `remote`, and for most stores a package of its own.
"""

from __future__ import annotations

import base64
import hashlib
import re
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from data.errors import GaitprefError, RemoteError
from data.files.faults import cause
from data.files.files import sha256_bytes, write_atomically

_PACKAGES = {
    "s3": "-e '.[s3]' -c constraints.txt",
    "gs": "gcsfs",
    "gcs": "gcsfs",
    "sftp": "paramiko",
    "ssh": "paramiko",
    "hf": "huggingface_hub",
    "az": "adlfs",
    "abfs": "adlfs",
}
"""What brings the package of a scheme."""
_WHOLE = ("s3", "s3a", "gs", "gcs", "az", "abfs", "hf")
"""Stores in which a file appears when all of it has arrived, and not before."""
_LOCAL = ("file", "local")
_ONE_BY_ONE = ("hf",)
"""Stores that refuse two writers at once: every file is a commit."""
_SECRET = re.compile(r"(?<=:)[^:@/]+(?=@)")


class Place:
    """What is behind a URL; may be used by several threads."""

    def __init__(self, url: str) -> None:
        """Nothing is asked of the store yet.

        Raises:
            RemoteError: the URL cannot be one, or a package is missing.
        """
        self._url = url
        self.name = _SECRET.sub("***", url.rstrip("/"))
        """What errors call it; without passwords."""
        try:
            from fsspec.core import url_to_fs
            from fsspec.utils import get_protocol
        except ModuleNotFoundError:
            raise RemoteError(
                "a data set behind a URL needs the package fsspec, which is not "
                "installed: pip install -e '.[remote]' -c constraints.txt"
            ) from None
        self._open: Callable[[str], tuple[Any, str]] = url_to_fs
        self._scheme = get_protocol(url)
        self._store()

    @property
    def at_once(self) -> int:
        """How many files may be under way at once."""
        return 1 if self._scheme in _ONE_BY_ONE else 8

    def sizes(self, folder: str) -> dict[str, int]:
        """Bytes of every file of a folder by its name, `folder/...`; none of a folder
        that is not there.

        Raises:
            RemoteError: the place is not there, or may not be read.
        """
        with self._told("read"):
            store, root = self._store()
            store.invalidate_cache()
            found = store.find(f"{root}/{folder}", detail=True)
        # A folder that comes to be while it is listed may be listed itself.
        inside, start = f"{root}/{folder}/", len(root) + 1
        return {
            path[start:]: int(facts["size"])
            for path, facts in found.items()
            if path.startswith(inside)
        }

    def read(self, name: str, limit: int) -> bytes:
        """The bytes of a file, `limit` at most.

        Raises:
            Gone: it is not there any more.
            RemoteError: it is longer, or cannot be read.
        """
        with self._told("read"):
            store, root = self._store()
            try:
                with store.open(f"{root}/{name}", "rb", block_size=2**20) as file:
                    content = file.read(limit + 1)
            except FileNotFoundError as error:
                raise Gone(
                    f"{self.name}/{name} is not there any more; push again from where "
                    "it is whole"
                ) from error
        if len(content) > limit:
            raise RemoteError(
                f"{self.name}/{name} has more than {limit:,} bytes, which nothing of "
                "ours has; take a data set from somebody you trust"
            )
        return content

    def send(self, name: str, content: bytes) -> None:
        """Put a file there, or replace one: its name stands for all of it, always.

        Raises:
            RemoteError: that did not work, or other bytes arrived.
        """
        with self._told("written"):
            store, root = self._store()
            path = f"{root}/{name}"
            if self._scheme in _LOCAL:
                Path(path).parent.mkdir(parents=True, exist_ok=True)
                write_atomically(Path(path), content)
            elif self._scheme in _WHOLE:
                store.pipe_file(path, content)
                self._require_arrived(store, path, content)
            else:
                self._send_aside(store, root, path, content)

    def remove(self, name: str) -> None:
        """Delete a file, if it is there.

        Raises:
            RemoteError: it cannot be deleted.
        """
        with self._told("written"):
            store, root = self._store()
            try:
                store.rm_file(f"{root}/{name}")
            except FileNotFoundError:
                return

    def _send_aside(self, store: Any, root: str, path: str, content: bytes) -> None:
        """Send under another name, look at what arrived, then rename."""
        partial = f"{root}/partial/{secrets.token_hex(16)}"
        for made in (partial, path):
            store.makedirs(made.rpartition("/")[0], exist_ok=True)
        try:
            store.pipe_file(partial, content)
            self._require_same(store, partial, content)
            store.mv(partial, path)
        except BaseException:
            with suppress(Exception):
                store.rm_file(partial)
            raise

    def _require_arrived(self, store: Any, path: str, content: bytes) -> None:
        """Compare what the store says it has with what was sent; where it says nothing
        of use, look at it."""
        facts = store.info(path)
        digest = hashlib.md5(content, usedforsecurity=False).digest()
        told = (str(facts.get("ETag", "")).strip('"'), facts.get("md5Hash"))
        # Stores that encrypt give other tags.
        if digest.hex() != told[0] and base64.b64encode(digest).decode() != told[1]:
            self._require_same(store, path, content)

    def _require_same(self, store: Any, path: str, content: bytes) -> None:
        if sha256_bytes(store.cat_file(path)) != sha256_bytes(content):
            raise RemoteError(
                f"{self.name}: other bytes of {path.rpartition('/')[2]} arrived than "
                "were sent; run this again, what has arrived is not sent twice"
            )

    def _store(self) -> tuple[Any, str]:
        """The file system and the path in it; each thread has its own."""
        try:
            store, root = self._open(self._url)
        except ImportError as error:
            package = _PACKAGES.get(self._scheme, self._scheme)
            raise RemoteError(
                f"{self.name}: the scheme {self._scheme} needs a package that is not "
                f"installed ({_line(error)}): pip install {package}"
            ) from None
        except ValueError as error:
            raise RemoteError(
                f"{self.name} is no URL of a store ({_line(error)}); give a directory, "
                "s3://BUCKET/PATH, gs://BUCKET/PATH, sftp://USER@HOST/PATH or "
                "hf://datasets/USER/NAME"
            ) from None
        except Exception as error:
            raise self._failure("reached", error) from error
        return store, root.rstrip("/")

    @contextmanager
    def _told(self, done: str) -> Iterator[None]:
        """Say in one line what keeps a store from being read or written."""
        try:
            yield
        except GaitprefError:
            raise
        except Exception as error:
            raise self._failure(done, error) from error

    def _failure(self, done: str, error: Exception) -> RemoteError:
        kept = "what is there already stays, and is not sent twice"
        kind = type(error).__name__
        if isinstance(error, PermissionError) or "Credential" in kind or "Auth" in kind:
            advice = (
                "you have no rights there; log in as the tools of the store do, as "
                "with AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY or an SSH key"
            )
        elif isinstance(error, FileNotFoundError):
            advice = "it is not there; make the bucket first, or mend the URL"
        elif isinstance(error, OSError) and (reason := cause(error)):
            advice = f"{reason}; see to that and run this again"
        else:
            advice = "see to the connection and run this again"
        return RemoteError(
            f"{self.name} cannot be {done} ({_line(error)}): {advice}; {kept}"
        )


class Gone(RemoteError):
    """A file that was there a moment ago is not any more."""


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
