"""Where the page is served, to whom, and what would be unsafe."""

from __future__ import annotations

import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

from data.errors import GaitprefError
from data.files.files import require_regular
from labeling_ui.limits import page_limits as limits

from .checks import is_loopback, same_origin
from .public_url import PublicUrl
from .tokens import TokenStore

LOCAL_RATER = "local"
"""Who answers where nobody logs in."""


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
    """Private key of the certificate, PEM."""
    public_url: PublicUrl | None = None
    """Where people open the page, if a reverse proxy stands before it."""
    auth: bool = True
    """Ask for a token; without, everybody is `LOCAL_RATER`. Only on loopback."""
    guidelines: Path | None = None
    """Markdown file; a default text without."""
    max_clients: int = limits.PAGES
    """Open pages in all."""
    max_clients_per_rater: int = limits.PAGES_PER_RATER
    """Open pages of one rater; a new one closes the oldest."""
    login_failures_per_minute: int = limits.LOGIN_FAILURES_PER_MINUTE
    """Wrong tokens an address may try."""

    @property
    def path(self) -> str:
        """What the addresses of all our pages begin with."""
        return "" if self.public_url is None else self.public_url.path

    @property
    def secure(self) -> bool:
        """Browsers reach the page by TLS only."""
        if self.public_url is not None:
            return self.public_url.scheme == "https"
        return self.cert is not None

    @property
    def in_clear(self) -> bool:
        """Tokens can be read on the way: others reach the server, and without TLS."""
        return self.cert is None and not is_loopback(self.host)

    def cookie_name(self, port: int) -> str:
        """Name of the cookie that says who is logged in where the page is on `port`."""
        # What a browser holds the prefix to: https, and for the first, the path "/".
        prefix = ("__Secure-" if self.path else "__Host-") if self.secure else ""
        # Ports share cookies: two servers of one machine must not log each other out.
        return f"{prefix}gaitpref-{port}"

    def knows(self, name: str) -> bool:
        """Whether the page may be asked for under this host name.

        A foreign name that resolves to this machine makes a foreign page "local".
        """
        if self.public_url is not None:
            return name.lower() == self.public_url.name or is_loopback(name)
        return is_loopback(name) or not is_loopback(self.host)

    def is_own(self, origin: str | None, host: str) -> bool:
        """Whether a page of ours sent a request that was addressed to `host`."""
        if self.public_url is not None:
            return origin is not None and origin.lower() == self.public_url.origin
        return same_origin(origin, host)

    def url(self, port: int) -> str:
        """Where the server listens on `port`; people go there without a proxy."""
        host = self.host
        if host in ("0.0.0.0", "::"):
            host = socket.gethostname()
        elif ":" in host:
            host = f"[{host.strip('[]')}]"
        scheme = "http" if self.cert is None else "https"
        return f"{scheme}://{host}:{port}"

    def notices(self, port: int) -> list[str]:
        """What whoever starts the page has to know of its address, line by line."""
        public = self.public_url
        if public is None:
            lines = [f"the labeling page is at {self.url(port)}"]
        else:
            lines = [
                f"the labeling page is at {public}",
                f"its reverse proxy has to pass it on to {self.url(port)}",
            ]
        if self.in_clear:
            lines.append(f"warning: {IN_CLEAR}")
        if public is not None and public.in_clear:
            lines.append(
                f"warning: answers and tokens travel in clear to {public}; give the "
                "reverse proxy a certificate, and an address that begins with https"
            )
        return lines


IN_CLEAR = (
    "answers and tokens travel in clear: without --cert and --key they cross the "
    "network unencrypted"
)
"""Said where others reach the server itself, and without TLS."""


def refuse_unsafe(cfg: ProxyCfg, tokens: TokenStore) -> None:
    """Stop before anybody could come in unasked, or nobody at all.

    Raises:
        GaitprefError: the page would be open to the network, or nobody has a token.
    """
    if not cfg.auth:
        if not is_loopback(cfg.host):
            reached, option = cfg.host, "--host"
        elif cfg.public_url is not None and not is_loopback(cfg.public_url.name):
            reached, option = str(cfg.public_url), "--public-url"
        else:
            return
        raise GaitprefError(
            f"--no-auth would open the page to everybody who reaches {reached}; leave "
            f"it out, or leave out {option}"
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
        for path in (cfg.cert, cfg.key):
            require_regular(path)
        # An empty password, because OpenSSL would ask for one on the terminal.
        context.load_cert_chain(cfg.cert, cfg.key, password="")
    except OSError as error:
        raise GaitprefError(
            f"{cfg.cert} and {cfg.key} cannot be used for TLS ({error}); give a PEM "
            "certificate and its unencrypted key"
        ) from None
    return context
