"""A PostgreSQL server of the tests' own, on a free port, gone when they end."""

from __future__ import annotations

import importlib.util
import os
import pwd
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.helpers.local_host import free_port
from tests.helpers.required import lacking


def programs() -> Path | None:
    """The directory of `initdb` and `postgres`; the newest where there are several."""
    found = shutil.which("initdb")
    if found is not None:
        return Path(found).resolve().parent
    versions = sorted(
        Path("/usr/lib/postgresql").glob("*/bin/initdb"),
        key=lambda path: float(path.parts[-3]),
    )
    return versions[-1].parent if versions else None


def require() -> Path:
    """The programs, or a skip that says what is missing."""
    found = programs()
    missing = "" if found else "no PostgreSQL server is installed (initdb)"
    for package in ("sqlalchemy", "psycopg"):
        if importlib.util.find_spec(package) is None:
            missing = f"the package {package} is not installed (extra `postgres`)"
    if missing or found is None:
        lacking("POSTGRES", f"answers in PostgreSQL: {missing}")
    return found


@contextmanager
def server() -> Iterator[str]:
    """The URL of a new server without the name of a schema; it is empty."""
    found = require()
    # The server refuses to run as root.
    user = None
    if os.geteuid() == 0:
        names = {entry.pw_name for entry in pwd.getpwall()}
        user = "postgres" if "postgres" in names else "nobody"
    with tempfile.TemporaryDirectory(prefix="gaitpref-postgres-") as root:
        if user is not None:
            account = pwd.getpwnam(user)
            os.chown(root, account.pw_uid, account.pw_gid)
        data = Path(root) / "data"
        settings = ["--auth=trust", "--username=postgres", "--encoding=UTF8"]
        subprocess.run(
            [found / "initdb", "-D", data, *settings, "--no-locale", "--no-sync"],
            user=user,
            cwd=root,
            check=True,
            stdout=subprocess.DEVNULL,
        )
        port = free_port()
        log = Path(root) / "log"
        with log.open("wb") as output:
            # The tests kill clients, never the machine: nothing waits for the disk.
            options = ["-c", "fsync=off", "-c", "max_connections=200"]
            address = ["-h", "127.0.0.1", "-p", str(port), "-k", root]
            process = subprocess.Popen(
                [found / "postgres", "-D", data, *address, *options],
                user=user,
                cwd=root,
                stdout=output,
                stderr=output,
            )
        try:
            _wait(process, port, log)
            yield f"postgresql://postgres@127.0.0.1:{port}/postgres"
        finally:
            # SIGINT: end the clients, then stop.
            process.send_signal(2)
            process.wait(timeout=30)


def _wait(process: subprocess.Popen[bytes], port: int, log: Path) -> None:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and process.poll() is None:
        if b"ready to accept connections" in log.read_bytes():
            return
        time.sleep(0.05)
    raise RuntimeError(f"PostgreSQL on port {port} did not start: {log.read_text()}")


def new_schema(url: str) -> str:
    """The URL of a schema of its own in the server at `url`."""
    import psycopg

    name = f"test_{os.getpid()}_{time.monotonic_ns()}"
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f"CREATE SCHEMA {name}".encode())
    return f"{url}?options=-csearch_path%3D{name}"
