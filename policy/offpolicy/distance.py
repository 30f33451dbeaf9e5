"""How far a policy has gone from the steps it learns from.

Shapes: B remembered steps.
"""

from __future__ import annotations

import torch

from .ring import Ring
from .tanh_actor import TanhActor

TOO_FAR = 1.0
"""From here on a policy does something else than what was remembered."""
_ASKED = 2048


@torch.no_grad()
def action_distance(actor: TanhActor, ring: Ring) -> float:
    """Root mean square of what `actor` does otherwise than was done in remembered
    states, over that of two remembered actions drawn at random.

    0 is a copy. At 1, a policy is no nearer to what was done in a state than any other
    action in memory is: what its critics say of it is a guess.
    """
    batch = ring.sample(_ASKED, n_step=1, gamma=0.0, evenly=True)
    missed = actor(batch.obs) - batch.action
    spread = 2.0 * batch.action.var(dim=0, unbiased=False).sum()
    return float((missed.square().sum(dim=-1).mean() / spread.clamp(min=1e-12)).sqrt())
