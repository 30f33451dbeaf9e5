"""`gaitpref label`: the labeling page; needs torch only where a reward is given."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from data.datasets.dataset import Dataset
from gaitpref.cli.options import options
from gaitpref.cli.shared.dataset_argument import address
from gaitpref.cli.shared.next_of_answers import next_once_answered
from gaitpref.cli.shared.serving import require_port, stoppable, wait_until_stopped
from gaitpref.console.browser import open_page
from gaitpref.console.extras import require
from gaitpref.console.progress import console
from labeling_ui.label_server import LabelCfg, LabelServer
from labeling_ui.page.page_access import Picture
from labeling_ui.web.public_url import parse_public_url
from labeling_ui.web.tokens import TokenStore


def run(command: options.Label) -> int:
    """Serve the page until it is stopped; gives the exit code."""
    cfg = label_cfg(command)
    dataset = _dataset(command)
    picture = _pictures(command, dataset)
    with stoppable() as stopped, LabelServer(dataset, cfg, picture=picture) as page:
        for line in greeting(page.notices, dataset.root, cfg):
            print(line, flush=True)
        print("Ctrl-C ends the page; answers are kept as they are given", flush=True)
        if command.open:
            open_page(page.url)
        wait_until_stopped(stopped)
    console.next(next_once_answered(dataset, command.answers))
    return 0


def _dataset(command: options.Label) -> Dataset:
    """The data set that was named, or the first one of who has none.

    Raises:
        MissingExtra: what records one is not installed.
        GaitprefError: it cannot be used.
    """
    answers = address(command.answers)
    if command.dataset is None:
        return require("gaitpref.cli.shared.first_clips", "train").first_clips(answers)
    return Dataset.open(command.dataset, answers=answers)


def _pictures(command: options.Label, dataset: Dataset) -> Picture | None:
    """What draws the reward that was given; nothing without one.

    Raises:
        MissingExtra: torch is not installed, which a page without a reward needs not.
        GaitprefError: it is none, or looks at something that the data set lacks.
    """
    if command.reward is None:
        return None
    require("torch", "fit")
    from gaitpref.report.crediting import load_crediting, require_fitting
    from gaitpref.report.page_pictures import answer_picture

    require_fitting(load_crediting(command.reward), dataset)
    return partial(answer_picture, dataset.root, command.reward)


def label_cfg(serving: options.Serving) -> LabelCfg:
    """The options as the server takes them.

    Raises:
        GaitprefError: the port is none, or --public-url no address.
    """
    require_port(serving.port)
    public = serving.public_url
    return LabelCfg(
        host=serving.host,
        port=serving.port,
        guidelines=serving.guidelines,
        cert=serving.cert,
        key=serving.key,
        public_url=None if public is None else parse_public_url(public),
        auth=not serving.no_auth,
        most_raters=serving.most_raters,
    )


def greeting(notices: list[str], dataset: Path, cfg: LabelCfg) -> list[str]:
    """Where the page is, and how to get in."""
    if not cfg.auth:
        return notices
    known, url = len(TokenStore(dataset).names()), notices[0].split()[-1]
    have = "1 rater has a token" if known == 1 else f"{known} raters have a token"
    more = f"gaitpref raters --dataset {dataset} add NAME --url {url}"
    return [*notices, f"{have}; a login link for one more: {more}"]
