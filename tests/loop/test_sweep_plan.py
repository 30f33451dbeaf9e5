"""What a sweep varies: from the command line, from a file, into configurations."""

from __future__ import annotations

import math
import re
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
import torch

from gaitpref.cli.commands import sweep
from gaitpref.cli.main import main, parse
from gaitpref.cli.options.options import Sweep
from gaitpref.cli.shared.sweep_arguments import gpu_share, sweep_cells
from gaitpref.executor.gpu_slots import Slots
from gaitpref.executor.pieces import Failure, Outcome, Piece
from gaitpref.method.paid import AsFitted
from gaitpref.report.seed_intervals import SeedMean, t_quantile
from gaitpref.sweep.run_sweep import run_sweep
from gaitpref.sweep.sweep_cell import SweepCell
from gaitpref.sweep.sweep_plan import SweepPlan
from policy.parallel.cores import CORES
from policy.sim.making import SimCfg

YAML = """
criterion: [high_step, trot@3]
seed: [0, 1]
set: {labels: [20, 30]}
loop: {preset: quick, rounds: 3, ppo.num_envs: 64, clip-s: 2}
variants:
  default: {}
  plain: {method.paid: {class: AsFitted}, method.weight: 1, method.accept: null}
"""
TOML = """
seed = [0, 1]
criterion = ["high_step", "trot@3"]
[set]
labels = [20, 30]
[loop]
preset = "quick"
rounds = 3
clip_s = 2
ppo.num_envs = 64
[variants.default]
[variants.plain]
method = { weight = 1.0, accept = "null", paid = { class = "AsFitted" } }
"""


def cells_of(*words: str) -> list[SweepCell]:
    """The loops that a command line asks for."""
    command = parse(["sweep", "--out", "unused", *words])
    assert isinstance(command, Sweep)
    return sweep_cells(command)


def test_every_value_with_each_of_the_others_first_seeds_first() -> None:
    """Options go where they go for one loop, paths into what comes of that."""
    cells = cells_of(
        *("--criterion", "crouch", "trot@3", "--seed", "4", "0"),
        *("--set", "method.weight=1,2e0", "--set", "mistakes=0.2"),
        *("--set", "base=none", "--labels", "40"),
    )
    assert len(cells) == 8
    assert [cell.cfg.seed for cell in cells] == [4, 4, 4, 4, 0, 0, 0, 0]
    assert cells[0].name == "crouch-method.weight=1-mistakes=0.2-base=none-seed4"
    assert len({cell.name for cell in cells}) == 8
    last = cells[-1].cfg
    assert (last.criterion, last.method.weight, last.labels) == ("trot@3", 2.0, 40)
    assert last.simulated.mistakes == 0.2
    # Without a base the preset is another one, as for `gaitpref loop --base none`.
    assert (last.rounds, last.steps.base) == (4, 0)


def test_nothing_said_is_high_step_with_three_seeds() -> None:
    assert [cell.name for cell in cells_of()] == [
        f"high_step-seed{seed}" for seed in range(3)
    ]


@pytest.mark.parametrize(("name", "text"), [("p.yaml", YAML), ("p.toml", TOML)])
def test_a_file_says_it_too_and_the_command_line_counts_more(
    name: str, text: str, tmp_path: Path
) -> None:
    """Changes that go together are one thing that is varied."""
    path = tmp_path / name
    path.write_text(text.replace(', accept = "null"', ""))
    cells = cells_of("--plan", str(path), "--seed", "7", "--rounds", "2")
    assert len(cells) == 8
    assert cells[0].name == "high_step-default-labels=20-seed7"
    for cell in cells:
        cfg, plain = cell.cfg, cell.settings["variant"] == "plain"
        assert (cfg.rounds, cfg.ppo.num_envs, cfg.clips.clip_s) == (2, 64, 2.0)
        assert cfg.labels == cell.settings["labels"]
        assert cfg.steps.base == 800_000
        assert (cfg.method.weight == 1.0) == plain
        assert isinstance(cfg.method.paid, AsFitted)
        assert (cfg.method.accept is None) == (plain and name == "p.yaml")


@dataclass
class Pretended:
    """An executor that takes places on `slots` and runs nothing."""

    slots: Slots
    held: list[str] = field(default_factory=list)
    cores: list[int] = field(default_factory=list)

    def outcomes(self, pieces: Sequence[Piece]) -> Generator[Outcome]:
        """None of `pieces` ends well."""
        for piece in pieces:
            place = self.slots.take(piece.gpus)
            self.held.append("waits" if place is None else "+".join(place.gpus))
            self.cores.append(piece.cores)
            yield Outcome(piece=piece, failure=Failure("it was only pretended"))


def test_loops_on_a_gpu_share_it_and_the_others_get_none(tmp_path: Path) -> None:
    """Halves fill the one there is, and the third waits; by default each has one."""
    words = ("--set", "device=cuda,cpu", "--gpu", "0.5")
    command = parse(["sweep", "--out", "unused", *words])
    assert isinstance(command, Sweep)
    cells = sweep_cells(command)
    assert [cell.name.split("-")[1] for cell in cells] == 3 * [
        "device=cuda",
        "device=cpu",
    ]
    assert cells[0].cfg.steps.sim == SimCfg(device="cuda")
    assert cells[1].cfg.steps.sim is None
    halves = Pretended(Slots(9, ("GPU-7",)))
    run_sweep(tmp_path / "a", cells, halves, gpus=gpu_share(command, cells))
    assert halves.held == ["GPU-7", "", "GPU-7", "", "waits", ""]
    whole = Pretended(Slots(9, ("GPU-7",)))
    share = gpu_share(replace(command, gpu=None), cells)
    run_sweep(tmp_path / "b", cells, whole, gpus=share)
    assert whole.held == ["GPU-7", "", "waits", "", "waits", ""]


def test_loops_side_by_side_share_the_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two of them 16, though eight might run."""
    monkeypatch.setenv(CORES, "16")
    pretended = Pretended(Slots(9, ()))
    monkeypatch.setattr(sweep, "choose_executor", lambda **told: pretended)
    command = ["sweep", "--out", str(tmp_path / "out"), "--jobs", "8"]
    assert main([*command, "--seed", "0", "1"]) == 1
    assert pretended.cores == [8, 8]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--set method.wieght=1", "no setting method.wieght: .* did you mean weight?"),
        ("--set method.unstick.x=1", "method.unstick is null in this loop"),
        ("--set method.paid={class:AsFit}", "paid"),
        ("--set labels=some", "labels must be a whole number, got 'some'"),
        ("--set labels=3", "--labels 3 is too few"),
        ("--set seed=-1", "--seed must be at least 0, got -1"),
        ("--seed 0 -1", "--seed must be at least 0, got -1"),
        ("--set rater=human", "people cannot answer a sweep"),
        ("--set labels=20,20", "labels is given 20 twice"),
        ("--set labels=20 --set labels=30", "names one thing twice"),
        ("--set labels", "NAME=VALUE"),
        ("--set labels=[20", "no list of values"),
        ("--criterion nice", "nice"),
        ("--jobs 2 --ray local", "give no number of processes"),
        ("--device cuda --gpu 1.5", "1.5 GPUs"),
        ("--device cuda --gpu 0", "a loop that has no share sees no GPU"),
        ("--gpu 0.5", "no loop trains on one: give --device cuda too"),
        ("--device cuda --sim threads", "--sim threads runs on the processor alone"),
        ("--device cuda --algorithm fastsac", "off-policy learning is on the"),
        pytest.param(
            "--device cuda --gpu 0.5",
            "PyTorch .* finds none",
            marks=pytest.mark.skipif(torch.cuda.is_available(), reason="has a GPU"),
        ),
        ("--plan missing.yaml", "missing.yaml"),
    ],
)
def test_what_cannot_be_is_said_before_anything_starts(
    words: str,
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """In one line; no directory is made."""
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", "--out", "out", *words.split()]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("gaitpref: ")
    assert re.search(told, line)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "holds no plan"),
        ("[1, 2]", "holds no plan"),
        ("sed: [1]", "did you mean seed"),
        ("set: 3", "set must hold names and values"),
        ("seed: []", "seed has no value"),
        ("seed: &a [0]\nset: {labels: *a}", "alias"),
        ("loop: {labels: 20}\nset: {labels: [30]}", "labels is set in two places"),
        ("loop: {seed: 3}", "seed is set in two places"),
        ("seed: [0", "cannot be read"),
    ],
)
def test_a_file_that_is_no_plan(
    text: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(text)
    assert main(["sweep", "--out", str(tmp_path / "out"), "--plan", str(path)]) == 2
    assert told in capsys.readouterr().err


def test_names_of_directories_hold_any_value_and_tell_them_apart() -> None:
    """Also where two differ only in what a file name cannot hold."""
    values = ("my.module:f", "my.module/f", "../../etc", "x" * 300, "x" * 301)
    names = [cell.name for cell in SweepPlan(axes={"criterion": values}).cells()]
    assert len(set(names)) == len(names) == 15
    assert all("/" not in name and not name.startswith(".") for name in names)
    assert max(map(len, names)) < 200


def test_the_interval_of_few_seeds_is_students() -> None:
    """Quantiles as tables print them; 1, 2, 3 have a mean of 2 +- 4.303 / sqrt(3)."""
    table = {1: 12.706, 2: 4.303, 3: 3.182, 4: 2.776, 9: 2.262, 30: 2.042}
    for freedom, quantile in table.items():
        assert t_quantile(freedom) == pytest.approx(quantile, abs=5e-4)
    assert t_quantile(10**5) == pytest.approx(1.960, abs=5e-4)
    mean = SeedMean.of([1.0, 2.0, 3.0])
    assert mean.mean == 2.0
    assert mean.half_width == pytest.approx(4.3027 / math.sqrt(3), abs=1e-4)
    assert SeedMean.of([5.0]).half_width is None
