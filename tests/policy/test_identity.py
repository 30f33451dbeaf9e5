"""A training goes on only under what it began with, told by contents and not names."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from policy.env.env_cfg import EnvCfg
from policy.robots.robot import Robot, load_robot
from policy.training.checkpoint import PolicyError
from policy.training.identity import content_of, differences
from policy.training.ppo import PpoCfg, ScoreFn
from policy.training.train import train
from policy.training.train_cfg import TrainCfg

PPO = PpoCfg(num_envs=4, hidden_sizes=(8,))
CFG = TrainCfg(
    steps=PPO.steps_per_iteration, env=EnvCfg(episode_s=0.4), ppo=PPO, checkpoints=0
)


@dataclass(frozen=True, eq=False)
class Paid:
    """A network and a weight, as a learned reward is."""

    network: nn.Module
    weight: float = 1.0
    history_steps: int = 0
    figures: dict[str, float] = field(default_factory=dict, compare=False)

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        self.figures["calls"] = self.figures.get("calls", 0.0) + 1.0
        return self.weight * self.network(features)[..., 0].detach()


def paid(bias: float = 0.0, weight: float = 1.0) -> ScoreFn:
    network = nn.Linear(90, 1)
    nn.init.ones_(network.weight)
    nn.init.constant_(network.bias, bias)
    return Paid(network, weight)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot(physics_dt_s=CFG.env.physics_dt_s)


@pytest.fixture(scope="module")
def policies(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two policy files of different seeds."""
    root = tmp_path_factory.mktemp("init")
    return [
        train(root / str(seed), robot, replace(CFG, seed=seed)).policy
        for seed in (0, 1)
    ]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("nothing", ""),
        ("the reward was fitted again", "reward.network.bias"),
        ("weight", "reward.weight 1.0 -> 3.0"),
        ("init", "init"),
        ("no init", "init .* -> None"),
        ("no reward", "reward .* -> None"),
        ("a setting", r"env.action_scale_rad [\d.]+ -> 0.123"),
    ],
)
def test_a_training_goes_on_under_the_same_contents_only(
    robot: Robot, policies: list[Path], tmp_path: Path, change: str, told: str
) -> None:
    """All of them are called the same; a copy of the same file is the same."""
    begun = tmp_path / "begun.pt"
    begun.write_bytes(policies[0].read_bytes())
    out = tmp_path / "out"
    train(out, robot, CFG, reward_fn=paid(), reward_name="r", init=begun)
    reward: ScoreFn | None = paid()
    init: Path | None = policies[0]
    cfg = replace(CFG, steps=2 * CFG.steps)
    match change:
        case "the reward was fitted again":
            reward = paid(bias=0.5)
        case "weight":
            reward = paid(weight=3.0)
        case "init":
            init = policies[1]
        case "no init":
            init = None
        case "no reward":
            reward = None
        case "a setting":
            cfg = replace(cfg, env=replace(cfg.env, action_scale_rad=0.123))

    def go_on() -> int:
        return train(
            out, robot, cfg, reward_fn=reward, reward_name="r", init=init, resume=True
        ).steps

    if change == "nothing":
        assert go_on() == 2 * CFG.steps
        return
    before = (out / "resume.pt").read_bytes()
    with pytest.raises(PolicyError, match=rf"other settings \(.*{told}"):
        go_on()
    assert (out / "resume.pt").read_bytes() == before


def test_equal_contents_tell_the_same_and_others_do_not() -> None:
    """Whatever a reward is made of: arrays, functions and what they close over."""

    def closed(over: float):
        def score(features: Tensor, starts: Tensor) -> Tensor:
            return over * features[..., 0]

        return score

    class Kept:
        def __init__(self, value: float) -> None:
            self.value = value

    alike = [
        (closed(1.0), closed(1.0)),
        (partial(max, 1), partial(max, 1)),
        (Kept(1.0), Kept(1.0)),
        (torch.arange(3.0), torch.arange(3.0)),
        (0.1 + 0.2, 0.3),
        (paid(), paid()),
    ]
    for one, other in alike:
        assert differences(content_of(one), content_of(other)) == []
    apart = [
        (closed(1.0), closed(2.0)),
        (partial(max, 1), partial(max, 2)),
        (partial(max, 1), partial(min, 1)),
        (Kept(1.0), Kept(2.0)),
        (torch.arange(3.0), torch.arange(3)),
        (np.zeros((2, 3)), np.zeros((3, 2))),
        (nn.ReLU(), nn.ELU()),
        (1.0, 1.001),
        (True, None),
    ]
    for one, other in apart:
        assert differences(content_of(one), content_of(other))


def test_an_edited_function_is_another(tmp_path: Path) -> None:
    """Its name is the same, as after an edit between a kill and a resume."""
    contents = []
    for factor in (1, 2):
        path = tmp_path / f"v{factor}" / "wish.py"
        path.parent.mkdir()
        path.write_text(
            f"def wish(features):\n    return {factor} * features[..., 0]\n"
        )
        scope: dict[str, object] = {"__name__": "wish"}
        exec(compile(path.read_text(), str(path), "exec"), scope)
        contents.append(content_of(scope["wish"]))
    assert [told.split(" ")[0] for told in differences(*contents)] == ["source"]


def test_a_function_that_moved_to_another_module_is_the_same() -> None:
    told = content_of(partial(paid, bias=1.0))
    moved = json.loads(json.dumps(told).replace(__name__, "elsewhere.paid_by"))
    assert moved != told
    assert differences(moved, told) == []
    renamed = json.loads(json.dumps(told).replace(":paid", ":spent"))
    assert [each.split(" ")[0] for each in differences(renamed, told)] == ["0.function"]
