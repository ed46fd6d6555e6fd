"""Muon for the matrices of an encoder, AdamW for everything else; and a schedule.

Muon (Jordan et al., 2024, https://kellerjordan.github.io/posts/muon) replaces the momentum of a
matrix by the nearest matrix whose singular values are all 1, found by Newton-Schulz iterations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.errors import ConfigError

#: Coefficients of the quintic iteration, from the post above: they reach .7 to 1.2 in five steps.
_QUINTIC = (3.4445, -4.7750, 2.0315)


class Muon:
    """Muon for the matrices outside of the heads, AdamW for all other parameters.

    Args:
        lr: Learning rate of AdamW, for heads and for tensors with one axis or more than two.
        weight_decay: Decay of matrices, per step and learning rate.
        betas: Decay rates of AdamW's averages of the gradient and of its square.
        matrix_lr: Learning rate of the other matrices (two axes).
        momentum: Decay rate of Muon's average of the gradient, 0 or more, below 1.
    """

    def __init__(
        self,
        lr: float = 3e-4,
        weight_decay: float = 0.05,
        betas: tuple[float, float] = (0.9, 0.95),
        matrix_lr: float = 0.01,
        momentum: float = 0.95,
    ) -> None:
        if not 0 <= momentum < 1:
            raise ConfigError(f"optim.momentum={momentum}: give 0 or more, below 1")
        self.lr, self.weight_decay, self.betas = lr, weight_decay, betas
        self.matrix_lr, self.momentum = matrix_lr, momentum

    def build(
        self, parameters: Sequence[tuple[str, nn.Parameter]], fused: bool
    ) -> torch.optim.Optimizer:
        """Builds one optimiser with three groups of parameters."""
        inner = [p for name, p in parameters if p.ndim == 2 and not name.startswith("heads.")]
        chosen = set(map(id, inner))
        others = [p for _, p in parameters if id(p) not in chosen]
        decayed = [p for p in others if p.ndim > 1]
        vectors = [p for p in others if p.ndim <= 1]
        decay = self.weight_decay
        groups = [
            {"params": inner, "muon": True, "lr": self.matrix_lr, "weight_decay": decay},
            {"params": decayed, "muon": False, "lr": self.lr, "weight_decay": decay},
            {"params": vectors, "muon": False, "lr": self.lr, "weight_decay": 0.0},
        ]
        shared = {"betas": tuple(self.betas), "momentum": self.momentum}
        return _MuonAndAdamW([group for group in groups if group["params"]], shared)


class _MuonAndAdamW(torch.optim.Optimizer):
    @torch.no_grad()
    def step(self, closure: Callable[[], Any] | None = None) -> Any:
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        for group in self.param_groups:
            for parameter in group["params"]:
                if (gradient := parameter.grad) is not None:
                    parameter.mul_(1 - group["lr"] * group["weight_decay"])
                    change = self._muon if group["muon"] else self._adam
                    parameter.add_(change(parameter, gradient, group), alpha=-group["lr"])
        return loss

    def _muon(self, parameter: Tensor, gradient: Tensor, group: dict[str, Any]) -> Tensor:
        state = self.state[parameter]
        if not state:
            state["momentum"] = torch.zeros_like(parameter)
        momentum: Tensor = state["momentum"].lerp_(gradient, 1 - group["momentum"])
        looked_ahead = gradient.lerp(momentum, group["momentum"])  # Nesterov
        rows, columns = parameter.shape
        scale: float = max(1.0, rows / columns) ** 0.5
        return orthogonal(looked_ahead) * scale

    def _adam(self, parameter: Tensor, gradient: Tensor, group: dict[str, Any]) -> Tensor:
        state = self.state[parameter]
        if not state:
            state["step"] = torch.zeros((), dtype=torch.float32)
            state["first"] = torch.zeros_like(parameter)
            state["second"] = torch.zeros_like(parameter)
        state["step"] += 1
        slow, slower = group["betas"]
        first: Tensor = state["first"].lerp_(gradient, 1 - slow)
        second: Tensor = state["second"].lerp_(gradient.square(), 1 - slower)
        count = float(state["step"])
        scale = (second / (1 - slower**count)).sqrt() + 1e-8
        change: Tensor = first / (1 - slow**count) / scale
        return change


def orthogonal(matrix: Tensor, steps: int = 5) -> Tensor:
    """Moves the singular values of a matrix close to 1, and keeps its singular vectors.

    Args:
        matrix: float (rows, columns).
        steps: Number of Newton-Schulz iterations.
    """
    a, b, c = _QUINTIC
    # Wide, so that the product below is the smaller of the two Gram matrices.
    wide = matrix.T if matrix.shape[0] > matrix.shape[1] else matrix
    x: Tensor = wide / (wide.norm() + 1e-7)
    for _ in range(steps):
        gram = x @ x.T
        x = a * x + (b * gram + c * gram @ gram) @ x
    return x.T if matrix.shape[0] > matrix.shape[1] else x


def stable_decay(step: int, warm: int, total: int) -> float:
    """Factor of the learning rate: warm-up, constant, linear decay over the last fifth."""
    return max(0.0, min(1.0, (step + 1) / warm, (total - step) / max(1.0, 0.2 * total)))
