"""How much there is to hold in mind: settings, constants, questions and lines, counted.

python -m benchmarks.count_method [--root CHECKOUT] [--json] [--keep NAME]

Only source text is read, so that any checkout can be counted, older ones too.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import re
import subprocess
import tokenize
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from data.files.files import write_atomically

from .marks import write_between

KEPT = Path("docs/results/method_count.json")
PAGE = Path("docs/benchmarks.md")
PACKAGES = ("gaitpref", "rewardmodel", "policy")
LIBRARIES = ("data",)
"""Packages that settings may come from, and that are not counted themselves."""
SETTINGS = ("LoopCfg", "FitCfg", "TrainCfg", "PpoCfg", "Method")
ASKING = ("answers_err", "takes_to_err")
"""Functions that say whether answers err."""
THRESHOLDS = ("FEW_ERRORS", "MANY_ERRORS")
"""Shares of wrong answers that a comparison asks about."""

_CONSTANT = re.compile(r"_*[A-Z][A-Z0-9_]*$")
_LAYOUT = (
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
)


@dataclass(frozen=True)
class Module:
    """A source file of a package."""

    package: str
    path: Path
    text: str
    tree: ast.Module

    @property
    def imports(self) -> dict[str, str]:
        """The last part of the module each imported name comes from."""
        return {
            alias.asname or alias.name: (node.module or "").rpartition(".")[2]
            for node in ast.walk(self.tree)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }


def modules_of(root: Path, packages: tuple[str, ...]) -> list[Module]:
    """The modules of `packages` in the checkout at `root`, by path."""
    found = []
    for package in packages:
        for path in sorted((root / package).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            found.append(Module(package, path, text, ast.parse(text)))
    return found


class Settings:
    """The dataclasses of a checkout, followed through the annotations of fields."""

    def __init__(self, modules: list[Module]) -> None:
        self._classes: dict[str, list[tuple[Module, ast.ClassDef]]] = {}
        self._aliases: dict[str, ast.expr] = {}
        for module in modules:
            for node in module.tree.body:
                if isinstance(node, ast.ClassDef):
                    self._classes.setdefault(node.name, []).append((module, node))
                elif isinstance(node, ast.Assign):
                    names = [
                        each for each in node.targets if isinstance(each, ast.Name)
                    ]
                    self._aliases |= dict.fromkeys((n.id for n in names), node.value)

    def count(self, name: str) -> dict[str, int] | None:
        """Fields of the dataclass `name`, and settings under it that are no dataclass
        themselves; None where there is no such class."""
        if name not in self._classes:
            return None
        # A command may be called so too, and has few options.
        module, node = max(self._classes[name], key=lambda it: len(self._fields(*it)))
        own = self._fields(module, node)
        return {"fields": len(own), "leaves": self._leaves(module, node, ())}

    def _leaves(
        self, module: Module, node: ast.ClassDef, inside: tuple[str, ...]
    ) -> int:
        """Settings under a class; one that holds itself counts as one."""
        inside = (*inside, node.name)
        total = 0
        for where, annotation in self._fields(module, node).values():
            nested = [
                (owner, found)
                for owner, found in self._named_in(where, annotation)
                if found.name not in inside
            ]
            total += sum(self._leaves(*each, inside) for each in nested) or 1
        return total

    def _fields(
        self, module: Module, node: ast.ClassDef
    ) -> dict[str, tuple[Module, ast.expr]]:
        """Module and annotation of each field, inherited ones first."""
        found: dict[str, tuple[Module, ast.expr]] = {}
        for base in node.bases:
            for owner, parent in self._named_in(module, base, dataclasses=False):
                found |= self._fields(owner, parent)
        for line in node.body:
            if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name):
                annotation = line.annotation
                if "ClassVar" not in ast.unparse(annotation):
                    found[line.target.id] = module, annotation
        return found

    def _named_in(
        self, module: Module, annotation: ast.expr, *, dataclasses: bool = True
    ) -> Iterator[tuple[Module, ast.ClassDef]]:
        """Classes an annotation names, each once, through aliases of unions."""
        seen: set[str] = set()
        names = [node.id for node in ast.walk(annotation) if isinstance(node, ast.Name)]
        while names:
            if (name := names.pop(0)) in seen:
                continue
            seen.add(name)
            found = self._class(module, name)
            if found is not None and (_is_dataclass(found[1]) or not dataclasses):
                yield found
            elif isinstance(alias := self._aliases.get(name), ast.BinOp):
                walked = ast.walk(alias)
                names += [node.id for node in walked if isinstance(node, ast.Name)]

    def _class(self, module: Module, name: str) -> tuple[Module, ast.ClassDef] | None:
        """The class that `name` means in `module`."""
        candidates = self._classes.get(name, [])
        origin = module.imports.get(name)
        for found in candidates:
            if found[0] is module or found[0].path.stem == origin:
                return found
        return candidates[0] if candidates else None


def _is_dataclass(node: ast.ClassDef) -> bool:
    return any("dataclass" in ast.unparse(each) for each in node.decorator_list)


def constants_of(module: Module) -> int:
    """Numbers in the module's constants, alone or in tuples.

    Arithmetic of numbers is one of them; tables, layouts and settings are none.
    """
    total = 0
    for node in module.tree.body:
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AnnAssign):
            targets = [node.target]
        else:
            continue
        names = [
            each.id
            for target in targets
            for each in ast.walk(target)
            if isinstance(each, ast.Name)
        ]
        if node.value is not None and any(map(_CONSTANT.match, names)):
            total += _numbers(node.value)
    return total


def _numbers(node: ast.expr) -> int:
    match node:
        case ast.Constant(value=bool()):
            return 0
        case ast.Constant(value=int() | float()):
            return 1
        case ast.UnaryOp():
            return _numbers(node.operand)
        case ast.BinOp():
            return min(1, _numbers(node.left) + _numbers(node.right))
        case ast.Tuple() | ast.List():
            return sum(map(_numbers, node.elts))
    return 0


def code_lines(module: Module) -> int:
    """Lines that hold code: no blank ones, comments or docstrings."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(module.text).readline):
        if token.type not in _LAYOUT:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(module.tree):
        match node:
            case ast.Expr(value=ast.Constant(value=str()), end_lineno=int(end)):
                lines.difference_update(range(node.lineno, end + 1))
    return len(lines)


def asks_whether_answers_err(node: ast.AST) -> bool:
    """Whether `node` is a place that works out whether answers err."""
    if isinstance(node, ast.Call):
        return _last_name(node.func) in ASKING
    return isinstance(node, ast.Compare) and any(
        _last_name(side) in THRESHOLDS for side in (node.left, *node.comparators)
    )


def reads_the_decision(node: ast.AST) -> bool:
    """Whether `node` reads what was decided of that once for a run."""
    return (
        isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Load)
        and node.attr == "noisy"
    )


def asks_for_a_scorer(node: ast.AST) -> bool:
    """Whether `node` is an `isinstance` of a class of scorers."""
    return (
        isinstance(node, ast.Call)
        and _last_name(node.func) == "isinstance"
        and any(
            _last_name(each).endswith("Scorer")
            for each in ast.walk(node.args[1])
            if isinstance(each, ast.Name | ast.Attribute)
        )
    )


def asks_for_a_kind(node: ast.AST) -> bool:
    """Whether `node` compares the `kind` of some settings."""
    if isinstance(node, ast.Match):
        return _is_kind(node.subject)
    return isinstance(node, ast.Compare) and any(
        map(_is_kind, (node.left, *node.comparators))
    )


def _is_kind(node: ast.expr) -> bool:
    """Whether `node` is `cfg.kind`, or that of settings that are named otherwise."""
    if not isinstance(node, ast.Attribute) or node.attr != "kind":
        return False
    owner = _last_name(node.value)
    return owner.endswith("cfg") or owner in ("fit", "kl_penalty", "bonus")


def _last_name(node: ast.AST) -> str:
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def count(root: Path) -> dict[str, Any]:
    """All figures of the checkout at `root`, as plain values."""
    modules = modules_of(root, PACKAGES)
    settings = Settings(modules + modules_of(root, LIBRARIES))
    nodes = {module.path: list(ast.walk(module.tree)) for module in modules}
    found: dict[str, Any] = {
        "settings": {name: settings.count(name) for name in SETTINGS}
    }
    for package in PACKAGES:
        own = [module for module in modules if module.package == package]
        inside = [node for module in own for node in nodes[module.path]]
        extensions = [m for m in own if "extensions" in m.path.relative_to(root).parts]
        found[package] = {
            "modules": len(own),
            "lines": sum(len(module.text.splitlines()) for module in own),
            "code_lines": sum(map(code_lines, own)),
            "code_lines_of_extensions": sum(map(code_lines, extensions)),
            "numbers_in_constants": sum(map(constants_of, own)),
            "asks_whether_answers_err": sum(map(asks_whether_answers_err, inside)),
            "reads_whether_answers_err": sum(map(reads_the_decision, inside)),
            "isinstance_of_a_scorer": sum(map(asks_for_a_scorer, inside)),
            "comparisons_of_kind": sum(map(asks_for_a_kind, inside)),
        }
    return found


def commit_of(root: Path) -> str:
    """The commit checked out at `root`; empty where none is."""
    command = ["git", "-C", str(root), "rev-parse", "HEAD"]
    with suppress(OSError, subprocess.CalledProcessError):
        return subprocess.check_output(command, text=True).strip()
    return ""


def show(found: dict[str, Any]) -> None:
    """Print what `count` gave as two tables."""
    settings = Table("class", "fields", "settings under it")
    for name, counted in found["settings"].items():
        values = ("-", "-") if counted is None else map(str, counted.values())
        settings.add_row(name, *values)
    packages = Table("figure", *PACKAGES)
    for figure in found[PACKAGES[0]]:
        packages.add_row(figure, *(f"{found[name][figure]:,}" for name in PACKAGES))
    for table in (settings, packages):
        Console().print(table)


def table(kept: dict[str, Any]) -> str:
    """What was counted of several checkouts, side by side, as Markdown."""
    counts = list(kept.values())
    rows = [
        [f"settings of `{name}`, and under it", *(_settings(k, name) for k in counts)]
        for name in SETTINGS
    ]
    rows += [
        [figure.replace("_", " "), *(_of_packages(k, figure) for k in counts)]
        for figure in counts[0][PACKAGES[0]]
    ]
    head = [["", *kept], ["---"] * (1 + len(kept))]
    return "\n".join(f"| {' | '.join(row)} |" for row in head + rows)


def _settings(counted: dict[str, Any], name: str) -> str:
    found = counted["settings"][name]
    return "-" if found is None else f"{found['fields']}, {found['leaves']}"


def _of_packages(counted: dict[str, Any], figure: str) -> str:
    return ", ".join(f"{counted[name][figure]:,}" for name in PACKAGES)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--root", type=Path, default=Path(), help="checkout to count")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--keep", metavar="NAME", help=f"write it into {KEPT}, and {PAGE}, as NAME"
    )
    args = parser.parse_args()
    found = count(args.root)
    if args.json:
        print(json.dumps(found, indent=1))
    else:
        show(found)
    if args.keep:
        kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
        kept[args.keep] = {"commit": commit_of(args.root), **found}
        write_atomically(KEPT, (json.dumps(kept, indent=1) + "\n").encode())
        write_between(PAGE, "count", table(kept))


if __name__ == "__main__":
    main()
