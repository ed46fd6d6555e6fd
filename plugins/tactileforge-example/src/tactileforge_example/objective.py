"""An objective for the share of the gel in contact."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor, nn

from tactileforge.contracts import NEUTRAL_BACKGROUND, Batch
from tactileforge.training import Mean, masked_mean


class ContactArea(nn.Module):
    """Squared error of the contact area of each temporal slot.

    The target needs no labels: it is the share of pixels that differ from the background. A sample
    whose recording has no background has no target, and is left out of the mean.

    Args:
        threshold: Smallest difference of a touched pixel from the background, averaged over its
            colours, of 255.
    """

    head: ClassVar[str] = "contact_area"
    needs: ClassVar[frozenset[str]] = frozenset()

    def __init__(self, threshold: float = 10.0) -> None:
        super().__init__()
        self.threshold = threshold

    def forward(self, prediction: Tensor, batch: Batch) -> tuple[Mean, dict[str, Mean]]:
        """Computes the loss; logs the mean contact area.

        Args:
            prediction: Predicted contact area, float (B, slots).
            batch: The batch; see `tactileforge.contracts`.
        """
        background = batch["background"]
        area = contact_area(batch["frames"], background, self.threshold)
        area = area.view(*prediction.shape, -1).mean(2)
        known = (background != NEUTRAL_BACKGROUND).flatten(1).any(1)
        loss = masked_mean((prediction - area).square().mean(1), known)
        return loss, {"area": masked_mean(area.mean(1), known)}


def contact_area(frames: Tensor, background: Tensor, threshold: float) -> Tensor:
    """Share of touched pixels of each frame, by their difference from the background.

    Args:
        frames: uint8 (B, T, 3, H, W).
        background: uint8 (B, 3, H, W).
        threshold: Smallest difference of a touched pixel, of 255; see `ContactArea`.

    Returns:
        float (B, T), 0 to 1.
    """
    change = (frames.short() - background[:, None].short()).abs().float().mean(2)
    return (change > threshold).float().mean((2, 3))
