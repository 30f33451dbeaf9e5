"""V-trace against its definition, GAE, and numbers worked out by hand."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from torch import Tensor

from policy.engines.vtrace import Corrected, VTraceCfg, vtrace

T, N = 7, 3


def rollout(seed: int = 0) -> dict[str, Tensor]:
    """Random rewards, values and ratios; the middle environment ends two episodes."""
    chance = torch.Generator().manual_seed(seed)
    draw = {n: torch.randn(T, N, generator=chance) for n in ("rewards", "values")}
    ends = torch.zeros(T, N)
    ends[2, 1] = ends[5, 1] = 1.0
    return {
        **draw,
        "last_values": torch.randn(N, generator=chance),
        "dones": ends,
        "time_outs": torch.zeros(T, N),
        "log_ratio": 0.5 * torch.randn(T, N, generator=chance),
    }


def corrected(parts: dict[str, Tensor], lam: float = 0.95, **cfg: Any) -> Corrected:
    return vtrace(**parts, gamma=0.99, lam=lam, cfg=VTraceCfg(**cfg))


def gae(parts: dict[str, Tensor], lam: float) -> Tensor:
    """Advantages of GAE (Schulman et al. 2016, eq. 16), step by step."""
    values = torch.cat([parts["values"], parts["last_values"][None]])
    going_on, advantage = 1.0 - parts["dones"], torch.zeros(T + 1, N)
    for t in reversed(range(T)):
        delta = parts["rewards"][t] + 0.99 * going_on[t] * values[t + 1] - values[t]
        advantage[t] = delta + 0.99 * lam * going_on[t] * advantage[t + 1]
    return advantage[:T]


@pytest.mark.parametrize("lam", [0.0, 0.95, 1.0])
def test_of_equal_policies_it_is_gae(lam: float) -> None:
    """Targets and advantages, and nothing is clipped."""
    parts = rollout() | {"log_ratio": torch.zeros(T, N)}
    found = corrected(parts, lam)
    expected = gae(parts, lam)
    assert found.advantages.allclose(expected, atol=1e-6)
    assert found.targets.allclose(parts["values"] + expected, atol=1e-6)
    assert not found.clipped.any()


def test_targets_are_those_of_equation_1() -> None:
    """Summed term by term, in an environment whose episode does not end."""
    parts = rollout()
    found = corrected(parts, 0.9, rho_bar=1.2, c_bar=0.8)
    ratio = parts["log_ratio"][:, 0].exp().tolist()
    rewards, values = (parts[n][:, 0].tolist() for n in ("rewards", "values"))
    values.append(float(parts["last_values"][0]))
    for s in range(T):
        total = values[s]
        for t in range(s, T):
            passed = math.prod(0.9 * min(0.8, ratio[i]) for i in range(s, t))
            delta = rewards[t] + 0.99 * values[t + 1] - values[t]
            total += 0.99 ** (t - s) * passed * min(1.2, ratio[t]) * delta
        assert float(found.targets[s, 0]) == pytest.approx(total, abs=1e-5)


def test_the_advantage_is_impalas_where_lambda_is_one() -> None:
    parts = rollout()
    found = corrected(parts, 1.0)
    after = torch.cat([found.targets[1:], parts["last_values"][None]])
    rho = parts["log_ratio"].exp().clamp(max=1.0)
    paid = parts["rewards"] + 0.99 * (1 - parts["dones"]) * after
    expected = rho * (paid - parts["values"])
    assert found.advantages.allclose(expected, atol=1e-5)
    assert found.clipped.equal((parts["log_ratio"] > math.log(1.001)).float())


def test_a_time_out_is_worth_what_follows_and_a_fall_is_not() -> None:
    """Reward 1, value 2, gamma 0.99: 1 + 1.98 where it would have gone on, else 1."""
    parts = rollout() | {
        "rewards": torch.ones(T, N),
        "values": torch.full((T, N), 2.0),
        "log_ratio": torch.zeros(T, N),
    }
    parts["dones"][4] = 1.0
    parts["time_outs"][4, 0] = 1.0
    found = corrected(parts)
    assert found.targets[4].tolist() == pytest.approx([2.98, 1.0, 1.0])


def test_no_step_beyond_an_end_matters() -> None:
    parts = rollout()
    before = corrected(parts).targets[:3, 1]
    parts["rewards"][3:, 1] += 100.0
    assert corrected(parts).targets[:3, 1].equal(before)


def test_an_action_the_present_policy_would_not_take_teaches_nothing() -> None:
    parts = rollout()
    parts["log_ratio"][4, 0] = -50.0
    found = corrected(parts)
    assert float(found.advantages[4, 0]) == pytest.approx(0.0, abs=1e-12)
    assert found.targets[4, 0] == pytest.approx(float(parts["values"][4, 0]))


def test_settings_that_would_not_converge_are_refused() -> None:
    """Espeholt et al. 2018, theorem 1 asks for it."""
    with pytest.raises(ValueError, match="c_bar <= rho_bar"):
        VTraceCfg(rho_bar=1.0, c_bar=2.0)
