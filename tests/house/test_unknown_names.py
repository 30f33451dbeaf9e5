"""A name nobody knows is refused, and is never taken for the default."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from gaitpref.adapters.step_reward import StepReward
from gaitpref.cli import main as cli
from gaitpref.cli.commands import fit as fit_command
from gaitpref.training.total_reward import total_reward
from policy.env.env_cfg import EnvCfg
from policy.env.known_terms import KnownTermsCfg
from policy.robots.robot import load_robot
from policy.training.ppo import PpoCfg
from policy.training.train import train
from policy.training.train_cfg import TrainCfg
from rewardmodel import FitCfg, RewardError, fit_reward, load_reward, save_reward
from rewardmodel.asking.strategies import make_strategy
from rewardmodel.models.ensemble import fit_ensemble
from rewardmodel.models.kinds import kind_called, prepare
from tests.rewardmodel.test_fit import answered

ROOT = Path(__file__).resolve().parents[2]


def test_an_unknown_kind_of_model_is_not_fitted_as_linear(tmp_path: Path) -> None:
    """Not by its settings, not below them, and not out of a file."""
    unknown: Any = "lineal"
    with pytest.raises(ValueError, match="called 'lineal'; there are linear"):
        FitCfg(kind=unknown)
    with pytest.raises(ValueError, match="no model is called 'lineal'"):
        kind_called("lineal")
    open_kind = FitCfg(kind="auto")
    prepared = prepare(answered(10, seed=0), open_kind)
    with pytest.raises(ValueError, match="no model is called 'auto'"):
        fit_ensemble(prepared, open_kind, 0)
    model, _ = fit_reward(answered(10, seed=0), FitCfg(), seed=0, measured=False)
    save_reward(model, tmp_path)
    facts = tmp_path / "reward.json"
    facts.write_text(facts.read_text().replace('"linear"', '"lineal"'))
    with pytest.raises(RewardError, match="a reward of kind 'lineal'"):
        load_reward(tmp_path)


def test_an_unknown_strategy_is_not_asked_as_disagreement() -> None:
    """With a reward to ask, and without one."""
    model, _ = fit_reward(answered(10, seed=0), FitCfg(), seed=0, measured=False)
    unknown: Any = "disagrement"

    def no_rows(clip: object) -> Any:
        raise AssertionError

    for reward in (model, None):
        with pytest.raises(ValueError, match="no strategy is called 'disagrement'"):
            make_strategy(unknown, reward, no_rows)
    assert make_strategy("disagreement", model, no_rows).name == "disagreement"


@dataclass(frozen=True)
class Dance:
    """A command that nobody wrote."""


def test_a_command_nobody_runs_does_not_end_well() -> None:
    dance: Any = Dance()
    with pytest.raises(TypeError, match="Dance is run by another module"):
        fit_command.run(dance)
    with pytest.raises(TypeError, match="no module runs the command Dance"):
        cli.run(dance)


class Forgetful:
    """A reward that wants to look back, and misspells it."""

    history_step = 3

    def __call__(self, features: Tensor, starts: Tensor) -> Tensor:
        return torch.zeros(features.shape[:2])


def test_a_misspelt_history_is_no_reward_that_does_not_look_back(
    tmp_path: Path,
) -> None:
    """In training, in the sum that is trained on, and step by step."""
    env = EnvCfg()
    robot = load_robot(physics_dt_s=env.physics_dt_s)
    tiny = PpoCfg(num_envs=2, hidden_sizes=(4,))
    total = total_reward(Forgetful(), robot, env, known=KnownTermsCfg())
    with pytest.raises(TypeError, match=r"Forgetful .* has no `history_steps`"):
        StepReward(Forgetful())
    for number, reward in enumerate((Forgetful(), total)):
        cfg = TrainCfg(steps=48, env=env, ppo=tiny)
        with pytest.raises(TypeError, match=r"Forgetful .* has no `history_steps`"):
            train(tmp_path / str(number), robot, cfg, reward_fn=reward)
    # A plain function cannot say, and need not.
    StepReward(lambda features, starts: torch.zeros(features.shape[:2]))


def run_with(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT
    )


@pytest.mark.parametrize(
    ("missing", "returncode", "told"),
    [
        ("gymnasium", 0, "0.1.0"),
        (
            "gaitpref.adapters.gym_registration",
            1,
            "no gaitpref.adapters.gym_registration here",
        ),
    ],
)
def test_a_module_of_ours_that_is_missing_is_not_taken_for_gymnasium(
    missing: str, returncode: int, told: str
) -> None:
    done = run_with(f"""
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name == {missing!r}:
            raise ModuleNotFoundError(f"no {{name}} here", name=name)

sys.meta_path.insert(0, Refuse())
import gaitpref
print(gaitpref.__version__)
""")
    assert done.returncode == returncode
    assert told in done.stdout + done.stderr


def test_a_module_of_ours_that_is_missing_is_no_package_to_install() -> None:
    """The error says what is missing, and not which extra would bring it."""
    done = run_with("""
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name == "rewardmodel.answers.used":
            raise ModuleNotFoundError(f"no {name} here", name=name)

sys.meta_path.insert(0, Refuse())
from gaitpref.cli.main import main
sys.exit(main(["fit", "--dataset", "d", "--out", "o"]))
""")
    assert done.returncode == 1
    assert "no rewardmodel.answers.used here" in done.stderr
    assert "pip install" not in done.stderr


def test_commands_compute_with_one_thread(tmp_path: Path) -> None:
    """However many there are, so that results do not depend on the machine."""
    done = run_with(f"""
import torch
from gaitpref.cli.main import main
torch.set_num_threads(3)
main(["trust", "--dataset", {str(tmp_path)!r}, "--reward", {str(tmp_path)!r}])
print(torch.get_num_threads())
""")
    assert done.stdout.strip() == "1", done.stderr


def test_who_imports_torch_late_computes_with_one_thread(tmp_path: Path) -> None:
    """As commands do that need it for a part of what they do."""
    done = run_with(f"""
import os, sys
os.environ["OMP_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "3"
from gaitpref.cli.main import main
main(["label", "--no-auth", "--dataset", {str(tmp_path)!r}])
main(["data", "info", "--dataset", {str(tmp_path)!r}])
assert "torch" not in sys.modules
import torch
print(torch.get_num_threads())
""")
    assert done.stdout.strip() == "1", done.stderr


def test_any_module_of_the_reward_model_can_be_imported_first() -> None:
    """None leans on the order in which the package happens to import the others."""
    done = run_with(f"""
import importlib, pathlib, sys, types

root = pathlib.Path({str(ROOT)!r}) / "rewardmodel"
for file in sorted(root.rglob("*.py")):
    if file.stem == "__init__":
        continue
    name = ".".join(("rewardmodel", *file.relative_to(root).with_suffix("").parts))
    for old in [old for old in sys.modules if old.split(".")[0] == "rewardmodel"]:
        del sys.modules[old]
    package = types.ModuleType("rewardmodel")
    package.__path__ = [str(root)]
    sys.modules["rewardmodel"] = package
    importlib.import_module(name)
print("all")
""")
    assert done.stdout.strip() == "all", done.stderr


def test_settings_that_are_replaced_are_looked_at_too() -> None:
    unknown: Any = "spare"
    with pytest.raises(ValueError, match="no model is called 'spare'"):
        replace(FitCfg(), kind=unknown)
