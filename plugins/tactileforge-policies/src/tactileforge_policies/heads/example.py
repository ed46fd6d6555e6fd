"""Synthetic demonstrations for the conformance suite: commands follow from the last force."""

from __future__ import annotations

from typing import Any

import torch

from tactileforge.contracts import Batch
from tactileforge_policies.robot import Robot


def example(batch: Batch) -> tuple[dict[str, Any], Batch]:
    """Makes metadata and columns of demonstrations of one finger.

    Args:
        batch: Batch of B samples; see `tactileforge.testing.batch`.

    Returns:
        The metadata, and ``state`` (B, 2, 3), ``action_chunk`` (B, 4, 2), ``action_chunk_valid``
        (B, 4) and ``images`` (B, 2, 3, h, w).
    """
    size, image = len(batch["force"]), batch["image"].shape[-1]
    robot = Robot(
        fingers=("left",),
        sensors=("digit",),
        state_size=3,
        action_size=2,
        rate=6.0,
        horizon=4,
        image_size=image,
    )
    draw = torch.Generator().manual_seed(0)
    force = batch["force"][:, -1] / batch["force_scale"]
    change = torch.stack([-force[:, 2], force[:, 0]], dim=-1)
    steps = (robot.observations, 3, image, image)
    return robot.facts, {
        "state": torch.rand(size, robot.observations, robot.state_size, generator=draw) * 2 - 1,
        "action_chunk": change[:, None] * torch.linspace(1, 0.4, robot.horizon)[:, None],
        "action_chunk_valid": torch.ones(size, robot.horizon, dtype=torch.bool),
        "images": torch.randint(256, (size, *steps), generator=draw).to(torch.uint8),
    }
