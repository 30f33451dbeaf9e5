"""The house: who may import whom, and whose packages these are."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest

from benchmarks.count_house import Shape, imports, shape_of

ROOT = Path(__file__).resolve().parents[2]
OURS = {"data", "gaitpref", "labeling_ui", "policy", "rewardmodel"}
FORBIDDEN = {
    "data": {
        "aiohttp",
        "gaitpref",
        "labeling_ui",
        "mujoco",
        "policy",
        "rewardmodel",
        "rsl_rl",
        "torch",
        "viser",
    },
    "rewardmodel": {"gaitpref", "labeling_ui", "mujoco", "policy", "rsl_rl", "viser"},
    "policy": {"aiohttp", "gaitpref", "labeling_ui", "rewardmodel", "viser"},
    "labeling_ui": {"gaitpref", "policy", "rewardmodel", "rsl_rl", "torch"},
}


def imported_packages(source: str) -> set[str]:
    """Top-level packages a module imports absolutely, at any depth of its code."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.add(node.module.partition(".")[0])
    return found


@pytest.mark.parametrize("package", FORBIDDEN)
def test_a_room_knows_only_what_it_needs(package: str) -> None:
    """No module of a package imports what its package may not know."""
    wrong = {
        str(path.relative_to(ROOT)): sorted(imports)
        for path in (ROOT / package).rglob("*.py")
        if (imports := imported_packages(path.read_text()) & FORBIDDEN[package])
    }
    assert not wrong


@pytest.mark.parametrize("package", sorted(OURS))
def test_the_names_are_this_checkouts(package: str) -> None:
    """`data` and `policy` also exist on the package index: ours are imported here."""
    module = importlib.import_module(package)
    assert module.__file__ is not None
    assert Path(module.__file__).resolve().parent == ROOT / package


def imported_modules(source: str) -> set[str]:
    """Modules a module imports, as it spells them, and each name it takes of them."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            found.add(module)
            joined = module if module.endswith(".") else f"{module}."
            found |= {f"{joined}{alias.name}" for alias in node.names}
    return found


OPTIONS = "gaitpref/cli/options"
WITH_EFFECTS = {
    "data.answers.backend",
    "data.answers.store",
    "data.datasets.dataset",
    "data.episodes.episode",
    "data.files.files",
    "data.files.yaml_file",
    "io",
    "json",
    "mujoco",
    "os",
    "pathlib",
    "policy.training.checkpoint",
    "policy.training.train",
    "rewardmodel.models.storage",
    "rich",
    "shutil",
    "sqlite3",
    "sys",
    "yaml",
}
"""What opens files, data bases, simulators or a console."""


def test_the_method_decides_without_files_data_bases_or_a_console() -> None:
    """Nor does it know the stages that act on what it decides."""
    modules = sorted((ROOT / "gaitpref/method").glob("*.py"))
    assert len(modules) > 10
    for path in modules:
        for module in imported_modules(path.read_text()):
            assert not module.startswith(("..", "gaitpref")), (path.name, module)
            above = module.split(".")
            spelled = {".".join(above[: end + 1]) for end in range(len(above))}
            assert not spelled & WITH_EFFECTS, (path.name, module)


def test_help_needs_no_torch() -> None:
    """The options import neither torch nor a simulator."""
    heavy = {"mujoco", "numpy", "rsl_rl", "torch", "viser"}
    for path in ("gaitpref/cli/main.py", *sorted((ROOT / OPTIONS).glob("*.py"))):
        assert not imported_packages((ROOT / path).read_text()) & heavy, path


@pytest.fixture(scope="module")
def shape() -> Shape:
    return shape_of(ROOT)


def test_no_rooms_and_no_modules_import_each_other_in_a_circle(shape: Shape) -> None:
    assert shape.circle == ()
    assert shape.modules_circle == ()


def test_no_folder_holds_more_than_twenty_files(shape: Shape) -> None:
    assert {room: n for room, n in shape.files.items() if n > 20} == {}


def test_a_file_name_means_one_thing(shape: Shape) -> None:
    """A command's module is called like the command; each package has its errors."""
    several = {
        name: places
        for name, own in shape.twice.items()
        if len(places := [p for p in own if ".cli.commands." not in p]) > 1
    }
    assert several == {"errors": ["data.errors", "rewardmodel.errors"]}


def test_the_library_does_not_import_the_command_line() -> None:
    wrong = {
        name: sorted(other for other in found if other.startswith("gaitpref.cli"))
        for name, found in imports(ROOT).items()
        if not name.startswith("gaitpref.cli") and name != "gaitpref.__main__"
    }
    assert {name: found for name, found in wrong.items() if found} == {}
