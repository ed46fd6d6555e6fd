"""Forces and their changes are predicted."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor, nn

from tactileforge.contracts import Batch
from tactileforge.distributed import masked_mean
from tactileforge.heads.force import Forces


class Force(nn.Module):
    """L1 on the force of frames 2..N and on its change from the frame before.

    Forces are normalised by the sensor's force scale. Source: AnyTouch 2, section Physical-Level
    Dynamic Properties.

    Args:
        delta: Strength of the change of force.
        shear: Whether x and y are learned too, or z alone.
    """

    head: ClassVar[str] = "force"
    needs: ClassVar[frozenset[str]] = frozenset({"force"})

    def __init__(self, delta: float = 1.0, shear: bool = True) -> None:
        super().__init__()
        self.delta = delta
        self.shear = shear

    def forward(self, prediction: Forces, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """The loss; logs the mean absolute error of each axis in mN."""
        valid = batch["force_valid"]
        scale = batch["force_scale"][:, None]
        force = batch["force"].nan_to_num() / scale
        of_force = (prediction.force - force[:, 1:]).abs()
        of_delta = (prediction.delta - force.diff(dim=1)).abs()
        first = 0 if self.shear else 2
        loss = masked_mean((of_force + self.delta * of_delta)[..., first:].mean((1, 2)), valid)
        milli = 1000 * (of_force.detach() * scale).mean(1)
        logs = {
            f"mae_{axis}_mN": masked_mean(milli[:, i], valid)
            for i, axis in enumerate(("x", "y", "z"))
            if i >= first
        }
        return loss, logs
