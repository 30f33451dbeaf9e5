"""What the pages say to type is typed, in a reader's directory, made small."""

from __future__ import annotations

import itertools
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from functools import cache
from pathlib import Path

import mujoco
import pytest

from data.datasets.dataset import Dataset
from gaitpref.cli.main import main
from gaitpref.cli.shared.off_policy import EXIT_NO_GAIN
from gaitpref.film.camera import Camera, NoRenderer
from policy.robots.shipped import WALK
from tests.helpers import few_evaluated
from tests.helpers.local_host import free_port
from tests.helpers.readers_world import ROOT, make_readers_world

DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = (ROOT / "README.md", *(p for p in DOCS if p.name != "quickstart.md"))
"""The quickstart has a test of its own."""
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
LINE = re.compile(r"^(?:gaitpref|python|make|pip|torchrun|ray|createdb|export) ")
INSTEAD = {
    "rounds/02/": "rounds/01/",
    "demo/rounds/01/reward": "demo/rounds/00/reward",
    "group:ann": "group:simulated:crouch",
    "--part train=0.8 --part test=0.2": "--part train=0.5 --part test=0.5",
    "ros2 walk_bag": "ros2 walk.mcap",
    "runs/logs --count 50": "runs/logs --count 20",
    "--device cuda": "",
    "after=runs/demo/rounds/01/policy/policy.pt": f"after={WALK}",
    "--law law.toml": "--law filled.toml",
    "postgresql://ann@db.example.org/gaits": "$POSTGRES",
    "s3://lab/gaits": "lab",
    "HASH": "$HASH",
    "gold PAIR": "gold $PAIR",
    "runs/high --init runs/walk/policy.pt": f"runs/high --init {WALK}",
    "runs/crouch --init runs/walk/policy.pt": f"runs/crouch --init {WALK}",
    "--steps 2000000": "--steps 256",
    "--steps 1200000": "--steps 512",
    "--labels 60": "",
}
"""What is typed in place of what the page says; nothing else differs but `SMALL`."""
SMALL = {
    "loop": "--rounds 1 --labels 8 --steps 96",
    "train": "--steps 96 --envs 4",
    "record": "--episodes 24",
    "team train": "--steps 96 --robots 4",
    "team record": "--episodes 24 --episode-s 2",
    "evaluate": "--episodes 4",
    "arena": "--episodes 5 --most 3",
    "film": "--duration-s 1 --fps 5",
    "sweep": "--dry-run",
}
"""What is typed behind a command so that it is short."""
ELSEWHERE = {
    "make demo": "benchmarks: minutes",
    "make test": "this is it",
    "pip install": "what CI does first",
    "createdb": "tests/helpers/postgres.py makes the data base",
    "torchrun": "tests/policy/test_ranks.py starts ranks",
    "gaitpref answer --dataset runs/clips --rater openai:": "test_programs serves one",
    "ray start": "tests/policy/test_actors.py starts Ray",
    "gaitpref loop --run runs/up": "tests/loop/test_loop.py begins lying",
    "gaitpref loop --run runs/getup": "tests/loop/test_loop.py begins lying",
    "gaitpref loop --run runs/ours": "tests/house/test_quickstart.py serves one",
    "gaitpref loop --run runs/own --criterion": "tests/house/test_examples.py has one",
    "gaitpref options": "tests/policy/test_options.py learns to the end, a few steps",
    "gaitpref record --policy runs/choose": "tests/policy/test_options.py",
    "gaitpref pairs --dataset runs/judged": "tests/policy/test_options.py",
    "gaitpref label --dataset runs/judged": "tests/policy/test_options.py draws it",
    "gaitpref train --out runs/actors": "tests/policy/test_actors.py starts actors",
    "gaitpref train --out runs/cluster": "tests/policy/test_actors.py starts Ray",
}
"""Lines that are not typed here, and where what they do is tried."""
SERVERS = ("label", "play", "watch")


def lines(page: Path) -> list[str]:
    """Each line a reader types."""
    found = BLOCK.findall(page.read_text())
    text = "".join(text for language, text in found if language in ("", "sh", "bash"))
    found = re.sub(r"\\\n *", "", text).splitlines()
    return [line.strip() for line in found if LINE.match(line.strip())]


def test_what_is_tried_elsewhere_is_on_a_page() -> None:
    """So that no reason outlives its line."""
    found = [line for page in PAGES for line in lines(page)]
    assert len(found) > 60
    gone = [name for name in ELSEWHERE if not any(t.startswith(name) for t in found)]
    assert gone == []


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("reader") / "world"
    made.mkdir()
    make_readers_world(made)
    return made


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page in PAGES if lines(page)], ids=lambda page: page.stem
)
def test_the_commands_of_a_page_run(
    page: Path,
    world: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    here = tmp_path / "here"
    shutil.copytree(world, here, symlinks=True)
    monkeypatch.chdir(here)
    monkeypatch.syspath_prepend(str(here))
    few_evaluated.evaluate_few(monkeypatch)
    monkeypatch.setenv("HASH", next(here.glob("runs/demo/dataset/rollouts/*/*")).stem)
    with Dataset.open(here / "runs/clips").answers_copy() as store:
        monkeypatch.setenv("PAIR", store.pairs()[0].pair_id)
    if "postgresql://" in page.read_text():
        monkeypatch.setenv("POSTGRES", request.getfixturevalue("postgres_answers"))
    for line in lines(page):
        if not any(line.startswith(name) for name in ELSEWHERE):
            _type(line, monkeypatch)


def _type(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for old, new in INSTEAD.items():
        line = line.replace(old, new)
    words = shlex.split(re.sub(r"[][]", "", os.path.expandvars(line)), comments=True)
    if words[0] == "export":
        monkeypatch.setenv(*words[1].split("=", 1))
        return
    if words[0] == "python":
        subprocess.run([sys.executable, *words[1:]], check=True, env=_environment())
        return
    if words[1] == "film":
        monkeypatch.delenv("MUJOCO_GL")
        if not draws():
            return
    words, to = (words[:-2], words[-1]) if words[-2] == ">" else (words, "")
    small = SMALL.get(words[1]) or SMALL.get(" ".join(words[1:3]), "")
    args = words[1:] + small.split()
    if words[1] in SERVERS or "human" in words:
        if words[1] == "loop" and "--no-auth" not in words:
            _let_in(args)
        _serve(args)
        if words[1] == "label":
            _answer(args)
    elif to:
        with Path(to).open("w") as file:
            command = [sys.executable, "-m", few_evaluated.__name__, *args]
            subprocess.run(command, check=True, env=_environment(), stdout=file)
    else:
        # So few steps from data alone gain nothing, which is told by a 1.
        ended = {0, EXIT_NO_GAIN} if "--offline" in args else {0}
        assert main(args) in ended, f"{line} ended badly"


def _let_in(loop: list[str]) -> None:
    """A new loop asks for a rater, who is added."""
    assert main(loop) == 2
    dataset = f"{loop[loop.index('--run') + 1]}/dataset"
    assert main(["raters", "--dataset", dataset, "add", "ann"]) == 0


@cache
def draws() -> bool:
    """Whether this machine draws pictures of the simulation."""
    try:
        Camera(mujoco.MjModel.from_xml_string("<mujoco/>")).close()
    except NoRenderer:
        return False
    return True


def _answer(label: list[str]) -> None:
    """Answer what the page asked."""
    told = [
        word
        for name, value in itertools.pairwise(label)
        if name in ("--dataset", "--answers")
        for word in (name, value)
    ]
    assert main(["answer", "--criterion", "crouch", *told]) == 0


def _serve(args: list[str]) -> None:
    """Start the server, see that it gives its page, and stop it by Ctrl-C."""
    port = free_port()
    command = [sys.executable, "-m", few_evaluated.__name__, *args, "--port", str(port)]
    server = subprocess.Popen(command, env=_environment(), start_new_session=True)
    try:
        scheme = "https" if "--cert" in args else "http"
        _wait_for(f"{scheme}://127.0.0.1:{port}/", server)
        os.killpg(server.pid, signal.SIGINT)
        assert server.wait(60) in (0, 130)
    finally:
        if server.poll() is None:
            os.killpg(server.pid, signal.SIGKILL)
            server.wait()


def _wait_for(url: str, server: subprocess.Popen[bytes]) -> None:
    import ssl

    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    deadline = time.monotonic() + 180
    while time.monotonic() < deadline:
        assert server.poll() is None, f"{server.args} ended before it gave its page"
        try:
            urllib.request.urlopen(url, timeout=10, context=context)
            return
        except urllib.error.HTTPError:
            return  # A page that asks who it is, or for the host it is known by.
        except OSError:
            time.sleep(0.2)
    raise AssertionError(f"{server.args} gave no page")


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{os.getcwd()}"}
