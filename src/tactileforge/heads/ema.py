"""Exponential moving average (EMA) of a network's weights, a target network for objectives."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import torch
from torch import nn


class EMA(nn.Module):
    """Exponential moving average (EMA) of a network's weights, without gradient.

    After each step ``ema = keep * ema + (1 - keep) * weights``, where ``keep`` rises linearly from
    ``momentum`` at the start of the run to 1 at its end. It is always in evaluation mode. If a head
    has an EMA of the encoder, `hub.pack.pack_run` packs that one.

    Args:
        network: Network to average.
        momentum: Initial value of ``keep``, 0 to 1.

    Attributes:
        network: The averaged copy.

    Example:
        >>> import torch
        >>> average = EMA(torch.nn.Linear(2, 2), momentum=0.99)
        >>> any(weight.requires_grad for weight in average.parameters())
        False
    """

    def __init__(self, network: Any, momentum: float) -> None:
        super().__init__()
        # a copy of the whole module: `after_step` pairs parameters by their order
        self.network: Any = deepcopy(network).requires_grad_(False).eval()
        self.momentum = momentum

    def train(self, mode: bool = True) -> EMA:
        """Ignores the mode: it stays in evaluation mode."""
        return super().train(False)

    def keep(self, step: int, total: int) -> float:
        """Momentum of a step: share of the old weights in the average; 0 at the start."""
        # 0 at first: the copy was made before the initial weights were loaded
        return 1 - (1 - self.momentum) * (1 - step / total) if step else 0.0

    @torch.no_grad()
    def after_step(self, network: Any, step: int, total: int) -> None:
        """Moves the average towards a network; at step 0 it becomes equal to it.

        Args:
            network: The averaged network, after the step.
            step: Optimiser steps taken so far.
            total: Steps of the run.
        """
        keep = self.keep(step, total)
        for averaged, newest in zip(self.network.parameters(), network.parameters(), strict=True):
            averaged.lerp_(newest, 1 - keep)
        # buffers are not weights: counters and tables have no average
        for averaged, newest in zip(self.network.buffers(), network.buffers(), strict=True):
            averaged.copy_(newest)
