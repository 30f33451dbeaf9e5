"""`gaitpref label`: the labeling page of a data set; needs no torch."""

from __future__ import annotations

from pathlib import Path

from labeling_ui.server import LabelCfg, LabelServer

from . import options
from .opening import open_dataset
from .serving import require_port, wait_until_stopped


def run(command: options.Label) -> int:
    """Serve the page until it is stopped; gives the exit code."""
    cfg = label_cfg(command)
    dataset = open_dataset(command)
    with LabelServer(dataset, cfg) as page:
        for line in greeting(page.url, dataset.root, cfg):
            print(line, flush=True)
        wait_until_stopped()
    return 0


def label_cfg(serving: options.Serving) -> LabelCfg:
    """The options as the server takes them.

    Raises:
        GaitprefError: the port is none.
    """
    require_port(serving.port)
    return LabelCfg(
        host=serving.host,
        port=serving.port,
        guidelines=serving.guidelines,
        cert=serving.cert,
        key=serving.key,
        auth=not serving.no_auth,
    )


def greeting(url: str, dataset: Path, cfg: LabelCfg) -> list[str]:
    """Where the page is, and how to get in."""
    lines = [f"the labeling page is at {url}"]
    if cfg.auth:
        lines.append(f"make a token with: gaitpref raters --dataset {dataset} add NAME")
    return lines
