"""What the house looks like: files a folder, floors, circles, names that stand twice.

    python -m benchmarks.count_house [--root CHECKOUT] [--json]

A room is a folder with modules; it stands one floor above the highest room that its
modules import from. Only source text is read, so that any checkout can be counted,
older ones too.
"""

from __future__ import annotations

import ast
import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import tyro
from rich.console import Console
from rich.table import Table

PACKAGES = ("data", "rewardmodel", "policy", "labeling_ui", "gaitpref")
Arrows = dict[str, set[str]]
"""What each module, or room, imports of the others."""


@dataclass(frozen=True, kw_only=True)
class Count:
    """Count the house."""

    root: Path = Path(".")
    """The checkout."""
    json: bool = False
    """Print JSON in place of a table."""


@dataclass(frozen=True)
class Shape:
    """What there is to find one's way in."""

    files: dict[str, int]
    """Modules of each room."""
    floors: dict[str, int]
    """Floor of each room, 0 for one that imports no other; of none in a circle."""
    arrows: dict[str, int]
    """Between the rooms of each package."""
    circle: tuple[str, ...]
    """Rooms that import each other in a circle, the first again at the end."""
    modules_circle: tuple[str, ...]
    """Modules that do."""
    twice: dict[str, tuple[str, ...]]
    """File names that stand in more than one room."""


def modules(root: Path) -> dict[str, Path]:
    """Every module of the packages by its dotted name."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            name = ".".join(path.relative_to(root).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


def imports(root: Path) -> Arrows:
    """Modules that each module imports, at any depth of its code."""
    known = modules(root)
    return {
        name: {other for other in _imported(name, path, known) if other != name}
        for name, path in known.items()
    }


def _imported(name: str, path: Path, known: Mapping[str, Path]) -> Iterator[str]:
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) + 1 - node.level]
            parts = [*above, node.module] if node.level else [node.module]
            base = ".".join(part for part in parts if part)
            for alias in node.names:
                if f"{base}.{alias.name}" in known:
                    yield f"{base}.{alias.name}"
                elif base in known:
                    yield base


def room_of(module: str, path: Path) -> str:
    """The folder of a module; of a package's `__init__`, the package."""
    return module if path.name == "__init__.py" else module.rpartition(".")[0]


def rooms(root: Path) -> Arrows:
    """Rooms that each room imports from.

    What a package's `__init__` hands on to those outside is no way through the house.
    """
    known = modules(root)
    found: Arrows = defaultdict(set)
    for name, targets in imports(root).items():
        if known[name].name == "__init__.py":
            continue
        own = room_of(name, known[name])
        found[own] |= {room_of(other, known[other]) for other in targets} - {own}
    return dict(found)


def circle_in(arrows: Arrows) -> tuple[str, ...]:
    """A circle of the arrows, or nothing."""
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        return tuple(error.args[1])
    return ()


def shape_of(root: Path) -> Shape:
    """Count a checkout."""
    known = modules(root)
    files: Counter[str] = Counter()
    names: dict[str, list[str]] = defaultdict(list)
    for name, path in known.items():
        if path.name == "__init__.py":
            continue
        files[room_of(name, path)] += 1
        names[name.rpartition(".")[2]].append(name)
    between = rooms(root)
    circle = circle_in(between)
    return Shape(
        files=dict(sorted(files.items())),
        floors={} if circle else _floors(between),
        arrows={
            package: sum(
                len([b for b in targets if b.split(".")[0] == package])
                for own, targets in between.items()
                if own.split(".")[0] == package
            )
            for package in PACKAGES
        },
        circle=circle,
        modules_circle=circle_in(imports(root)),
        twice={name: tuple(own) for name, own in sorted(names.items()) if len(own) > 1},
    )


def _floors(arrows: Arrows) -> dict[str, int]:
    floors: dict[str, int] = {}
    for room in TopologicalSorter(arrows).static_order():
        floors[room] = 1 + max((floors[b] for b in arrows.get(room, ())), default=-1)
    return dict(sorted(floors.items()))


def main(options: Count) -> None:
    """Count, print."""
    shape = shape_of(options.root)
    if options.json:
        print(json.dumps(asdict(shape)))
        return
    table = Table("room", "files", "floor")
    for room, count in shape.files.items():
        table.add_row(room, str(count), str(shape.floors.get(room, "in a circle")))
    console = Console()
    console.print(table)
    for package, count in shape.arrows.items():
        own = [room for room in shape.files if room.split(".")[0] == package]
        console.print(f"{package}: {len(own)} rooms, {count} arrows between them")
    console.print(f"circle of rooms: {' -> '.join(shape.circle) or 'none'}")
    console.print(f"circle of modules: {' -> '.join(shape.modules_circle) or 'none'}")
    for name, own in shape.twice.items():
        console.print(f"{name}.py stands in {', '.join(own)}")


if __name__ == "__main__":
    main(tyro.cli(Count, description=__doc__))
