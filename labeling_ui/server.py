"""The labeling page as one object: viser on loopback, a proxy before it, a ticker.

`gaitpref label` and the loop both run a `LabelServer`.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import warnings
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import numpy as np
import viser

from data.dataset import Dataset

from .desk import Desk
from .figures import rater_figures
from .guidelines import load_guidelines
from .motion import MotionCache
from .page import Page, Shared
from .proxied import lock_down, new_secret, proxied_rater
from .proxy import Proxy, ProxyCfg
from .queue import QueueCfg, RaterSession
from .scene import FOV_RAD, SHOTS
from .status import StatusSource, no_status
from .theme import set_theme
from .ticker import Ticker
from .tokens import TokenStore

logger = logging.getLogger(__name__)
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class LabelCfg:
    """How the page is served."""

    host: str = "127.0.0.1"
    """Address to listen on; any other than loopback needs tokens."""
    port: int = 8080
    """TCP port; 0 takes a free one."""
    guidelines: Path | None = None
    """Markdown shown to raters first."""
    cert: Path | None = None
    """Certificate for TLS, PEM."""
    key: Path | None = None
    """Its private key, PEM."""
    auth: bool = True
    """Ask for a token; only loopback may go without."""
    queue: QueueCfg = field(default_factory=QueueCfg)
    """How questions are handed out."""


class PageHost:
    """viser on loopback, and what every page on it needs."""

    def __init__(self, secret: str, status: StatusSource) -> None:
        # A visitor may leave between two writes; viser would warn about each.
        warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")
        self.viser = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        lock_down(self.viser)
        self.secret = secret
        self.ticker = Ticker(status)
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="desk")
        set_theme(self.viser.gui, dark=False)
        self.viser.scene.world_axes.visible = False
        self.viser.scene.configure_environment_map("studio", environment_intensity=0.35)
        shot, camera = SHOTS["treadmill"], self.viser.initial_camera
        camera.position, camera.look_at = shot.position, shot.look_at
        camera.fov = FOV_RAD

    def start(self, new_page: Callable[[viser.ClientHandle, str], Any]) -> None:
        """Give every visitor who came through the proxy a page, made by `new_page`."""

        def connected(client: viser.ClientHandle) -> None:
            rater = proxied_rater(self.viser, client.client_id, self.secret)
            if rater is not None:
                self.submit(lambda: self._open(client, rater, new_page))

        async def disconnected(client: viser.ClientHandle) -> None:
            self.ticker.remove(client.client_id)

        self.viser.on_client_connect(connected)
        self.viser.on_client_disconnect(disconnected)
        self.ticker.start()

    def submit(self, work: Callable[[], None]) -> None:
        """Have the worker do something; errors end up in the log."""

        def logged() -> None:
            try:
                work()
            except Exception:
                logger.exception("a task of the page failed")

        try:
            self._worker.submit(logged)
        except RuntimeError:
            logger.debug("the server is stopping; a task is dropped")

    def stop(self) -> None:
        """End what is running; all answers are on the disk already."""
        self.ticker.stop()
        self._worker.shutdown(wait=True, cancel_futures=True)
        self.viser.stop()

    def _open(
        self,
        client: viser.ClientHandle,
        rater: str,
        new_page: Callable[[viser.ClientHandle, str], Any],
    ) -> None:
        page = new_page(client, rater)
        self.ticker.add(client.client_id, page)
        # It may have left while the page was made, before there was one to remove.
        if client.client_id not in self.viser.get_clients():
            self.ticker.remove(client.client_id)


class LabelServer:
    """The page of a data set, up from `start` to `stop`."""

    def __init__(
        self, dataset: Dataset, cfg: LabelCfg, *, status: StatusSource = no_status
    ) -> None:
        """Prepare; nothing listens yet.

        Args:
            status: Says what the loop is doing.

        Raises:
            GaitprefError: the guidelines cannot be read.
        """
        self._dataset, self._cfg, self._status = dataset, cfg, status
        self._guidelines = load_guidelines(cfg.guidelines)
        self._loop = _LoopThread()

    @property
    def url(self) -> str:
        """Where the page is; known once it was started."""
        return self._proxy.url

    def start(self) -> None:
        """Serve the page until `stop`.

        Raises:
            GaitprefError: the port is busy, or the options would leave it unguarded.
        """
        self._store = self._dataset.answers()
        secret = new_secret()
        self._host = PageHost(secret, self._status)
        self._motions = MotionCache(self._dataset)
        self._shared = Shared(submit=self._host.submit, guidelines=self._guidelines)
        cfg = self._cfg
        self._proxy = Proxy(
            ProxyCfg(
                host=cfg.host,
                port=cfg.port,
                cert=cfg.cert,
                key=cfg.key,
                auth=cfg.auth,
                guidelines=cfg.guidelines,
            ),
            upstream_port=self._host.viser.get_port(),
            secret=secret,
            tokens=TokenStore(self._dataset.root),
            figures=lambda rater_id: rater_figures(self._store, rater_id),
        )
        self._loop.start()
        self._host.start(self._new_page)
        try:
            self._loop.run(self._proxy.start())
        except BaseException:
            self._shut()
            raise

    def stop(self) -> None:
        """Close the page; raters see it go on by itself when it is started again."""
        self._loop.run(self._proxy.stop())
        self._shut()

    def __enter__(self) -> LabelServer:
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()

    def _shut(self) -> None:
        self._loop.stop()
        self._host.stop()
        self._store.close()

    def _new_page(self, client: viser.ClientHandle, rater_id: str) -> Page:
        session = RaterSession(
            self._store, rater_id, cfg=self._cfg.queue, rng=np.random.default_rng()
        )
        return Page(client, Desk(session, self._motions), self._shared)


class _LoopThread:
    """An event loop in a thread of its own, for the proxy."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="proxy", daemon=True
        )

    def start(self) -> None:
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run `work` in the loop and wait for it."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    def stop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
