"""Clips as pictures: input, masked, reconstructed, and how their frames differ."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from PIL import Image
from torch import Tensor

from tactileforge.contracts import Encoder
from tactileforge.heads.decoder import Reconstruction

#: Colour of what is hidden (sRGB, 0..1); frames are grey where nothing touches.
_HIDDEN = (0.09, 0.09, 0.13)
#: Pixels; wider frames are shrunk.
_WIDEST = 144


@dataclass(frozen=True)
class Strips:
    """One clip and its reconstructions.

    Attributes:
        rows: Frames of each row by its name, float (n, 3, H, W) in 0..1.
        gain: By what differences are amplified; they lie around mid-grey.
        explained: Share of the variance of masked pixels that a reconstruction explains, by kind.
    """

    rows: dict[str, Tensor]
    gain: float
    explained: dict[str, float]


def strips_of(
    encoder: Encoder, patches: Tensor, predictions: Sequence[Reconstruction], row: int
) -> Strips:
    """Rows of pictures of one clip of a batch.

    A reconstruction of T frames is one of the frames, one of T - 1 one of the differences to the
    first.

    Args:
        encoder: Made the patches.
        patches: float (B, slots, N, 3 * tube * patch * patch).
        predictions: Reconstructions of the batch.
        row: Which clip of the batch.
    """
    frames = _framewise(patches[row], encoder.tube)
    count = frames.shape[1]
    whole = next((p for p in predictions if p.target.shape[2] == count), None)
    change = next((p for p in predictions if p.target.shape[2] == count - 1 > 0), None)
    rows = {"Input": _colour(encoder, _canvas(encoder, frames))}
    explained = {}
    if predictions:
        hidden = predictions[0].masked[row]
        shown = rows["Input"].clone()
        where = torch.zeros(len(frames), 1, 1, dtype=torch.bool)
        where[hidden.cpu()] = True
        mask = _canvas(encoder, where.expand_as(frames).float()) > 0
        colour = torch.tensor(_HIDDEN).view(3, 1, 1).expand_as(shown)
        rows["Masked"] = torch.where(mask, colour, shown)
    if whole is not None:
        rows["Reconstructed"] = _colour(encoder, _canvas(encoder, _pasted(frames, whole, row)))
        explained["frames"] = _explained(whole, row, centre=True)
    gain = 1.0
    if count > 1:
        true = frames[:, 1:] - frames[:, :1]
        drawn = _canvas(encoder, true) * _spread(encoder)
        gain = 0.5 / max(float(drawn.abs().quantile(0.995)), 2 / 255)
        rows["Difference"] = (0.5 + gain * drawn).clamp(0, 1)
        if change is not None:
            drawn = _canvas(encoder, _pasted(true, change, row)) * _spread(encoder)
            rows["Difference, reconstructed"] = (0.5 + gain * drawn).clamp(0, 1)
            explained["differences"] = _explained(change, row, centre=False)
    return Strips(rows, gain, explained)


def jpeg(frame: Tensor) -> tuple[str, int, int]:
    """A frame as a data URL, and its width and height in pixels.

    Args:
        frame: float (3, H, W) in 0..1.
    """
    image = Image.fromarray((frame.permute(1, 2, 0) * 255).round().to(torch.uint8).numpy())
    if image.width > _WIDEST:
        size = (_WIDEST, max(1, round(image.height * _WIDEST / image.width)))
        image = image.resize(size, Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.save(file, "JPEG", quality=90, subsampling=0)
    text = base64.b64encode(file.getvalue()).decode()
    return f"data:image/jpeg;base64,{text}", image.width, image.height


def _framewise(patches: Tensor, tube: int) -> Tensor:
    """(slots, N, 3 * tube * P) to (N, slots * tube, 3 * P)."""
    slots, count, _ = patches.shape
    x = patches.float().cpu().view(slots, count, 3, tube, -1).permute(1, 0, 3, 2, 4)
    return x.reshape(count, slots * tube, -1)


def _canvas(encoder: Encoder, x: Tensor) -> Tensor:
    """(N, n, 3 * patch * patch) to (n, 3, H, W)."""
    _, rows, columns = encoder.grid
    side = encoder.patch
    x = x.reshape(rows, columns, -1, 3, side, side).permute(2, 3, 0, 4, 1, 5)
    return x.reshape(-1, 3, rows * side, columns * side)


def _pasted(frames: Tensor, found: Reconstruction, row: int) -> Tensor:
    """The frames (N, n, P), masked positions as predicted."""
    out = frames.clone()
    out[found.masked[row].cpu()] = found.predicted[row].float().cpu()
    return out


def _explained(found: Reconstruction, row: int, centre: bool) -> float:
    """1 - squared error / variance; around 0, or around the mean of each channel."""
    target, predicted = found.target[row].float(), found.predicted[row].float()
    wrong = (target - predicted).square().sum()
    if centre:
        target = target.reshape(*target.shape[:2], 3, -1)
        target = target - target.mean((0, 1, 3), keepdim=True)
    return float(1 - wrong / target.square().sum().clamp(min=1e-12))


def _spread(encoder: Any) -> Tensor:
    """What 1 in normalised pixels is in 0..1; a quarter for an encoder that does not tell."""
    std: Tensor = getattr(encoder, "std", torch.full((3, 1, 1), 0.25))
    return std.float().cpu()


def _colour(encoder: Any, frames: Tensor) -> Tensor:
    """Normalised frames to colours in 0..1."""
    mean: Tensor = getattr(encoder, "mean", torch.full((3, 1, 1), 0.5))
    return (frames * _spread(encoder) + mean.float().cpu()).clamp(0, 1)
