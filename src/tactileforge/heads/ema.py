"""Exponential moving average of a network's weights: the target network of objectives."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import torch
from torch import nn


class EMA(nn.Module):
    """Exponential moving average (EMA) of a network's weights; no gradient reaches it.

    After each step ``slow = keep * slow + (1 - keep) * fast``, where ``keep`` rises linearly from
    ``momentum`` at the start of the run to 1 at its end. It is always in evaluation mode. Where a
    head has one of the encoder, it is what `hub.pack.pack_run` makes a file of.

    Args:
        network: What is followed.
        momentum: The first ``keep``.

    Attributes:
        network: The copy.
    """

    def __init__(self, network: Any, momentum: float) -> None:
        super().__init__()
        self.network: Any = deepcopy(network).requires_grad_(False).eval()
        self.momentum = momentum

    def train(self, mode: bool = True) -> EMA:
        """Stays in evaluation mode."""
        return super().train(False)

    def keep(self, step: int, total: int) -> float:
        """Share of the copy that stays after a step; 0 at the start."""
        return 1 - (1 - self.momentum) * (1 - step / total) if step else 0.0

    @torch.no_grad()
    def after_step(self, network: Any, step: int, total: int) -> None:
        """Moves towards a network; at step 0 it becomes equal to it.

        Args:
            network: See the class.
            step: Optimiser steps taken so far.
            total: Steps of the run.
        """
        keep = self.keep(step, total)
        for slow, fast in zip(self.network.parameters(), network.parameters(), strict=True):
            slow.lerp_(fast, 1 - keep)
        for slow, fast in zip(self.network.buffers(), network.buffers(), strict=True):
            slow.copy_(fast)
