"""Which curves matter: taken one by one, as long as the evidence grows.

Pairs are drawn so that a curve's worth is known; the curves are plain numbers here.
"""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from data.plain import from_plain
from rewardmodel.cfg import FitCfg, SparseCfg
from rewardmodel.forward import LEFT_OUT, chosen_curves
from rewardmodel.laplace import log_evidence
from rewardmodel.likelihood import Errors
from rewardmodel.noise_level import erring
from rewardmodel.training import StandardisedPairs, bootstrap_counts

CURVES, WEIGHTS = 12, 3
CFG = FitCfg(kind="sparse", error_share=0.1)
ALL = torch.arange(CURVES)


def drawn(count: int, *, seed: int = 0) -> Tensor:
    """Differences [B, G, W] of pairs."""
    generator = torch.Generator().manual_seed(seed)
    shape = (count, CURVES, WEIGHTS)
    return torch.randn(shape, generator=generator, dtype=torch.float64)


def answers(lead: Tensor) -> StandardisedPairs:
    """Answers of a rater who never errs, of pairs with leads [B]."""
    count = len(lead)
    pairs = StandardisedPairs(
        steps=torch.zeros(2, count, 1, 1),
        scored=torch.ones(2, count, 1, dtype=torch.bool),
        fall_lead=torch.zeros(count),
        target=(lead > 0).float(),
        errors=Errors.alike(0.0, count, tie_threshold=CFG.tie_threshold),
    )
    return erring(pairs, CFG, CFG.error_share)


def kept(variance: Tensor) -> list[set[int]]:
    """Curves each member has taken, of variances [M, P]."""
    taken = variance.unflatten(1, (CURVES, WEIGHTS))[..., 0] > LEFT_OUT
    return [set(row.nonzero()[:, 0].tolist()) for row in taken]


def ones(members: int, count: int) -> Tensor:
    return torch.ones(members, count, dtype=torch.float64)


@pytest.mark.parametrize(("count", "wanted"), [(40, {3}), (120, {3, 7})])
def test_it_takes_what_the_answers_are_about(count: int, wanted: set[int]) -> None:
    """One curve, or two of which the one says half as much; no other by chance."""
    curves = drawn(count)
    lead = sum(curves[:, g, 0] * (1.0 if g == 3 else 0.5) for g in wanted)
    pairs = answers(torch.as_tensor(lead))
    theta, variance = chosen_curves(curves, pairs, ones(1, count), CFG, allowed=ALL)
    (found,) = kept(variance)
    assert found == wanted
    left_out = [g for g in range(CURVES) if g not in found]
    assert (theta.unflatten(1, (CURVES, WEIGHTS))[:, left_out] == 0).all()
    assert (
        (curves.flatten(1) @ theta[0] > 0) == (pairs.target > 0.5)
    ).double().mean() > 0.9


def test_members_take_others_where_the_answers_leave_it_open() -> None:
    """Two curves that hardly differ: who took the same one would hide that."""
    curves = drawn(40)
    curves[:, 5] = curves[:, 2] + 0.3 * drawn(40, seed=1)[:, 0]
    pairs = answers(curves[:, 2, 0] + curves[:, 5, 0])
    generator = torch.Generator().manual_seed(0)
    counts = bootstrap_counts(16, 40, generator=generator).double()
    _, variance = chosen_curves(curves, pairs, counts, CFG, allowed=ALL)
    taken = kept(variance)
    assert any(2 in each for each in taken)
    assert any(5 in each for each in taken)
    assert len({frozenset(each) for each in taken}) > 1


def test_what_is_not_allowed_is_never_taken() -> None:
    curves = drawn(60)
    pairs = answers(curves[:, 3, 0])
    others = ALL[ALL != 3]
    _, variance = chosen_curves(curves, pairs, ones(2, 60), CFG, allowed=others)
    assert all(3 not in taken for taken in kept(variance))


def test_the_evidence_of_members_is_that_of_each_alone() -> None:
    """Whether they look at the same curves, or each at its own."""
    curves = drawn(50)
    pairs = answers(curves[:, 1, 0])
    counts = bootstrap_counts(
        3, 50, generator=torch.Generator().manual_seed(1)
    ).double()
    theta = 0.5 * torch.ones(3, WEIGHTS, dtype=torch.float64)
    own = curves[:, [1, 4, 1]].transpose(0, 1)  # [M, B, W]
    together = log_evidence(own, pairs, counts, CFG, 1.0, theta)
    for member, group in enumerate((1, 4, 1)):
        alone = log_evidence(
            curves[:, group], pairs, counts[[member]], CFG, 1.0, theta[[member]]
        )
        assert together[member] == pytest.approx(float(alone))


def test_older_files_name_settings_there_are_no_more() -> None:
    """Of how curves were picked before; any other unknown name is refused."""
    old = {"num_members": 4, "single_legs": False, "lines_apart": True}
    found = from_plain(SparseCfg, old | {"sparsity": 0.2, "num_updates": 30})
    assert found == SparseCfg(num_members=4, single_legs=False)
    with pytest.raises(ValueError, match="SparseCfg has no field liens_apart"):
        from_plain(SparseCfg, old | {"liens_apart": True})
