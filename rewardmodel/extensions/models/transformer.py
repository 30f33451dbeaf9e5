"""A small causal transformer over the clip, for what depends on the order of things.

One layer of attention from each step to some of the last ones, each lag with a weight
of its own and no other notion of time: when in an episode a motion happens does not
matter. It needs more answers than `history`: from three hundred about a rhythm it
foresees two of three new ones, where `history` foresees seven of eight.

Shapes: M ensemble members, K steps, L steps of a window, D descriptors, E numbers that
stand for a step, H heads.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import elu, layer_norm

from rewardmodel.cfg import FitCfg
from rewardmodel.extensions_cfg import TransformerCfg

from .history import WindowScorer
from .network import Network, draw_uniformly

_LAG_SHARPNESS = 6.0
"""Logit by which each head prefers a lag of its own before it has learned anything: a
mean over all lags shows no rhythm, and no gradient towards one."""
_HANDED_ON = ("embed", "known", "mix")
_AT_ONCE = 8192
"""Windows looked at together, some 30 MB in every layer."""


class AttentionNetwork(Network):
    """Embedding, attention, a hidden layer; all members by batched products."""

    def __init__(self, num_descriptors: int, num_lags: int, cfg: TransformerCfg):
        super().__init__()
        members, width = cfg.num_members, cfg.hidden_size
        sizes = {
            "embed": (num_descriptors, width),
            "query": (width, width),
            "known": (width, 2 * width),
            "mix": (width, width),
            "widen": (width, 2 * width),
            "narrow": (2 * width, width),
            "score": (width, 1),
        }
        self.weights = nn.ParameterDict(
            {name: torch.zeros(members, *size) for name, size in sizes.items()}
        )
        self.biases = nn.ParameterDict(
            {name: torch.zeros(members, 1, size[1]) for name, size in sizes.items()}
        )
        preferred = torch.zeros(members, cfg.num_heads, num_lags)
        self.lag_weights = nn.Parameter(preferred)

    def initialise(self, generator: torch.Generator) -> None:
        """Draw every weight and bias; content moves no attention yet."""
        for name, weight in self.weights.items():
            # What is handed on linearly must not fade beside the step itself.
            gain = 3.0 if name in _HANDED_ON else 1.0
            draw_uniformly(weight, weight.shape[1], generator, gain=gain)
            draw_uniformly(self.biases[name], weight.shape[1], generator)
        self.weights["query"].data.zero_()
        _, heads, lags = self.lag_weights.shape
        for head in range(heads):
            # The step itself is at hand without attention.
            self.lag_weights.data[:, head, 1 + head % (lags - 1)] = _LAG_SHARPNESS

    def forward(self, steps: Tensor, starts: Tensor | None = None) -> Tensor:
        """Raw rewards [M, ...] of windows [..., L, D], the step itself first."""
        flat = steps.flatten(0, -3)
        scored = torch.cat([self._score(part) for part in flat.split(_AT_ONCE)], dim=1)
        return scored.reshape(-1, *steps.shape[:-2])

    def _score(self, windows: Tensor) -> Tensor:
        """Raw rewards [M, K] of windows [K, L, D]."""
        members, heads, lags = self.lag_weights.shape
        tokens = self._layer("embed", windows.flatten(0, 1))  # [M, K*L, E]
        shape = (members, len(windows), lags, 2, heads, -1)
        key, value = self._layer("known", _normed(tokens)).reshape(shape).unbind(3)
        hidden = tokens.unflatten(1, (-1, lags))[:, :, 0]  # [M, K, E]
        query = self._layer("query", _normed(hidden)).unflatten(-1, (1, heads, -1))
        logits = (query * key).sum(dim=-1) * query.shape[-1] ** -0.5  # [M, K, L, H]
        weights = (logits + self.lag_weights.mT[:, None]).softmax(dim=2)
        gathered = (weights[..., None] * value).sum(dim=2).flatten(-2)
        hidden = hidden + self._layer("mix", gathered)
        wide = elu(self._layer("widen", _normed(hidden)))
        hidden = hidden + self._layer("narrow", wide)
        return self._layer("score", _normed(hidden))[..., 0]

    def _layer(self, name: str, inputs: Tensor) -> Tensor:
        """One layer [M, K, out] for inputs [K, in], or those of each member."""
        inputs = inputs.expand(len(self.lag_weights), -1, -1)
        return torch.baddbmm(self.biases[name], inputs, self.weights[name])


def _normed(hidden: Tensor) -> Tensor:
    return layer_norm(hidden, hidden.shape[-1:])


def make_transformer(cfg: FitCfg, num_descriptors: int) -> WindowScorer:
    """The network on windows, not fitted yet."""
    own = cfg.settings_of(TransformerCfg)
    return WindowScorer(own, lambda lags: AttentionNetwork(num_descriptors, lags, own))
