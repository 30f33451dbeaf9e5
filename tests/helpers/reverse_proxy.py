"""nginx or Caddy before the labeling page, with the block the documentation has."""

from __future__ import annotations

import os
import re
import shutil
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import aiohttp
from aiohttp.abc import AbstractResolver, ResolveResult

from tests.helpers.local_host import certificate
from tests.helpers.required import lacking

DOCUMENT = Path(__file__).parents[2] / "docs" / "how-to" / "reverse-proxy.md"
NAME = "label.example.org"
_NGINX = """
daemon off; {user}
pid {root}/nginx.pid;
error_log {root}/error.log;
events {{}}
http {{
    access_log off;
    client_body_temp_path {root}/body;
    proxy_temp_path {root}/proxy;
    fastcgi_temp_path {root}/fastcgi;
    uwsgi_temp_path {root}/uwsgi;
    scgi_temp_path {root}/scgi;
    {block}
}}
"""
_CADDY = """{{
    admin off
    auto_https disable_redirects
    skip_install_trust
}}
{block}
"""


class _Here(AbstractResolver):
    """Finds every name on this machine."""

    async def resolve(
        self, host: str, port: int = 0, family: socket.AddressFamily = socket.AF_INET
    ) -> list[ResolveResult]:
        here = ResolveResult(
            hostname=host,
            host="127.0.0.1",
            port=port,
            family=socket.AF_INET,
            proto=0,
            flags=0,
        )
        return [here]

    async def close(self) -> None:
        return


@dataclass(frozen=True)
class ReverseProxy:
    """A proxy that runs."""

    port: int
    certificate: Path

    def connector(self, address: str = "127.0.0.1") -> aiohttp.TCPConnector:
        """The way of a browser at `address` to it; trusts the certificate."""
        return aiohttp.TCPConnector(
            resolver=_Here(),
            local_addr=(address, 0),
            ssl=ssl.create_default_context(cafile=str(self.certificate)),
        )


def require(kind: str) -> str:
    """The program, or a skip that says what is missing."""
    search = f"{os.environ.get('PATH', '')}:/usr/sbin"
    missing = [
        name for name in (kind, "openssl") if not shutil.which(name, path=search)
    ]
    if missing:
        why = f"the page behind {kind}: {missing[0]} is not installed"
        lacking(kind.upper(), why)
    return shutil.which(kind, path=search) or kind


def documented(kind: str, *, path: str) -> str:
    """The block of the documentation, for a page under `path`."""
    found = re.search(rf"```{kind}\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    assert found is not None
    if path:
        return found[1].replace("/gait", path)
    return found[1].replace("location /gait", "location /").replace(" /gait*", "")


@contextmanager
def reverse_proxy(
    kind: str, root: Path, *, port: int, page_port: int, path: str
) -> Iterator[ReverseProxy]:
    """The proxy of `kind` on `port` before a page on `page_port`, files in `root`."""
    program = require(kind)
    cert, key = certificate(root, NAME)
    block = documented(kind, path=path).replace(
        "127.0.0.1:8080", f"127.0.0.1:{page_port}"
    )
    if kind == "nginx":
        block = block.replace("listen 443", f"listen 127.0.0.1:{port}")
        block = block.replace(f"/etc/ssl/{NAME}.pem", str(cert))
        block = block.replace(f"/etc/ssl/{NAME}.key", str(key))
        # Its children could not read what only root may.
        user = "user root;" if os.geteuid() == 0 else ""
        text = _NGINX.format(root=root, user=user, block=block)
        command = ["-p", str(root), "-c", str(root / "config")]
    else:
        block = block.replace(
            f"{NAME} {{", f"https://{NAME}:{port} {{\n    tls {cert} {key}"
        )
        text = _CADDY.format(block=block)
        command = ["run", "--adapter", "caddyfile", "--config", str(root / "config")]
    (root / "config").write_text(text)
    log = root / "log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            [program, *command],
            stdout=output,
            stderr=output,
            env=os.environ | {"HOME": str(root), "XDG_DATA_HOME": str(root)},
        )
    try:
        _wait(process, port, log)
        yield ReverseProxy(port, cert)
    finally:
        process.terminate()
        process.wait(timeout=30)


def _wait(process: subprocess.Popen[bytes], port: int, log: Path) -> None:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and process.poll() is None:
        with socket.socket() as knock:
            if knock.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise RuntimeError(f"nothing came up on port {port}: {log.read_text()}")
