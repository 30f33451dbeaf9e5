"""PPO in one file, as CleanRL has it, on the quadruped: read it, change it.

pip install -e '.[train]' -c constraints.txt
python examples/ppo_in_one_file.py --steps 1500000
python examples/ppo_in_one_file.py --reward runs/demo/rounds/00/reward --keep-task

`python -m benchmarks.other_trainers` trains it and says whether it walks: for each
command and from rest. Some that are trained for so long stand below 0.4 m/s, which is
no walk.

Shapes: T steps of a rollout, N environments.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
import tyro
from torch import Tensor, nn
from torch.distributions import Normal

from gaitpref.adapters.gym_registration import ENV_ID


@dataclass(frozen=True, kw_only=True)
class ExampleCfg:
    """What is trained."""

    reward: str = "task"
    """task, a criterion, or the directory of a learned reward."""
    keep_task: bool = False
    """Keep the hand-written walking reward beside it."""
    alive: float = 1.0
    """Paid per second without a fall, beside the task; as the loop pays it."""
    steps: int = 1_500_000
    """Environment steps over all environments."""
    envs: int = 64
    """Environments side by side."""
    steps_per_env: int = 48
    """Control steps each environment contributes to one update."""
    epochs: int = 5
    """Passes over each rollout."""
    minibatches: int = 4
    """Parts each pass is cut into."""
    learning_rate: float = 1e-3
    """First step size; it adapts so that an update moves the policy by `target_kl`."""
    target_kl: float = 0.02
    """Mean KL divergence between the policies before and after an update."""
    gamma: float = 0.99
    """Discount per control step."""
    lam: float = 0.95
    """Bias-variance trade-off of the advantage (GAE)."""
    clip: float = 0.2
    """Clip range of the policy ratio."""
    entropy_weight: float = 0.003
    """Weight of the entropy bonus."""
    out: Path = Path("runs/ppo.pt")
    """File of the networks' weights."""
    seed: int = 0
    """Where all chance comes from."""


class Agent(nn.Module):
    """Actor and critic, which see inputs of one size."""

    def __init__(self, inputs: int, actions: int) -> None:
        super().__init__()
        # Without weights of its own it only keeps mean and deviation.
        self.seen = nn.BatchNorm1d(inputs, affine=False, momentum=None)
        self.actor, self.critic = _network(inputs, actions), _network(inputs, 1)
        # An action of 1 is a large one here: start with small noise.
        self.log_std = nn.Parameter(torch.full((actions,), -1.6))

    def policy(self, obs: Tensor) -> Normal:
        """What is done in `obs` [..., 48]."""
        return Normal(self.actor(self.seen(obs)), self.log_std.exp())

    def value(self, obs: Tensor) -> Tensor:
        """What is still to be earned [...]."""
        return self.critic(self.seen(obs)).squeeze(-1)


def _network(inputs: int, outputs: int) -> nn.Sequential:
    last = nn.Linear(128, outputs)
    nn.init.orthogonal_(last.weight, 0.01)
    nn.init.zeros_(last.bias)
    hidden = [nn.Linear(inputs, 128), nn.ELU(), nn.Linear(128, 128), nn.ELU()]
    return nn.Sequential(*hidden, last)


@torch.no_grad()
def rollout(
    envs: gymnasium.vector.VectorEnv, agent: Agent, obs: Tensor, cfg: ExampleCfg
) -> tuple[dict[str, Tensor], Tensor, float]:
    """Act for T steps; gives what is learned from, the next `obs`, the mean reward."""
    agent.eval()
    kept: dict[str, list[Tensor]] = {}
    for _ in range(cfg.steps_per_env):
        policy = agent.policy(obs)
        action = policy.sample()
        after, paid, terminated, truncated, infos = envs.step(
            action.clamp(-1, 1).numpy()
        )
        reward = torch.as_tensor(paid, dtype=torch.float32)
        # An episode that only ran out of time would have earned more.
        late = torch.as_tensor(truncated)
        if late.any():
            final = torch.as_tensor(np.stack(infos["final_obs"]))[late]
            reward[late] += cfg.gamma * agent.value(final)
        done = torch.as_tensor(terminated | truncated).float()
        for name, values in (
            ("obs", obs),
            ("action", action),
            ("log_prob", policy.log_prob(action).sum(-1)),
            ("mean", policy.mean),
            ("value", agent.value(obs)),
            ("reward", reward),
            ("done", done),
        ):
            kept.setdefault(name, []).append(values)
        obs = torch.as_tensor(after)
    data = {name: torch.stack(values) for name, values in kept.items()}
    return data, obs, float(data["reward"].mean())


def advantages(data: dict[str, Tensor], last: Tensor, cfg: ExampleCfg) -> Tensor:
    """Generalised advantages [T, N] (Schulman et al. 2016, eq. 16)."""
    found = torch.zeros_like(data["reward"])
    ahead, after = torch.zeros_like(last), last
    for t in reversed(range(len(found))):
        goes_on = 1.0 - data["done"][t]
        delta = data["reward"][t] + cfg.gamma * goes_on * after - data["value"][t]
        ahead = delta + cfg.gamma * cfg.lam * goes_on * ahead
        found[t], after = ahead, data["value"][t]
    return found


def update(
    agent: Agent, optimizer: torch.optim.Adam, data: dict[str, Tensor], cfg: ExampleCfg
) -> None:
    """Clipped PPO on one rollout (Schulman et al. 2017, eq. 7)."""
    flat = {name: values.flatten(0, 1) for name, values in data.items()}
    old_std = agent.log_std.detach().exp()
    for _ in range(cfg.epochs):
        for rows in torch.randperm(len(flat["obs"])).chunk(cfg.minibatches):
            part = {name: values[rows] for name, values in flat.items()}
            policy = agent.policy(part["obs"])
            ratio = (policy.log_prob(part["action"]).sum(-1) - part["log_prob"]).exp()
            gain = part["advantage"]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            clipped = ratio.clamp(1 - cfg.clip, 1 + cfg.clip)
            loss = -torch.minimum(ratio * gain, clipped * gain).mean()
            loss += (agent.value(part["obs"]) - part["target"]).square().mean()
            loss -= cfg.entropy_weight * policy.entropy().sum(-1).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 1.0)
            optimizer.step()
            before = Normal(part["mean"], old_std)
            moved = torch.distributions.kl_divergence(before, policy).sum(-1).mean()
            _adapt(optimizer, moved.item(), cfg.target_kl)


def _adapt(optimizer: torch.optim.Adam, moved: float, target_kl: float) -> None:
    for group in optimizer.param_groups:
        if moved > 2 * target_kl:
            group["lr"] = max(1e-5, group["lr"] / 1.5)
        elif moved < target_kl / 2:
            group["lr"] = min(1e-2, group["lr"] * 1.5)


def train(cfg: ExampleCfg) -> Agent:
    """Train and save the networks."""
    # The networks are small: a second thread wins nothing.
    torch.set_num_threads(1)
    torch.manual_seed(cfg.seed)
    paid: dict[str, Any] = {"reward": cfg.reward, "keep_task": cfg.keep_task}
    envs = gymnasium.make_vec(ENV_ID, num_envs=cfg.envs, alive=cfg.alive, **paid)
    agent = Agent(48, 12)
    optimizer = torch.optim.Adam(agent.parameters(), lr=cfg.learning_rate)
    obs = torch.as_tensor(envs.reset(seed=cfg.seed)[0])
    per_update = cfg.envs * cfg.steps_per_env
    for number in range(max(1, cfg.steps // per_update)):
        data, obs, mean = rollout(envs, agent, obs, cfg)
        with torch.no_grad():
            data["advantage"] = advantages(data, agent.value(obs), cfg)
        data["target"] = data["advantage"] + data["value"]
        update(agent, optimizer, data, cfg)
        # Only here do mean and deviation of the inputs follow what was seen.
        agent.seen.train()(data["obs"].flatten(0, 1))
        if number % 20 == 0:
            print(f"{(number + 1) * per_update:>9,} steps, {50 * mean:6.2f} a second")
    envs.close()
    cfg.out.parent.mkdir(parents=True, exist_ok=True)
    torch.save(agent.state_dict(), cfg.out)
    return agent


if __name__ == "__main__":
    train(tyro.cli(ExampleCfg))
