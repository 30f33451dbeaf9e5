"""A GPU whose memory is full: who asks for too much is told how much would fit."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest
import torch

from gaitpref.cli.main import main
from policy.robots.robot import load_robot
from policy.sim import making
from policy.sim.device_memory import DeviceMemoryError, told_of_memory
from policy.training import train
from tests.helpers.required import needed

GB = 2**30


def given(monkeypatch: pytest.MonkeyPatch, *, free_gb: float, whole_gb: float) -> None:
    """A card of that name with that much memory."""
    told = int(free_gb * GB), int(whole_gb * GB)
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda: told)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda: "H0")


def test_how_many_worlds_would_fit_is_said_before_they_are_made(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """So many fit and not one more; on a card with twice the memory about twice."""
    mjw = needed("mujoco_warp", "WARP")
    wp = needed("warp", "WARP")
    from policy.sim.warp_memory import capacity_of, require_room

    mj_model = load_robot(physics_dt_s=0.004).mj_model
    room = capacity_of(mj_model)

    @cache
    def worlds(count: int) -> object:
        # Nothing large is made to find out.
        assert count <= 16
        return mjw.make_data(
            mj_model, count, nconmax=room.contacts, njmax=room.constraints
        )

    def fit(free_gb: float) -> int:
        given(monkeypatch, free_gb=free_gb, whole_gb=8)
        with pytest.raises(DeviceMemoryError) as raised:
            require_room(1_000_000, worlds)
        said = str(raised.value)
        assert f"1,000,000 robots do not fit into the memory of H0 ({free_gb}" in said
        found = re.search(r"about ([\d,]+) would; give fewer with --envs", said)
        assert found is not None, said
        return int(found[1].replace(",", ""))

    with wp.ScopedDevice("cpu"):
        few, more = fit(2.0), fit(4.0)
        assert 500 < few < 10_000
        assert more == pytest.approx(2 * few, rel=0.02)
        require_room(more, worlds)
        with pytest.raises(DeviceMemoryError, match=f"{more + 1:,} robots do not fit"):
            require_room(more + 1, worlds)


@pytest.mark.parametrize(
    "error",
    [
        torch.OutOfMemoryError("CUDA out of memory"),
        RuntimeError("Failed to allocate 4096 bytes on device 'cuda:0'"),
    ],
    ids=["torch", "warp"],
)
def test_memory_that_is_used_up_on_the_way_is_one_line(
    error: RuntimeError,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """64 robots took 3.5 of 4 GB: with a fifth to spare, 58 would fit."""

    def full(*told: object, **more: object) -> None:
        raise error

    given(monkeypatch, free_gb=0.5, whole_gb=4)
    monkeypatch.setattr(train, "make_env", full)
    command = ["train", "--out", str(tmp_path / "run"), "--reward", "task"]
    assert main([*command, "--envs", "64"]) == 2
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert "64 robots do not fit into the memory of H0 (0.5 of 4.0 GB are free)" in line
    assert "about 58 would; give fewer with --envs" in line


def test_other_errors_stay_what_they_are() -> None:
    with pytest.raises(RuntimeError, match=r"^a bug$"), told_of_memory(64):
        raise RuntimeError("a bug")


def test_worlds_are_on_the_card_that_its_process_trains_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As the second of two ranks, which have a card each."""
    needed("mujoco_warp", "WARP")
    from policy.sim import varied_warp, warp_sim

    made: list[str] = []

    def note(robot: object, num_envs: int, *, device: str) -> None:
        made.append(device)

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "current_device", lambda: 1)
    monkeypatch.setattr(warp_sim, "WarpSim", note)
    monkeypatch.setattr(varied_warp, "VariedWarpSim", note)
    robot = load_robot(physics_dt_s=0.005)
    for make in (making.make_sim, making.make_varied_sim):
        make(robot, 1, making.SimCfg(device="cuda"))
        make(robot, 1, making.SimCfg(kind="warp"))
    assert made == ["cuda:1", "cpu"] * 2
