"""`gaitpref label`: the labeling page of a data set; needs no torch."""

from __future__ import annotations

from labeling_ui.server import LabelCfg, LabelServer
from labeling_ui.status import status_in

from . import options
from .opening import open_dataset
from .serving import require_port, wait_until_stopped

STATUS_NAME = "status.json"
"""A loop leaves here what it is doing."""


def run(command: options.Label) -> int:
    """Serve the page until it is stopped; gives the exit code."""
    require_port(command.port)
    dataset = open_dataset(command)
    cfg = LabelCfg(
        host=command.host,
        port=command.port,
        guidelines=command.guidelines,
        cert=command.cert,
        key=command.key,
        auth=not command.no_auth,
    )
    with LabelServer(
        dataset, cfg, status=status_in(dataset.root / STATUS_NAME)
    ) as page:
        print(f"the labeling page is at {page.url}", flush=True)
        if cfg.auth:
            print(
                f"make a token with: gaitpref raters --dataset {dataset.root} add NAME",
                flush=True,
            )
        wait_until_stopped()
    return 0
