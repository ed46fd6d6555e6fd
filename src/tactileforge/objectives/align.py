"""Aligns touch with camera images and with text (contrastive, InfoNCE)."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch
from tactileforge.heads.align import Aligned
from tactileforge.util.distributed import gather_rows
from tactileforge.util.means import Mean
from tactileforge.util.unit import unit


class Align(nn.Module):
    """Symmetric InfoNCE of touch-vision and touch-language, each over samples with both modalities.

    Features are gathered over ranks, with gradients. Source: AnyTouch 2, appendix Multi-modal
    Aligning loss.

    Args:
        alpha_tv: Weight of touch-vision.
        alpha_tl: Weight of touch-language.
    """

    head: ClassVar[str] = "align"
    needs: ClassVar[frozenset[str]] = frozenset({"text|image"})

    def __init__(self, alpha_tv: float = 0.2, alpha_tl: float = 0.2) -> None:
        super().__init__()
        self.alpha_tv = alpha_tv
        self.alpha_tl = alpha_tl

    def forward(self, prediction: Aligned, batch: Batch) -> tuple[Mean, dict[str, Mean]]:
        """Computes the loss; logs both parts, unweighted."""
        rows = (
            ("touch_image", self.alpha_tv, prediction.image, prediction.image_valid),
            ("touch_text", self.alpha_tl, prediction.text, prediction.text_valid),
        )
        given = [(name, alpha, x, valid) for name, alpha, x, valid in rows if x is not None]
        if not given:  # still connected to the graph: DDP waits for a gradient of every rank
            nothing = 0 * (prediction.touch.sum() + prediction.scale)
            return Mean(nothing, torch.zeros_like(nothing)), {}
        vectors = torch.stack([prediction.touch, *(x for _, _, x, _ in given)], dim=1)
        touch, *others = gather_rows(unit(vectors)).unbind(1)
        valid = gather_rows(torch.stack([valid for *_, valid in given], dim=1)).T
        means = info_nce(touch, torch.stack(others), valid, prediction.scale)
        parts = [alpha * mean for (_, alpha, *_), mean in zip(given, means, strict=True)]
        logs = {name: mean.detach() for (name, *_), mean in zip(given, means, strict=True)}
        return sum(parts[1:], parts[0]), logs


def info_nce(a: Tensor, b: Tensor, valid: Tensor, scale: Tensor) -> list[Mean]:
    """Means of the two directions of InfoNCE over the valid rows, n times; 0 without valid rows.

    Args:
        a: float (B, d), unit vectors.
        b: float (n, B, d), unit vectors; row i belongs to row i of ``a``.
        valid: bool (n, B), rows with both vectors.
        scale: Inverse temperature, a scalar.
    """
    logits = b @ (scale * a).T
    lowest = torch.finfo(logits.dtype).min  # not -inf: a batch without valid rows would give NaN
    hidden = ~valid
    ways = torch.stack([logits, logits.mT], dim=1).masked_fill(hidden[:, None, None], lowest)
    right = ways.log_softmax(-1).diagonal(dim1=-2, dim2=-1).mean(1)
    count = valid.sum(1, dtype=torch.float32)
    values = -right.masked_fill(hidden, 0).sum(1) / count.clamp(min=1)
    return [Mean(*row) for row in zip(values.unbind(), count.unbind(), strict=True)]
