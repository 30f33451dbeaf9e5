"""The first minutes: where to begin, whether all is here, and a page that opens."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import time
import webbrowser
from pathlib import Path

import pytest

from data.datasets.dataset import Dataset
from data.files.files import sha256_file
from gaitpref.cli.main import main
from gaitpref.cli.shared import policy_names
from gaitpref.cli.usage import WAYS, WELCOME, commands
from gaitpref.console.browser import has_browser, open_page
from gaitpref.doctor import installed, machine
from policy.robots.shipped import WALK


def test_gaitpref_alone_says_where_to_begin(capsys: pytest.CaptureFixture[str]) -> None:
    """Three ways in, each a command that there is; no complaint."""
    with pytest.raises(SystemExit) as caught:
        main([])
    assert caught.value.code == 0
    told = capsys.readouterr().out
    assert told.strip() == WELCOME
    ways = [line.split("gaitpref ")[1] for line in told.splitlines() if "  gai" in line]
    assert [way.split()[0] for way in ways] == ["loop", "loop", "fit"]
    assert ("doctor",) in commands()
    assert "`gaitpref doctor`" in told


def test_help_lists_every_command_by_what_it_is_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Once each, with a sentence of it."""
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    told = capsys.readouterr().out
    listed = [name for names in WAYS.values() for name in names]
    assert sorted(listed) == sorted({name for name, *_ in commands()})
    for name in listed:
        assert re.search(rf"^  {name} +[A-Z]", told, re.MULTILINE), name
    browser, loop = told.index("in the browser:"), told.index("in a loop")
    assert browser < told.index("\n  label ") < loop < told.index("\n  loop ")
    assert max(map(len, told.splitlines())) <= 80


@pytest.fixture
def told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What a browser was told to open, which is a program that writes it down."""
    file, program = tmp_path / "opened", tmp_path / "browser"
    program.write_text(f'#!/bin/sh\necho "$1" >> {file}\n')
    program.chmod(0o755)
    monkeypatch.setenv("BROWSER", str(program))
    # The module looks once.
    monkeypatch.setattr(webbrowser, "_tryorder", None)
    monkeypatch.setattr(webbrowser, "_browsers", {})
    return file


def test_a_browser_is_told_the_page(told: Path) -> None:
    open_page("http://127.0.0.1:1/?a=b")
    assert told.read_text().split() == ["http://127.0.0.1:1/?a=b"]


@pytest.mark.parametrize("command", ["play", "label"])
def test_open_shows_the_page_that_is_served(
    command: str, told: Path, tmp_path: Path
) -> None:
    """Once it is up, at the port it has; both show the walk that ships to who names
    nothing."""
    args = [command] if command == "play" else [command, "--no-auth"]
    line = [sys.executable, "-m", "gaitpref", *args, "--port", "0", "--open"]
    with subprocess.Popen(
        line, stdout=subprocess.PIPE, text=True, cwd=tmp_path
    ) as server:
        try:
            assert server.stdout is not None
            url = server.stdout.readline().split()[-1]
            deadline_s = time.monotonic() + 60
            while not told.exists() or not told.read_text():
                assert time.monotonic() < deadline_s
                time.sleep(0.05)
            assert told.read_text().split() == [url]
            server.terminate()
            assert server.wait(60) == 0
        finally:
            server.kill()
    if command == "label":
        first = Dataset.open(tmp_path / "runs/first")
        shown = {entry.meta.policy_sha256 for entry in first.entries()}
        assert shown == {sha256_file(WALK)}
        with first.answers() as store:
            assert len(store.pairs()) == 40


@pytest.mark.parametrize("browsers", ["", "w3m"])
def test_without_a_browser_the_address_is_told(
    browsers: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One in the terminal would take the terminal, and is none."""
    monkeypatch.setattr(webbrowser, "_tryorder", browsers.split())
    monkeypatch.setattr(
        webbrowser, "_browsers", {"w3m": [None, webbrowser.GenericBrowser("w3m")]}
    )
    open_page("http://127.0.0.1:1")
    assert "open http://127.0.0.1:1 yourself" in capsys.readouterr().err
    assert not has_browser()


def test_the_doctor_finds_this_machine_in_order(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["works"]
    states = {each["name"]: each["state"] for each in found["findings"]}
    assert states["packages"] == states["gaitpref"] == "ok"
    for name in (".[train]", ".[label]", ".[gpu]", "port of the pages"):
        assert states[name] in ("ok", "missing", "bad")
    for each in found["findings"]:
        assert each["advice"] or each["state"] == "ok"


def test_the_doctor_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is not there, what is too old, and what was tested otherwise."""
    here = installed._here()
    del here["viser"]
    older = {"mcap": "0.1", "tyro": here["tyro"] + ".1"}
    monkeypatch.setattr(installed, "_here", lambda: {**here, **older})
    found = {finding.name: finding for finding in installed.package_findings()}
    assert found["packages"].breaks
    assert "mcap 0.1 where" in found["packages"].told
    assert f"tyro {here['tyro']}.1 (tested with" in found["packages"].told
    label = found[".[label]"]
    assert label.state == "missing"
    assert not label.breaks
    assert "viser" in label.told
    assert label.advice == "pip install -e '.[label]' -c constraints.txt"


def test_the_doctor_fails_where_nothing_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A directory that is gone takes no files, whoever asks."""
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    monkeypatch.setattr(Path, "cwd", lambda: gone)
    assert main(["doctor"]) == 1
    assert "go to a directory of yours" in capsys.readouterr().err


def test_a_busy_port_is_told_with_a_free_one() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        found = machine.port(taken.getsockname()[1])
    assert found.state == "bad"
    free = int(found.advice.split("--port ")[1].split(",")[0])
    assert machine.port(free).state == "ok"


def test_data_info_calls_policies_by_where_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """After the directory of their training; else by what they were trained on."""
    dataset, walk = tmp_path / "set", tmp_path / "walk-1"
    walk.mkdir()
    (walk / "policy.pt").write_bytes(WALK.read_bytes())
    record = ["record", "--policy", str(walk / "policy.pt"), "--dataset", str(dataset)]
    assert main([*record, "--episodes", "2", "--episode-s", "1"]) == 0
    info = ["data", "info", "--dataset", str(dataset)]
    capsys.readouterr()
    assert main([*info, "--json"]) == 0
    names = json.loads(capsys.readouterr().out)["policy_names"]
    assert names == {sha256_file(WALK): "the walk that ships at 1.20 M steps"}
    monkeypatch.setattr(policy_names, "WALK", tmp_path / "no such file")
    found = policy_names.policy_names(Dataset.open(dataset))
    assert found == {sha256_file(WALK): "walk-1 at 1.20 M steps"}
    (walk / "policy.pt").unlink()
    found = policy_names.policy_names(Dataset.open(dataset))
    assert found == {sha256_file(WALK): "trained on task at 1.20 M steps"}
    monkeypatch.undo()
    assert main(info) == 0
    shown = capsys.readouterr()
    assert "the walk that ships at 1.20 M steps" in shown.out
    # Nobody was asked yet: no table of raters, and what comes next.
    assert "rater" not in shown.out
    assert "gaitpref pairs --dataset" in shown.err


def test_data_info_of_an_empty_set_says_how_to_fill_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = Dataset.create(tmp_path / "set").root
    assert main(["data", "info", "--dataset", str(root)]) == 0
    shown = capsys.readouterr()
    assert "policy" not in shown.out
    assert f"gaitpref record --dataset {root}" in shown.err.replace(os.linesep, "")
