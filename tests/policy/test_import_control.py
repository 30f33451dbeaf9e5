"""Imported policies of others against plain MuJoCo: the import adds no error."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from policy.imported.alternatives import tried
from policy.imported.bring import Understood, bring, embodied, understand
from policy.imported.trial import ASKED, measure
from policy.law.origin import Measured, Origin
from policy.training.checkpoint import load_policy
from tests.helpers.others import (
    CPP_DEPLOY,
    GO2,
    HIMLOCO,
    ROBOT_LAB,
    cpp_deploy_told,
    needs_others,
    plainer_go2,
    rl_sar_told,
)
from tests.helpers.plain_walk import walked

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
Command = tuple[float, float, float]
FILES = {"robot_lab": ROBOT_LAB, "himloco": HIMLOCO, "cpp_deploy": CPP_DEPLOY}
SLOW, FAST = (0.5, 0.0, 0.0), (1.0, 0.0, 0.0)
TURN, SPIN = (0.0, 0.0, 0.5), (0.0, 0.0, 1.0)


def _understood(name: str) -> Understood:
    if name == "cpp_deploy":
        pytest.importorskip("onnx", reason="the extra onnx is not installed")
    return understand(FILES[name])


@pytest.fixture(scope="module")
def brought(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Origin]:
    """The papers of a policy, out of its file."""

    @cache
    def of(name: str) -> Origin:
        out = tmp_path_factory.mktemp(name)
        bring(_understood(name), GO2, out)
        origin = load_policy(out / "policy.pt").info.origin
        assert origin is not None
        return origin

    return of


@cache
def _network(name: str) -> Callable[[np.ndarray], np.ndarray]:
    """A network as it came, run by torch or onnxruntime."""
    if name == "cpp_deploy":
        onnxruntime = pytest.importorskip(
            "onnxruntime", reason="the extra export is not installed"
        )
        session = onnxruntime.InferenceSession(
            str(CPP_DEPLOY / "exported" / "policy.onnx"),
            providers=["CPUExecutionProvider"],
        )
        return lambda obs: session.run(None, {"obs": obs})[0][0]
    network = torch.jit.load(FILES[name])

    def act(obs: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return network(torch.from_numpy(obs))[0].numpy()

    return act


def _walked(name: str, spec: Any, command: Command) -> np.ndarray:
    """Mean speeds over 8 s in plain MuJoCo."""
    told = cpp_deploy_told() if name == "cpp_deploy" else rl_sar_told(FILES[name])
    moved = walked(spec, told, _network(name), command, 500)
    assert len(moved) == 500
    return moved[100:].mean(axis=0)


def _of(rows: tuple[Measured, ...], command: Command) -> Measured:
    return next(row for row in rows if row.command == command)


@needs_others
@pytest.mark.parametrize(
    ("name", "command"),
    [
        *(("robot_lab", each) for each in (SLOW, FAST, TURN, SPIN)),
        *(("himloco", each) for each in (SLOW, SPIN)),
        *(("cpp_deploy", each) for each in (SLOW, TURN, SPIN)),
    ],
)
def test_an_import_walks_as_its_network_does_in_plain_mujoco(
    name: str, command: Command, brought: Callable[[str], Origin]
) -> None:
    """On the same model: what it lacks of its command is no fault of the import."""
    plain = _walked(name, mujoco.MjSpec.from_file(str(GO2)), command)
    row = _of(brought(name).acceptance, command)
    assert row.fell_at_s is None
    assert row.done == pytest.approx(tuple(plain), abs=0.05)


@needs_others
@pytest.mark.parametrize(
    ("name", "forward_m_s", "within", "verdict"),
    [
        ("robot_lab", 0.50, 0.1, "accepted"),
        (
            "himloco",
            0.45,
            0.05,
            r"accepted but for: turning 0\.5 rad/s \(-?0\.0\d\), "
            r"turning 1\.0 rad/s \(-?0\.0\d\)",
        ),
        (
            "cpp_deploy",
            0.45,
            0.1,
            r"accepted but for: turning 0\.5 rad/s \(0\.1\d\), "
            r"turning 1\.0 rad/s \(0\.6\d\)",
        ),
    ],
)
def test_policies_of_others_stand_and_walk(
    name: str,
    forward_m_s: float,
    within: float,
    verdict: str,
    brought: Callable[[str], Origin],
) -> None:
    """By what lies beside them alone; what they do not follow stands in their file."""
    origin = brought(name)
    assert [row.command for row in origin.acceptance] == list(ASKED)
    assert all(row.follows for row in origin.acceptance[:3])
    forward = _of(origin.acceptance, SLOW).forward_m_s
    assert forward == pytest.approx(forward_m_s, abs=within)
    assert re.fullmatch(verdict, origin.verdict), origin.verdict


@needs_others
@pytest.mark.parametrize(("asked", "done"), [(0.0, 0.0), (0.5, 0.66)])
def test_himloco_turns_where_it_walks(asked: float, done: float) -> None:
    """On the spot its network does not, whoever runs it."""
    spec = mujoco.MjSpec.from_file(str(GO2))
    found = _walked("himloco", spec, (asked, 0.0, 1.0))[2]
    assert found == pytest.approx(done, abs=0.05)


@needs_others
@pytest.mark.parametrize(
    ("command", "column", "named", "within"),
    [(SLOW, 0, 0.50, 0.05), (FAST, 0, 1.02, 0.06), (SPIN, 2, 1.01, 0.05)],
)
def test_the_figures_named_elsewhere_are_of_a_plainer_robot(
    command: Command, column: int, named: float, within: float
) -> None:
    """Feet that do not resist rolling, joints without dry friction."""
    found = _walked("robot_lab", plainer_go2(), command)[column]
    assert found == pytest.approx(named, abs=within)


@needs_others
@pytest.mark.parametrize(
    ("name", "commands", "named"),
    [
        ("robot_lab", (SLOW, SPIN), (0.50, 1.01)),
        ("himloco", (SLOW,), (0.45,)),
        ("cpp_deploy", (SLOW,), (0.45,)),
    ],
)
def test_on_that_robot_an_import_reaches_what_is_named_elsewhere(
    name: str, commands: tuple[Command, ...], named: tuple[float, ...], tmp_path: Path
) -> None:
    """Within 0.05 m/s and rad/s."""
    spec = plainer_go2()
    spec.compile()
    (tmp_path / "go2.xml").write_text(spec.to_xml())
    known = _understood(name)
    law, robot, cfg = embodied(known, tmp_path / "go2.xml")
    network = known.found.network(tuple(int(joint) for joint in law.to_canonical))
    rows = measure(lambda obs, noise=None: network(obs), robot, cfg, asked=commands)
    found = [row.yaw_rad_s if row.command[2] else row.forward_m_s for row in rows]
    assert found == pytest.approx(list(named), abs=0.05)


@needs_others
def test_what_is_tried_is_asked_to_turn_too() -> None:
    """And to walk faster; all of it says what is closer."""
    told = next(tried(understand(ROBOT_LAB), GO2))
    assert re.search(
        r"feet .*: walks 0\.\d\d of 0\.5 m/s, walks 0\.9\d of 1\.0 m/s, "
        r"turns [01]\.\d\d of 1\.0 rad/s, closer than what was taken",
        told,
    )
