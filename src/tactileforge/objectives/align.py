"""Aligns touch with camera images and with text (contrastive, InfoNCE)."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.heads.align import Aligned
from tactileforge.util.distributed import gather_rows
from tactileforge.util.means import Mean


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
        touch = gather_rows(F.normalize(prediction.touch, dim=-1))
        # without a pair still connected to the graph: DDP waits for a gradient of every rank
        nothing = touch.sum() * 0 + prediction.scale * 0
        loss = Mean(nothing, torch.zeros_like(nothing))
        logs = {}
        for name, alpha, other, valid in (
            ("touch_image", self.alpha_tv, prediction.image, prediction.image_valid),
            ("touch_text", self.alpha_tl, prediction.text, prediction.text_valid),
        ):
            if other is None:
                continue
            pair = gather_rows(F.normalize(other, dim=-1))
            part = info_nce(touch, pair, gather_rows(valid), prediction.scale)
            loss = loss + alpha * part
            logs[name] = part.detach()
        return loss, logs


def info_nce(a: Tensor, b: Tensor, valid: Tensor, scale: Tensor) -> Mean:
    """Mean of the two directions of InfoNCE over the valid rows; 0 without valid rows.

    Args:
        a: float (B, d), unit vectors.
        b: float (B, d), unit vectors; row i belongs to row i of ``a``.
        valid: bool (B,), rows with both vectors.
        scale: Inverse temperature, a scalar.
    """
    logits = scale * a @ b.T
    lowest = torch.finfo(logits.dtype).min  # not -inf: a batch without valid rows would give NaN
    target = torch.arange(len(a), device=a.device)
    losses = (
        F.cross_entropy(side.masked_fill(~valid[None, :], lowest), target, reduction="none")
        for side in (logits, logits.T)
    )
    rows = torch.where(valid, sum(losses, torch.zeros_like(logits[0])) / 2, 0.0)
    count = valid.sum().float()
    return Mean(rows.sum() / count.clamp(min=1), count)
