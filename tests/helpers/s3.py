"""An S3 server of the tests' own, moto's, on a free port, gone when they end."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from tests.helpers.local_host import free_port
from tests.helpers.required import lacking


@contextmanager
def server(**environment: str) -> Iterator[Mapping[str, str]]:
    """The environment in which commands find the server and have rights there.

    Args:
        environment: Of the server.
    """
    missing = [
        name
        for name in ("s3fs", "moto", "flask", "flask_cors")
        if importlib.util.find_spec(name) is None
    ]
    if missing:
        lacking("S3", f"{', '.join(missing)} not installed (extra `s3-server`)")
    port = free_port()
    url = f"http://127.0.0.1:{port}"
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "moto.server", "-p", str(port)],
            env=os.environ | environment,
            stdout=log,
            stderr=log,
        )
        try:
            _wait(process, url)
            yield {
                "AWS_ENDPOINT_URL": url,
                "AWS_ACCESS_KEY_ID": "tests",
                "AWS_SECRET_ACCESS_KEY": "tests",
                "AWS_DEFAULT_REGION": "us-east-1",
            }
        finally:
            process.kill()
            process.wait()


def get(url: str) -> bytes:
    """What the server answers to somebody who has a name."""
    # It believes any, but gives no file to who has none.
    signed = {"Authorization": "AWS tests:tests"}
    request = urllib.request.Request(url, headers=signed)
    with urllib.request.urlopen(request) as answer:
        return answer.read()


def make_bucket(environment: Mapping[str, str], name: str) -> None:
    """A new bucket; whoever may ask the server without a signature may make one."""
    url = f"{environment['AWS_ENDPOINT_URL']}/{name}"
    urllib.request.urlopen(urllib.request.Request(url, method="PUT")).close()


def _wait(process: subprocess.Popen[bytes], url: str) -> None:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and process.poll() is None:
        try:
            urllib.request.urlopen(url, timeout=5).close()
        except urllib.error.HTTPError:
            return
        except OSError:
            time.sleep(0.05)
        else:
            return
    raise RuntimeError(f"the S3 server at {url} did not start")
