"""`gaitpref watch`: a page that follows a run without touching it."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from torch.utils.tensorboard import SummaryWriter

import gaitpref
from data.datasets.dataset import Dataset
from gaitpref.cli.commands.looking import watch as command
from gaitpref.cli.options import options
from gaitpref.loop.run_config import claim
from gaitpref.loop.run_dir import Round
from gaitpref.loop.run_inputs import inputs_of
from gaitpref.method.acceptance import Duel
from gaitpref.report import journal
from gaitpref.report.verdict import Verdict
from gaitpref.watch.event_files import RETURN, Scalars
from gaitpref.watch.run_stage import place_in
from gaitpref.watch.run_state import RunReader
from gaitpref.watch.watch_server import WatchServer
from policy.env.env_cfg import EnvCfg
from policy.robots.robot import load_robot
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from tests.helpers.older_run import older_run
from tests.helpers.small_loop import small_cfg

BROWSER = Path(command.__file__).parents[3] / "watch" / "browser"


@pytest.fixture(scope="module")
def training(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training of five iterations, of ten that were planned."""
    out = tmp_path_factory.mktemp("watch") / "walk-1"
    ppo = PpoCfg(num_envs=4, hidden_sizes=(8,))
    robot = load_robot(physics_dt_s=EnvCfg().physics_dt_s)
    train(out, robot, TrainCfg(steps=480, env=EnvCfg(), ppo=ppo, checkpoints=1))
    return out


def test_a_training_is_followed_and_left_as_it_is(training: Path) -> None:
    """Steps of how many, its two curves, that it is over; not a byte is written."""
    before = {p: (p.stat().st_mtime_ns, p.stat().st_size) for p in training.rglob("*")}
    found = RunReader(training).read()
    assert found["name"] == "walk-1"
    assert found["progress"] == {"done": 480, "of": 480, "unit": "steps"}
    assert found["finished"]
    assert found["running"] is False
    for curve in found["curves"]:
        (line,) = curve["lines"]
        assert [step for step, _ in line["points"]] == [96, 192, 288, 384, 480]
    assert before == {
        p: (p.stat().st_mtime_ns, p.stat().st_size) for p in training.rglob("*")
    }


def test_what_a_killed_training_lost_is_forgotten(tmp_path: Path) -> None:
    """It goes on further back; what cannot be read is passed over."""
    scalars = Scalars(tmp_path)
    for first, last, value in ((1, 6, 1.0), (4, 8, 2.0)):
        with SummaryWriter(str(tmp_path), filename_suffix=f".{first}") as writer:
            for step in range(first, last):
                writer.add_scalar(RETURN, value, 10 * step)
        scalars.read_on()
    (tmp_path / "events.out.tfevents.9999999999.x").write_bytes(b"no events" * 9)
    scalars.read_on()
    assert [point[:2] for point in scalars.points[RETURN]] == [
        *((10 * step, 1.0) for step in (1, 2, 3)),
        *((10 * step, 2.0) for step in (4, 5, 6, 7)),
    ]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A loop that was only begun."""
    claim(tmp_path / "run", small_cfg(), inputs_of(small_cfg()).contents)
    return tmp_path / "run"


def test_where_a_loop_is_tell_its_finished_files(run: Path) -> None:
    """Each stage from the files of the one before, to the end."""
    cfg, first, last = small_cfg(), Round(run, 0), Round(run, 2)
    seen = []

    def reached(path: Path, *, is_directory: bool = False) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir() if is_directory else path.write_text("{}")
        seen.append(place_in(run, cfg).stage)

    assert place_in(run, cfg).told == "round 1 of 2: training"
    reached(first.policy)
    reached(first.recorded)
    reached(first.reward, is_directory=True)
    reached(first.report)
    assert place_in(run, cfg).round == 1
    reached(Round(run, 1).report)
    reached(last.candidate, is_directory=True)
    assert place_in(run, cfg).told == "the last round: asking whether it worked"
    reached(last.verdict)
    reached(last.report)
    assert seen == [
        *("recording", "asking", "measuring", "training"),
        *("training", "asking", "measuring", "finished"),
    ]


def test_a_run_that_ended_is_shown_too(tmp_path: Path) -> None:
    """One of an earlier version is told as such, and no error."""
    older_run(tmp_path / "demo")
    found = RunReader(tmp_path / "demo").read()
    assert found["kind"] in ("loop", "unread")
    assert found["running"] is False


def test_what_a_run_came_to_is_shown_with_what_to_do_next(run: Path) -> None:
    """At the place where the run is, wherever it was made."""
    assert RunReader(run).read()["verdict"] is None
    surely = Duel(for_new=4, for_old=0)
    verdict = Verdict(stays=2, rounds=2, beside_first=surely)
    names = ("return_mean", "return_ci95", "tracking_error_m_s", "falls_per_minute")
    report = {"round": 2, "evaluation": dict.fromkeys(names, 1.0)}
    place = Round(run, 2).report
    place.parent.mkdir(parents=True)
    told = {**verdict.as_json(), "advice": verdict.advice(Path("RUN"))}
    place.write_text(json.dumps({**report, "verdict": told}))
    found = RunReader(run).read()
    assert found["verdict"] == verdict.sentence
    assert f"--base {run}/rounds/02/policy/policy.pt" in found["advice"]


def test_who_goes_on_otherwise_than_it_was_begun_is_told(tmp_path: Path) -> None:
    """Of what decides and is no setting: versions, code, processes."""
    assert journal.note_start(tmp_path, "gaitpref loop --run r") == ""
    assert journal.note_start(tmp_path, "gaitpref loop --run r") == ""
    file = tmp_path / journal.JOURNAL_NAME
    (begun, *_) = journal.read_journal(tmp_path).starts
    file.write_text(file.read_text().replace(begun.versions["torch"], "0.1"))
    changed = journal.note_start(tmp_path, "", processes=2)
    assert changed == f"torch 0.1 -> {begun.versions['torch']}, processes 1 -> 2"
    assert begun.versions["gaitpref"].startswith(f"{gaitpref.__version__}+")


def test_the_journal_tells_starts_and_durations(tmp_path: Path) -> None:
    """A round counts from its last start on; a broken line is passed over."""
    journal.note_start(tmp_path, "gaitpref loop --run r")
    journal.note_round(tmp_path, 0)
    with (tmp_path / journal.JOURNAL_NAME).open("a") as file:
        file.write("{\n")
    journal.note_round(tmp_path, 0)
    journal.note_start(tmp_path, "")
    journal.note_round(tmp_path, 1)
    found = journal.read_journal(tmp_path)
    assert [start.command for start in found.starts] == ["gaitpref loop --run r", ""]
    assert "torch" in found.starts[0].versions
    assert list(found.done) == [0, 1]
    began = found.starts[0].at
    later = journal.Journal(
        starts=(found.starts[0],),
        done={0: began + timedelta(seconds=30), 1: began + timedelta(seconds=100)},
    )
    assert (later.took_s(0), later.took_s(1), later.took_s(2)) == (30.0, 70.0, None)


@contextmanager
def served(run: Path, port: int = 0) -> Iterator[str]:
    """The page of a run, in a thread; gives its address."""
    server, stopped, ready = (
        WatchServer(run, port),
        threading.Event(),
        threading.Event(),
    )

    def wait() -> None:
        stopped.wait()

    thread = threading.Thread(target=lambda: asyncio.run(server.serve(ready.set, wait)))
    thread.start()
    assert ready.wait(30)
    try:
        yield server.url
    finally:
        stopped.set()
        thread.join()


def got(url: str, **headers: str) -> tuple[int, str, str]:
    """Status, policy and text of an answer."""
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers)) as ok:
            policy = ok.headers["Content-Security-Policy"]
            return ok.status, policy, ok.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, "", error.read().decode()


def state(url: str) -> dict[str, Any]:
    return json.loads(got(f"{url}state.json")[2])


def test_the_page_is_for_this_machine_and_takes_nothing_from_elsewhere(
    training: Path,
) -> None:
    """Under no foreign name, with nothing to send; its scripts are its own."""
    with served(training) as url:
        status, policy, text = got(url)
        assert status == 200
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert not re.findall(r"https?://(?!www\.w3\.org)", text)
        assert got(url, Host="evil.example")[0] == 403
        assert got(f"{url}report")[0] == 404
        assert got(f"{url}../policy.pt")[0] == 404
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(url, data=b"x")
        refused.value.close()
        assert refused.value.code == 405


def test_the_page_waits_for_a_run_and_outlives_it(run: Path) -> None:
    """Before there is one, as it goes on, when it is gone and when another begins."""
    elsewhere = run.with_name("later")
    with served(elsewhere) as url:
        assert state(url)["kind"] == "empty"
        shutil.copytree(run, elsewhere)
        dataset = Dataset.create(elsewhere / "dataset")
        _until(url, "kind", "loop")
        assert state(url)["answers"] == {"given": 0, "most": 24, "open": 0}
        assert state(url)["progress"]["of"] == small_cfg().steps.base
        assert dataset.root.exists()
        shutil.rmtree(elsewhere)
        _until(url, "kind", "empty")
        shutil.copytree(run, elsewhere)
        (elsewhere / "config.yaml").write_text("{")
        _until(url, "kind", "unread")
        assert "config.yaml" in state(url)["told"]


def _until(url: str, key: str, value: str) -> None:
    deadline_s = time.monotonic() + 60
    while state(url)[key] != value:
        assert time.monotonic() < deadline_s, state(url)
        time.sleep(0.2)


def test_a_file_is_no_run(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(command.GaitprefError, match="is no directory"):
        command.run(options.Watch(run=tmp_path / "file", port=0))


def _luminance(colour: str) -> float:
    digits = colour.lstrip("#")
    digits = "".join(2 * d for d in digits) if len(digits) == 3 else digits
    parts = (int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4))
    red, green, blue = (
        part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4
        for part in parts
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_words_can_be_read_in_both_themes() -> None:
    """At least 4.5 to 1, as WCAG AA asks."""
    css = (BROWSER / "watch.css").read_text()
    themes = re.findall(r":root \{(.*?)\}", css, re.DOTALL)
    assert len(themes) == 2
    for theme in themes:
        colours = dict(re.findall(r"--(\w+): (#\w+)", theme))
        for ground in ("paper", "card"):
            for ink in ("ink", "soft", "accent", "other", "good", "bad"):
                a, b = _luminance(colours[ink]), _luminance(colours[ground])
                assert (max(a, b) + 0.05) / (min(a, b) + 0.05) >= 4.5, (ink, ground)


@pytest.mark.browser
def test_the_page_in_a_browser(training: Path) -> None:
    """It draws both curves, says that its server is gone, and goes on afterwards."""
    from tests.helpers.label_browser import launched

    with launched() as browser:
        page = browser.new_page()
        problems: list[str] = []
        page.on("console", lambda message: problems.append(message.text))
        page.set_default_timeout(60_000)
        with served(training) as url:
            page.goto(url)
            page.get_by_role("status").get_by_text("Finished").wait_for()
            assert page.locator("polyline").count() == 2
            name = page.get_by_role("img", name="Tracking error").get_attribute(
                "aria-label"
            )
            assert name
            assert "after 480 steps" in name
            assert not problems
        page.get_by_role("alert").get_by_text("does not answer").wait_for()
        port = int(url.rstrip("/").rpartition(":")[2])
        with served(training, port):
            page.get_by_text("does not answer").wait_for(state="hidden")
