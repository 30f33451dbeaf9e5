"""viser on loopback, the proxy before it, and the thread that moves the pages."""

from __future__ import annotations

import asyncio
import io
import logging
import threading
import warnings
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextlib import (
    AbstractContextManager,
    ExitStack,
    nullcontext,
    redirect_stdout,
)
from typing import Any, TypeVar

import viser

from labeling_ui.page.frame_thread import Ticker, Ticking
from labeling_ui.page.loop_status import StatusSource
from labeling_ui.page.store_thread import Work, Worker, logged
from labeling_ui.page.theme import set_theme
from labeling_ui.questions.rater_figures import RaterFigures
from labeling_ui.scene.scene import FOV_RAD, SHOTS
from labeling_ui.shell.page_shell import Shell
from labeling_ui.web.log_limit import limited_log
from labeling_ui.web.proxied import (
    lock_down,
    new_secret,
    only_for,
    proxied_rater,
    proxied_visit,
)
from labeling_ui.web.proxy import Proxy
from labeling_ui.web.proxy_cfg import ProxyCfg
from labeling_ui.web.tokens import TokenStore
from labeling_ui.web.visit import Visit

logger = logging.getLogger(__name__)
T = TypeVar("T")

_AMBIENT = 1.9
"""Intensity of the light from everywhere, beside viser's two directed ones."""

NewPage = Callable[[viser.ClientHandle, Visit], Ticking]
"""Makes the page of a client and its visit; called by the worker."""


class Site:
    """A server of pages, up from `start` to `stop`."""

    def __init__(
        self,
        cfg: ProxyCfg,
        *,
        tokens: TokenStore,
        figures: Callable[[str], RaterFigures],
        shell: Shell,
        status: StatusSource,
        together: Callable[[], AbstractContextManager[None]] = nullcontext,
        shadows: bool = True,
    ) -> None:
        """Start viser on loopback; nobody gets a page before `start`.

        Args:
            together: What pages store in this context is on the disk when it ends.
            shadows: Draw them; without a graphics card they take most of the time.
        """
        # A visitor may leave between two writes; viser would warn about each.
        warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")
        self._secret = new_secret()
        # It announces its own port, behind which nobody finds a page.
        with redirect_stdout(io.StringIO()), only_for(self._secret):
            self._viser = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        lock_down(self._viser)
        self._log = ExitStack()
        self._proxy = Proxy(
            cfg,
            upstream_port=self._viser.get_port(),
            secret=self._secret,
            tokens=tokens,
            figures=figures,
            shell=shell,
        )
        self._ticker = Ticker(status)
        self.worker = Worker(together)
        # Loading ahead must not keep an answer waiting.
        self._loader = ThreadPoolExecutor(max_workers=1, thread_name_prefix="loader")
        self._loop = _LoopThread()
        self._furnish(shadows)

    @property
    def url(self) -> str:
        """Where the page is; the port is known once it was started."""
        return self._proxy.url

    @property
    def notices(self) -> list[str]:
        """Where the page is and who could listen, line by line, once it was started."""
        return self._proxy.notices

    def start(self, new_page: NewPage) -> None:
        """Give every visitor who came through the proxy a page.

        Raises:
            GaitprefError: the port is busy, or the page would be unguarded.
        """

        def connected(client: viser.ClientHandle) -> None:
            rater = proxied_rater(self._viser, client.client_id, self._secret)
            ticket = proxied_visit(self._viser, client.client_id)
            visit = None if ticket is None else self._proxy.visit(ticket)
            if visit is not None and visit.rater == rater:
                visit.seat(client.gui)
                self.worker.submit(lambda: self._open(client, visit, new_page))

        async def disconnected(client: viser.ClientHandle) -> None:
            self._ticker.remove(client.client_id)

        self._viser.on_client_connect(connected)
        self._viser.on_client_disconnect(disconnected)
        self._log.enter_context(limited_log())
        self._ticker.start()
        self._loop.start()
        try:
            self._loop.run(self._proxy.start())
        except BaseException:
            self._shut()
            raise

    def stop(self) -> None:
        """End what is running; all answers are on the disk already."""
        self._loop.run(self._proxy.stop())
        self._shut()

    def submit_late(self, work: Work) -> None:
        """Have the loader do something nobody waits for; errors end up in the log."""
        try:
            self._loader.submit(logged, work)
        except RuntimeError:
            logger.debug("the server is stopping; a task is dropped")

    def wake(self) -> None:
        """Have the ticker handle what was posted."""
        self._ticker.wake()

    def _furnish(self, shadows: bool) -> None:
        """What all visitors share: the light and where the camera starts."""
        set_theme(self._viser.gui, dark=False)
        scene, camera = self._viser.scene, self._viser.initial_camera
        scene.world_axes.visible = False
        scene.configure_default_lights(cast_shadow=shadows)
        # An environment map would cost a browser without a graphics card most of what
        # it takes to open the page, and comes after a first frame without it.
        scene.configure_environment_map(None)
        scene.add_light_ambient("/ambient", intensity=_AMBIENT)
        shot = SHOTS["treadmill"]
        camera.position, camera.look_at = shot.position, shot.look_at
        camera.fov = FOV_RAD

    def _shut(self) -> None:
        self._ticker.stop()
        self._loader.shutdown(wait=True, cancel_futures=True)
        self.worker.stop()
        self._loop.stop()
        with redirect_stdout(io.StringIO()):
            self._viser.stop()
        self._log.close()

    def _open(
        self, client: viser.ClientHandle, visit: Visit, new_page: NewPage
    ) -> None:
        if visit.over is not None:
            return
        self._ticker.add(client.client_id, new_page(client, visit))
        # It may have left while the page was made, before there was one to remove.
        if client.client_id not in self._viser.get_clients():
            self._ticker.remove(client.client_id)


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
