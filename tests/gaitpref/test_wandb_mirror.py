"""A run is sent to Weights & Biases by their own client, kept on this machine."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from torch.utils.tensorboard import SummaryWriter

from gaitpref.watch.event_files import RETURN, TRACKING
from tests.helpers.waiting import wait_for

pytest.importorskip("wandb", reason="needs the extra `wandb`")

from gaitpref.watch.wandb_mirror import WandbMirror


def test_curves_and_rounds_are_sent_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What came since the last look, and nothing of this machine."""
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_DIR", str(tmp_path))
    run = tmp_path / "walk"
    with SummaryWriter(str(run)) as writer:
        for steps in (96, 192):
            writer.add_scalar(RETURN, steps / 10, steps)
            writer.add_scalar(TRACKING, 0.5, steps)
    mirror = WandbMirror(run, "gaits")
    sent: list[dict[str, float]] = []
    log = mirror._run.log
    monkeypatch.setattr(mirror._run, "log", lambda row: (sent.append(row), log(row)))
    mirror.send(mirror._reader.read())
    row = {"round": 1, "return": 3.5, "answers": 20, "took_s": None}
    mirror.send({**mirror._reader.read(), "table": [row]})
    stopped = threading.Event()
    stopped.set()
    mirror.beside(stopped)()
    curves = {"training/Return of the training", "training/Tracking error"}
    assert [set(row) - curves for row in sent[:2]] == [{"steps"}] * 2
    assert sent[2:] == [{"round": 1, "round/return": 3.5, "round/answers": 20}]
    (kept,) = tmp_path.glob("wandb/offline-run-*/*.wandb")
    # Their service writes the file, and may still do so after the run has ended.
    wait_for(lambda: b"round/answers" in kept.read_bytes())
    content = kept.read_bytes()
    for told in (b"training/Return of the training", b"19.2"):
        assert told in content
    assert b"requirements" not in content
