"""Forces in newton, from the head that a model was packed with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.contracts import Features


@dataclass(frozen=True)
class Readings:
    """What a model makes of clips, from one pass of its encoder.

    Attributes:
        vector: float32 (projected,), or (B, projected) for a batch; what `Model.encode` gives.
        force: float32 (T - 1, 3), or (B, T - 1, 3): newton in frames 2..T, see `contracts`. None
            where the model has no force head, or does not know the scale of a sensor.
    """

    vector: Tensor
    force: Tensor | None


def scales(entry: Mapping[str, Any], sensors: Sequence[str]) -> Tensor | None:
    """Newton that count as 1, float32 (B, 1, 3); None where a sensor has none.

    Args:
        entry: Of a head, see `Header.heads`.
        sensors: B names.
    """
    known = entry.get("scale", {})
    if not all(name in known for name in sensors):
        return None
    return torch.tensor([known[name] for name in sensors])[:, None]


def uncalibrated(entry: Mapping[str, Any], sensors: Sequence[str]) -> list[str]:
    """Sensors no unit of which was calibrated, sorted.

    Args:
        entry: Of a head, see `Header.heads`.
        sensors: Names.
    """
    return sorted(set(sensors) - set(entry.get("calibrated", ())))


def normalised(head: nn.Module, encoder: Any, tokens: Tensor, projected: Tensor) -> Tensor:
    """Forces (B, T - 1, 3) in units of the scale, of tokens (B, L, width)."""
    views = SimpleNamespace(full=Features(tokens, projected, encoder.prefix, encoder.grid))
    found: Tensor = head(views, {}).force
    return found.float()
