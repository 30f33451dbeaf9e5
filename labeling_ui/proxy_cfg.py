"""Where the page is served, to whom, and what would be unsafe."""

from __future__ import annotations

import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

from data.errors import GaitprefError

from . import limits
from .tokens import TokenStore
from .web_checks import is_loopback


@dataclass(frozen=True, kw_only=True)
class ProxyCfg:
    """Where the page is served, to whom, and how much of it."""

    host: str = "127.0.0.1"
    """Address to listen on; any other than loopback can be reached by others."""
    port: int = 8080
    """TCP port; 0 takes any free one."""
    cert: Path | None = None
    """Certificate chain for TLS, PEM."""
    key: Path | None = None
    """Its private key, PEM."""
    auth: bool = True
    """Ask for a token; without, everybody is `local_rater`. Only on loopback."""
    local_rater: str = "local"
    """Who answers where nobody logs in."""
    guidelines: Path | None = None
    """Markdown file; a default text without."""
    max_message_bytes: int = limits.MESSAGE_BYTES
    """Longest message a browser may send."""
    max_clients: int = limits.PAGES
    """Open pages in all."""
    max_clients_per_rater: int = limits.PAGES_PER_RATER
    """Open pages of one rater; a new one closes the oldest."""
    login_failures_per_minute: int = limits.LOGIN_FAILURES_PER_MINUTE
    """Wrong tokens an address may try."""
    cookie_days: int = 14
    """How long a login lasts."""

    @property
    def scheme(self) -> str:
        """Of the page's address."""
        return "http" if self.cert is None else "https"

    @property
    def in_clear(self) -> bool:
        """Tokens can be read on the way: others reach the server, and without TLS."""
        return self.cert is None and not is_loopback(self.host)

    def url(self, port: int) -> str:
        """Address of the page where it is served on `port`."""
        host = self.host
        if host in ("0.0.0.0", "::"):
            host = socket.gethostname()
        elif ":" in host:
            host = f"[{host.strip('[]')}]"
        return f"{self.scheme}://{host}:{port}"


def refuse_unsafe(cfg: ProxyCfg, tokens: TokenStore) -> None:
    """Stop before anybody could come in unasked, or nobody at all.

    Raises:
        GaitprefError: the page would be open to the network, or nobody has a token.
    """
    if not cfg.auth:
        if is_loopback(cfg.host):
            return
        raise GaitprefError(
            f"--no-auth would open the page to everybody who reaches {cfg.host}; leave "
            "it out, or leave out --host"
        )
    if not tokens.names():
        alone = " (alone on this machine, --no-auth does without)"
        raise GaitprefError(
            f"nobody could log in to {cfg.host}: `gaitpref raters --dataset "
            f"{tokens.path.parent} add NAME` makes a token"
            f"{alone if is_loopback(cfg.host) else ''}"
        )


def tls_context(cfg: ProxyCfg) -> ssl.SSLContext | None:
    """What encrypts the connection; None without a certificate.

    Raises:
        GaitprefError: certificate and key are not a usable pair.
    """
    if cfg.cert is None and cfg.key is None:
        return None
    if cfg.cert is None or cfg.key is None:
        raise GaitprefError("--cert and --key belong together; give both, or neither")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # An empty password, because OpenSSL would ask for one on the terminal.
        context.load_cert_chain(cfg.cert, cfg.key, password="")
    except OSError as error:
        raise GaitprefError(
            f"{cfg.cert} and {cfg.key} cannot be used for TLS ({error}); give a PEM "
            "certificate and its unencrypted key"
        ) from None
    return context
