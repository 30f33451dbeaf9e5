"""`gaitpref fit` and `relabel`: where there is neither a simulator nor a page."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.data import answered_dataset, noise_episode
from data.datasets.dataset import Dataset
from data.datasets.verify import verify
from gaitpref.cli.main import main
from rewardmodel.models.storage import load_reward

pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra `parquet`")

BLOCKED = ("aiohttp", "gymnasium", "matplotlib", "mujoco", "rsl_rl", "viser", "policy")
ALLOWED = (
    *("policy", "policy.env", "policy.env.known_terms"),
    *("policy.offpolicy", "policy.offpolicy.sac_cfg"),
)
"""A method says what a learned reward is added to, and what learns from it; that needs
no simulator."""
WITHOUT = f"""
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {BLOCKED} and name not in {ALLOWED}:
            package = name.partition(".")[0]
            raise ModuleNotFoundError(f"no {{package}} here", name=package)

sys.meta_path.insert(0, Refuse())
from gaitpref.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def without_simulator(*args: object) -> subprocess.CompletedProcess[str]:
    """Run `gaitpref` in a process that can import none of BLOCKED but ALLOWED."""
    command = [sys.executable, "-c", WITHOUT, *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.fixture(scope="module")
def datasets(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two data sets of noise with 15 answers each."""
    root = tmp_path_factory.mktemp("sets")
    return [answered_dataset(root / name, 6, 15, 30).root for name in "ab"]


def test_fit_and_relabel_need_no_simulator(
    datasets: list[Path], tmp_path: Path
) -> None:
    """Both run where mujoco, rsl_rl, viser and hardly any of our own `policy` can be
    imported."""
    a, b = datasets
    Dataset.open(b).add_episodes([noise_episode(99, 70)])
    reward, out = tmp_path / "reward", tmp_path / "reward.parquet"
    sets = ["--dataset", a, "--dataset", b]
    fitted = without_simulator("fit", *sets, "--out", reward)
    assert fitted.returncode == 0, fitted.stderr
    assert "fitted" in fitted.stderr + fitted.stdout
    relabel = ["relabel", "--dataset", b, "--reward", reward, "--out", out, "--json"]
    done = without_simulator(*relabel)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"episodes": 7, "steps": 6 * 500 + 70}
    assert not verify(b).damages
    refused = without_simulator("record", "--policy", "p", "--dataset", "d")
    assert refused.returncode == 2
    assert "pip install -e '.[train]'" in refused.stderr


def test_answers_on_a_server_are_fitted_and_trusted_as_those_of_a_file(
    datasets: list[Path],
    postgres_answers: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    served = tmp_path / "served"
    answers = ["--answers", postgres_answers]
    merge = ["data", "merge", "--dataset", str(served), "--source", str(datasets[0])]
    assert main([*merge, *answers]) == 0
    told = []
    for dataset, source in ((datasets[0], []), (served, answers)):
        there = ["--dataset", str(dataset), *source, "--json"]
        reward = str(tmp_path / f"reward-{dataset.name}")
        assert main(["fit", *there, "--out", reward]) == 0
        capsys.readouterr()
        assert main(["trust", *there, "--reward", reward]) == 0
        told.append(json.loads(capsys.readouterr().out))
    assert told[0] == told[1]
    assert told[1]["answers_are_those_fitted"]


@pytest.mark.parametrize("kind", ["linear", "posterior"])
def test_every_step_gets_the_reward_of_the_model(
    kind: str, datasets: list[Path], tmp_path: Path
) -> None:
    """A row for each step of each episode, equal to what the model says of it."""
    reward, out = str(tmp_path / "reward"), tmp_path / "reward.parquet"
    dataset = Dataset.open(datasets[0])
    on = ["--dataset", str(dataset.root), "--out", reward, "--model", kind]
    assert main(["fit", *on]) == 0
    relabel = ["relabel", "--dataset", str(dataset.root), "--reward", reward]
    assert main([*relabel, "--out", str(out)]) == 0
    table = pq.read_table(out)
    assert table.num_rows == sum(entry.num_steps for entry in dataset.entries())
    model = load_reward(Path(reward))
    frame = table.to_pydict()
    episodes, steps = np.array(frame["episode"]), np.array(frame["step"])
    for entry in dataset.entries():
        rows = torch.tensor(dataset.features(entry.sha256))[:, None]
        starts = (torch.arange(len(rows)) == 0)[:, None]
        expected = model(rows, starts)[:, 0]
        chosen = episodes == entry.sha256
        assert steps[chosen].tolist() == list(range(entry.num_steps))
        found = np.array(frame["reward"])[chosen]
        np.testing.assert_allclose(found, expected.numpy(), rtol=1e-5, atol=1e-6)


def test_what_looks_wrong_is_taken_for_random(
    datasets: list[Path], tmp_path: Path
) -> None:
    """Without a simulator too; of noise, some answers always look wrong."""
    reward = tmp_path / "reward"
    fit = ["fit", "--dataset", datasets[0], "--dataset", datasets[1], "--out", reward]
    fitted = without_simulator(*fit, "--doubted-below", "0.4")
    assert fitted.returncode == 0, fitted.stderr
    assert (
        "answers look wrong and are taken for random" in fitted.stderr + fitted.stdout
    )
    doubted = load_reward(reward).provenance.report.doubted
    assert 0 < doubted < 30


def test_a_limit_that_doubts_everything_is_refused(
    datasets: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fit = ["fit", "--dataset", str(datasets[0]), "--out", str(tmp_path / "reward")]
    assert main([*fit, "--doubted-below", "0.7"]) == 2
    assert "--doubted-below must lie in [0, 0.5), got 0.7" in capsys.readouterr().err
    assert not (tmp_path / "reward").exists()
