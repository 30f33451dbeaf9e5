"""The labeling page as one object; `gaitpref label` and the loop both run it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import viser

from data.answers.question_board import QuestionBoard
from data.datasets.dataset import Dataset
from labeling_ui.limits import page_limits as limits
from labeling_ui.page.loop_status import StatusSource, no_status
from labeling_ui.page.page_access import Desk, Picture
from labeling_ui.page.rater_page import Page
from labeling_ui.page.remarks import marks_of
from labeling_ui.page.shared import Shared
from labeling_ui.page.view_habits import habits_of
from labeling_ui.questions.key_repeat import GuardCfg
from labeling_ui.questions.rater_figures import rater_figures
from labeling_ui.questions.rater_session import QueueCfg, RaterSession
from labeling_ui.scene.clip_motion import MotionCache
from labeling_ui.shell.label_shell import LABEL_SHELL
from labeling_ui.web.guidelines import Guidelines
from labeling_ui.web.proxy_cfg import ProxyCfg
from labeling_ui.web.public_url import PublicUrl
from labeling_ui.web.tokens import TokenStore
from labeling_ui.web.visit import Visit

from .site import Site

_GUARD = GuardCfg(repeat_gap_s=0.6)
"""A browser that draws in software sends the repeats of a held key in bursts."""


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
    """Private key of the certificate, PEM."""
    public_url: PublicUrl | None = None
    """Where people open the page, if a reverse proxy stands before it."""
    auth: bool = True
    """Ask for a token; only loopback may go without."""
    most_raters: int = limits.PAGES
    """Raters whose pages are open at once; more are told when to come back."""
    shadows: bool = True
    """Draw shadows; without a graphics card they take most of the time."""
    queue: QueueCfg = field(default_factory=lambda: QueueCfg(guard=_GUARD))
    """How questions are handed out."""


class LabelServer:
    """The page of a data set, up from `start` to `stop`."""

    def __init__(
        self,
        dataset: Dataset,
        cfg: LabelCfg,
        *,
        status: StatusSource = no_status,
        picture: Picture | None = None,
    ) -> None:
        """Prepare; nothing listens yet.

        Args:
            status: Says what the loop is doing.
            picture: Draws what moved a reward about an answered pair.

        Raises:
            GaitprefError: the guidelines cannot be read.
        """
        self._dataset, self._cfg, self._status = dataset, cfg, status
        self._picture = picture
        self._guidelines = Guidelines(cfg.guidelines)

    @property
    def url(self) -> str:
        """Where the page is; known once it was started."""
        return self._site.url

    @property
    def notices(self) -> list[str]:
        """Where the page is and who could listen, line by line, once it was started."""
        return self._site.notices

    def start(self) -> None:
        """Serve the page until `stop`.

        Raises:
            GaitprefError: the port is busy, or the options would leave it unguarded.
        """
        cfg, self._store = self._cfg, self._dataset.answers()
        self._board = QuestionBoard(self._store, cfg.queue.plan.overlap)
        self._motions = MotionCache(self._dataset)
        self._site = Site(
            ProxyCfg(
                host=cfg.host,
                port=cfg.port,
                cert=cfg.cert,
                key=cfg.key,
                public_url=cfg.public_url,
                auth=cfg.auth,
                guidelines=cfg.guidelines,
                max_clients=cfg.most_raters,
            ),
            tokens=TokenStore(self._dataset.root),
            figures=lambda rater_id: rater_figures(self._store, rater_id),
            shell=LABEL_SHELL,
            status=self._status,
            together=self._store.together,
            shadows=cfg.shadows,
        )
        self._shared = Shared(
            worker=self._site.worker,
            submit_late=self._site.submit_late,
            wake=self._site.wake,
            guidelines=self._guidelines,
            picture=self._picture,
            has_names=cfg.auth,
        )
        try:
            self._board.follow()
            self._site.start(self._new_page)
        except BaseException:
            self._store.close()
            raise

    def stop(self) -> None:
        """Close the page; raters see it go on by itself when it is started again."""
        self._site.stop()
        self._store.close()

    def __enter__(self) -> LabelServer:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def _new_page(self, client: viser.ClientHandle, visit: Visit) -> Page:
        session = RaterSession(
            self._store,
            visit.rater,
            cfg=self._cfg.queue,
            board=self._board,
            rng=np.random.default_rng(),
        )
        desk = Desk(session, self._motions, may_act=visit.may_act)
        habits, marks = habits_of(visit.habits), marks_of(visit.marks)
        return Page(client, desk, self._shared, habits, marks)
