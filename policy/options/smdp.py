"""What a gait that runs for several control steps is worth: targets of an SMDP.

A gait of k steps that pays r_0 ... r_(k-1) and leads to a state worth V is worth
`r_0 + gamma r_1 + ... + gamma^(k-1) r_(k-1) + gamma^k V`: what comes after waits k
steps, and not one (Sutton, Precup and Singh 1999).

Shapes: N environments, K control steps, O gaits.
"""

from __future__ import annotations

import torch
from torch import Tensor


def change_costs(running: Tensor, options: int, cost: float) -> Tensor:
    """What it costs [N, O] to go on with each gait where `running` [N] runs."""
    return cost * (running[:, None] != torch.arange(options))


def best_after(q: Tensor, running: Tensor, cost: float) -> Tensor:
    """The most [N] that a choice is worth where `running` [N] ran before.

    Args:
        q: Values [N, O] of running each gait, once it runs.
        running: The gait that ran.
        cost: What a change costs.
    """
    return (q - change_costs(running, q.shape[1], cost)).amax(dim=1)


def upon_arrival(q: Tensor, running: Tensor, ends: Tensor, cost: float) -> Tensor:
    """Value [N] of coming to a state while a gait runs that may end there.

    Args:
        q: Values [N, O] of running each gait from there.
        running: [N] the gait.
        ends: [N] the probability that it ends there; 1 where it does.
        cost: What a change costs.
    """
    goes_on = q.gather(1, running[:, None])[:, 0]
    return (1.0 - ends) * goes_on + ends * best_after(q, running, cost)


def targets(
    paid: Tensor, steps: Tensor, arrived: Tensor, over: Tensor, *, gamma: float
) -> Tensor:
    """What running a gait turned out to be worth, [N].

    Args:
        paid: Rewards while it ran, discounted to its beginning.
        steps: [N] control steps that it ran.
        arrived: Value upon arrival, [N].
        over: [N] nothing comes after, as behind a fall.
        gamma: Discount of one control step.
    """
    return paid + gamma ** steps.to(paid.dtype) * arrived * ~over


def termination_loss(
    ends: Tensor, q: Tensor, running: Tensor, *, cost: float
) -> Tensor:
    """What learned termination descends (Bacon 2017), a number.

    A gait ends less often where going on with it is worth more than the best other one
    after the cost of the change, and more often where it is worth less.

    Args:
        ends: [N] probability that it ends, which is learned.
        q: Values [N, O], which are not.
        running: [N] the gait.
        cost: Of a change: it makes staying worth more.
    """
    values = q.detach()
    own = running[:, None]
    goes_on = values.gather(1, own)[:, 0]
    other = values.scatter(1, own, -torch.inf).amax(dim=1) - cost
    return (ends * (goes_on - other)).mean()
