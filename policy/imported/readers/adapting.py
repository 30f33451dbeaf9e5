"""A policy in two TorchScript files: one guesses from the observation what the robot
cannot sense, the other acts by the observation and that guess."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from policy.networks.recipe import INPUT, NetworkError, Node

from .found import Found, recipe_of

ACTS, GUESSES = "body", "adaptation_module"
"""What the names of the files begin with, and those of their tensors here."""
TWO_SCRIPTS = "TorchScript in two files"
_SEEN = "observation and guess"


def files_of(path: Path) -> dict[str, Path]:
    """The two files of a policy by what the names of their tensors begin with; none
    where `path` is a policy by itself.

    Raises:
        NetworkError: one of two is not there.
    """
    if not path.name.startswith(f"{ACTS}_") or path.suffix != ".jit":
        return {}
    other = path.with_name(path.name.replace(ACTS, GUESSES, 1))
    if not other.is_file():
        raise NetworkError(
            f"{path} acts by what {other.name} guesses, which is not beside it: copy "
            "it there"
        )
    return {GUESSES: other, ACTS: path}


def chained(guesses: Found, acts: Found) -> Found:
    """The network of both: actions = acts(observation, guesses(observation))."""
    first, latent = _renamed(guesses, GUESSES, INPUT)
    last, output = _renamed(acts, ACTS, _SEEN)
    both = Node(
        op="Concat", inputs=(INPUT, latent), output=_SEEN, attributes={"axis": 1}
    )
    tensors = {
        f"{part}.{name}": tensor
        for part, found in ((GUESSES, guesses), (ACTS, acts))
        for name, tensor in found.tensors.items()
    }
    recipe = recipe_of([*first, both, *last], output, guesses.recipe.obs_dim, tensors)
    return Found(kind=TWO_SCRIPTS, recipe=recipe, tensors=tensors)


def _renamed(found: Found, part: str, seen: str) -> tuple[list[Node], str]:
    """The operations of one part and its output, by names that the other has not."""

    def of(name: str) -> str:
        if name == INPUT:
            return seen
        return f"{part}.{name}" if name else name

    nodes = [
        replace(node, inputs=tuple(map(of, node.inputs)), output=of(node.output))
        for node in found.recipe.nodes
    ]
    return nodes, of(found.recipe.output)
