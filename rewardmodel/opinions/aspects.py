"""What raters said their answers were about, as indices.

Shapes: B answers.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from data.answers.answer_records import ASPECTS

UNSAID = -1
"""In place of an index, where nobody said."""


def indices_of(whys: Sequence[str]) -> Tensor:
    """[B] indices in `ASPECTS`, `UNSAID` of an empty text."""
    return torch.tensor([ASPECTS.index(why) if why else UNSAID for why in whys])
