"""Clips as images: input, masked, reconstructed, and differences between frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tactileforge.contracts import Encoder
from tactileforge.heads.decoder import Reconstruction

#: Colour of hidden tubes (sRGB, 0..1), unlike the grey of frames without contact.
_HIDDEN = (0.09, 0.09, 0.13)

#: Colour of the light on salient patches.
_LIGHT = [[[0.75]], [[0.42]], [[0.02]]]


@dataclass(frozen=True)
class Strips:
    """One clip and its reconstructions.

    Attributes:
        rows: Frames of each row, float (n, 3, H, W) in 0..1, by name of the row.
        gain: Factor of amplified differences; no difference is mid-grey.
        explained: Share of the variance of masked pixels explained by a reconstruction, by kind.
    """

    rows: dict[str, Tensor]
    gain: float
    explained: dict[str, float]


def kind_of(reconstruction: Reconstruction, frames: int) -> str:
    """Kind of reconstruction: T ``frames``, T - 1 ``differences`` to the first, or ``""``."""
    return {frames: "frames", frames - 1: "differences"}.get(reconstruction.target.shape[2], "")


def residuals(reconstruction: Reconstruction, kind: str) -> Tensor:
    """Squared error and variance of hidden pixels, summed per clip: float (B, 2).

    The variance of frames is around the mean of each channel over the clip's hidden pixels; the
    variance of differences is around 0.
    """
    target = reconstruction.target.float()
    wrong = (target - reconstruction.predicted.float()).square().sum((1, 2, 3))
    if kind == "frames":
        channels = target.reshape(*target.shape[:3], 3, -1)
        target = (channels - channels.mean((1, 2, 4), keepdim=True)).flatten(3)
    return torch.stack([wrong, target.square().sum((1, 2, 3))], dim=1).cpu()


def share(residual: Tensor) -> float:
    """Share of explained variance; NaN without variance.

    Args:
        residual: Squared error and variance, float (2,), see `residuals`.
    """
    wrong, variance = residual.tolist()
    return 1 - wrong / variance if variance > 1e-9 else float("nan")


def strips_of(
    encoder: Encoder,
    patches: Tensor,
    predictions: Sequence[Reconstruction],
    row: int,
    saliency: Tensor | None = None,
) -> Strips:
    """Rows of images of one clip of a batch.

    Args:
        encoder: Encoder of the patches.
        patches: Patches of the batch, float (B, slots, N, 3 * tube * patch * patch).
        predictions: Reconstructions of the batch.
        row: Index of the clip in the batch.
        saliency: float (B, slots, N), see `samples.saliency`; None for no row of it.
    """
    # tubes to frames: (slots, N, 3 * tube * P) to (N, slots * tube, 3 * P)
    slots, patch_count, _ = patches[row].shape
    cells = patches[row].float().cpu().view(slots, patch_count, 3, encoder.tube, -1)
    frames = cells.permute(1, 0, 3, 2, 4).reshape(patch_count, slots * encoder.tube, -1)
    count = frames.shape[1]
    by_kind = {kind_of(value, count): value for value in reversed(predictions)}  # the first wins
    explained: dict[str, float] = {
        kind: share(residuals(by_kind[kind], kind)[row])
        for kind in ("frames", "differences")
        if kind in by_kind
    }
    rows = {"Input": _colour(encoder, _canvas(encoder, frames))}
    if saliency is not None:
        rows["Saliency"] = _lit(encoder, rows["Input"], saliency[row].float().cpu())
    if predictions:
        _, down, across = encoder.grid
        where = torch.zeros(down * across, dtype=torch.bool)
        where[predictions[0].masked[row].cpu()] = True
        side = encoder.patch
        mask = where.view(down, across).repeat_interleave(side, 0).repeat_interleave(side, 1)
        hidden = torch.tensor(_HIDDEN).view(3, 1, 1)
        rows["Masked"] = torch.where(mask, hidden, rows["Input"])
    if "frames" in by_kind:
        pasted = _pasted(frames, by_kind["frames"], row)
        rows["Reconstructed"] = _colour(encoder, _canvas(encoder, pasted))
    if count == 1:
        return Strips(rows, 1.0, explained)
    true = frames[:, 1:] - frames[:, :1]
    if not true.any():  # an image, shown as a clip
        return Strips({name: shown[:1] for name, shown in rows.items()}, 1.0, explained)
    drawn = _canvas(encoder, true) * _spread(encoder)
    # all but the largest half percent fits; a still clip is not amplified to show noise alone
    gain = 0.5 / max(float(drawn.abs().quantile(0.995)), 2 / 255)
    rows["Difference"] = (0.5 + gain * drawn).clamp(0, 1)  # one gain for both rows below
    if "differences" in by_kind:
        pasted = _canvas(encoder, _pasted(true, by_kind["differences"], row))
        rows["Difference, reconstructed"] = (0.5 + gain * pasted * _spread(encoder)).clamp(0, 1)
    return Strips(rows, gain, explained)


def _canvas(encoder: Encoder, x: Tensor) -> Tensor:
    """Assembles patches to frames: (N, n, 3 * patch * patch) to (n, 3, H, W)."""
    _, rows, columns = encoder.grid
    side = encoder.patch
    x = x.reshape(rows, columns, -1, 3, side, side).permute(2, 3, 0, 4, 1, 5)
    return x.reshape(-1, 3, rows * side, columns * side)


def _lit(encoder: Encoder, pictures: Tensor, saliency: Tensor) -> Tensor:
    """Pictures (T, 3, H, W), grey and dim, with light on patches by their saliency (slots, N)."""
    _, rows, columns = encoder.grid
    share = saliency.clamp(min=0) / saliency.max().clamp(min=1e-12)
    share = share.view(-1, 1, rows, columns).repeat_interleave(encoder.tube, 0)
    share = share.repeat_interleave(encoder.patch, 2).repeat_interleave(encoder.patch, 3)
    return (0.55 * pictures.mean(1, keepdim=True) + share * torch.tensor(_LIGHT)).clamp(0, 1)


def _pasted(frames: Tensor, reconstruction: Reconstruction, row: int) -> Tensor:
    """Replaces the masked positions of frames (N, n, P) by their predictions."""
    out = frames.clone()
    out[reconstruction.masked[row].cpu()] = reconstruction.predicted[row].float().cpu()
    return out


def _spread(encoder: Any) -> Tensor:
    """Standard deviation of pixels in 0..1; 0.25 for an encoder without one."""
    return _normalisation(encoder, "std", 0.25)


def _normalisation(encoder: Any, name: str, otherwise: float) -> Tensor:
    """Mean or standard deviation of pixels (3, 1, 1), averaged over sensors with their own."""
    pixels = getattr(encoder, "pixels", None)
    value: Tensor = getattr(pixels, name, torch.full((3, 1, 1), otherwise))
    return value.float().cpu().reshape(-1, 3, 1, 1).mean(0)


def _colour(encoder: Any, frames: Tensor) -> Tensor:
    """Turns normalised frames into colours in 0..1."""
    return (frames * _spread(encoder) + _normalisation(encoder, "mean", 0.5)).clamp(0, 1)
