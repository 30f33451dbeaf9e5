"""Sends what the live page shows to Weights & Biases, through their own client."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from data.errors import GaitprefError
from data.files.files import read_file
from gaitpref.console.extras import require
from gaitpref.loop.run_config import CONFIG_NAME

from .run_state import RunReader

_LOOK_S = 5.0
_STEPS, _ROUND = "steps", "round"
_CONFIG_BYTES = 2**20


class WandbMirror:
    """A run of theirs that follows one of ours; it may be begun again later."""

    def __init__(self, run: Path, project: str) -> None:
        """
        Raises:
            GaitprefError: their client is not installed, or nobody is logged in.
        """
        wandb = require("wandb", "wandb")
        self._reader = RunReader(run)
        place = run.resolve()
        # The same directory is the same run there, however often it is watched.
        own_id = hashlib.sha256(str(place).encode()).hexdigest()[:16]
        try:
            self._run: Any = wandb.init(
                project=project,
                name=place.name,
                id=own_id,
                resume="allow",
                config={"command": _config_of(run)},
                # Curves are wanted there, and nothing about this machine.
                settings=wandb.Settings(
                    console="off",
                    silent=True,
                    disable_git=True,
                    disable_code=True,
                    x_disable_meta=True,
                    x_disable_stats=True,
                    x_save_requirements=False,
                ),
            )
        except wandb.Error as error:
            raise GaitprefError(
                f"Weights & Biases refused: {error}; `wandb login` logs in, "
                "WANDB_MODE=offline keeps it here until `wandb sync`"
            ) from None
        self._run.define_metric("training/*", step_metric=_STEPS)
        self._run.define_metric("round/*", step_metric=_ROUND)
        self._steps, self._rounds = (
            int(self._run.summary.get(name, -1)) for name in (_STEPS, _ROUND)
        )

    @property
    def url(self) -> str:
        """Where their page of it is; empty while it is kept here."""
        return "" if self._run.offline else self._run.url

    def send(self, found: dict[str, Any]) -> None:
        """Send what is new in what `RunReader.read` gave."""
        points: dict[int, dict[str, float]] = {}
        for curve in found.get("curves", ()):
            for line in curve["lines"]:
                for steps, value in line["points"]:
                    points.setdefault(steps, {})[f"training/{curve['name']}"] = value
        for steps, values in sorted(points.items()):
            if steps > self._steps:
                self._run.log({_STEPS: steps, **values})
                self._steps = steps
        for row in found.get("table", ()):
            if row[_ROUND] > self._rounds:
                told = {
                    f"round/{name}": value
                    for name, value in row.items()
                    if isinstance(value, int | float) and name != _ROUND
                }
                self._run.log({_ROUND: row[_ROUND], **told})
                self._rounds = row[_ROUND]

    def follow(self, stopped: threading.Event) -> None:
        """Send what is new every few seconds, and at the end."""
        try:
            while not stopped.wait(_LOOK_S):
                self.send(self._reader.read())
            self.send(self._reader.read())
        finally:
            self._run.finish()

    def beside(self, stopped: threading.Event) -> Callable[[], None]:
        """Follow in a thread; gives what waits for its end."""
        thread = threading.Thread(target=self.follow, args=(stopped,), name="wandb")
        thread.start()
        return thread.join


def _config_of(run: Path) -> str:
    """The settings of a loop as its file has them; empty of a training."""
    try:
        return read_file(run / CONFIG_NAME, _CONFIG_BYTES).decode(errors="replace")
    except (GaitprefError, OSError):
        return ""
