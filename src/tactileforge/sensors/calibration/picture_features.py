"""Inputs of a calibration from pictures alone, in grey levels and without a network."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

#: Rows or columns of shrunk images, whichever are more; shrinking averages noise away.
_SIZE = 64
#: Number of cosines along a side; a pair of them is used if its orders sum to less than this.
_ORDERS = 4
_COLOURS = ("red", "green", "blue")
_PAIRS = [(i, j) for i in range(_ORDERS) for j in range(_ORDERS) if i + j < _ORDERS]
#: Mean change, its first moments across and down, and the coarse shape of each colour's change.
CHANGE_FEATURE = "change"
MOMENT_FEATURES = ("change_x", "change_y")
SHAPE_FEATURES = tuple(f"{color}_{i}{j}" for color in _COLOURS for i, j in _PAIRS)
#: Names of all inputs from pictures.
PICTURE_FEATURES = (CHANGE_FEATURE, *MOMENT_FEATURES, *SHAPE_FEATURES)


def picture_inputs(frames: Tensor, background: Tensor) -> dict[str, Tensor]:
    """Numbers about the change of pictures from their background, float32 (N,) each.

    ``change`` is the mean absolute change over pixels and colours, grey levels; ``change_x`` and
    ``change_y`` are its first moments, with coordinates from -1 to 1. ``red_ij``, ``green_ij`` and
    ``blue_ij`` are the signed change of a colour, as coefficients of the lowest ten cosines (i half
    waves down, j across, i + j < 4) of `low_pass_difference`. There are 33 in all. Nothing is
    normalised or clamped, so amplitude stays.

    Args:
        frames: uint8 (N, 3, H, W).
        background: uint8 (N, 3, H, W), or (1, 3, H, W) for all.

    Example:
        >>> import torch
        >>> rest = torch.full((1, 3, 16, 16), 100, dtype=torch.uint8)
        >>> inputs = picture_inputs(rest + 8, rest)
        >>> round(float(inputs["change"]), 3), round(float(inputs["red_00"]), 3)
        (8.0, 8.0)
    """
    # the names above are needed where torch is not, as in help
    import torch
    from torch.nn import functional as F

    from tactileforge.encoders.feature_groups import LOW_PASS, low_pass_difference

    background = background.expand(len(frames), -1, -1, -1)
    height, width = frames.shape[2:]
    shrunk = min(1.0, _SIZE / max(height, width))
    size = max(1, round(height * shrunk)), max(1, round(width * shrunk))
    change = F.adaptive_avg_pool2d(frames.float() - background.float(), size).abs().mean(1)
    down, across = (torch.linspace(-1, 1, n, device=change.device) for n in size)
    cells = low_pass_difference(frames[:, None], background)[:, : 3 * LOW_PASS**2]
    places = torch.arange(LOW_PASS) + 0.5
    waves = torch.stack([torch.cos(math.pi * i * places / LOW_PASS) for i in range(_ORDERS)])
    waves[1:] *= 2**0.5  # a cosine has a mean square of 1/2, and the constant has 1
    waves = (waves / LOW_PASS).to(change.device)
    shape = torch.einsum("ncij,ai,bj->ncab", cells.reshape(-1, 3, LOW_PASS, LOW_PASS), waves, waves)
    columns = [change.mean((1, 2)), (change * across).mean((1, 2))]
    columns.append((change * down[:, None]).mean((1, 2)))
    columns += [shape[:, color, i, j] for color in range(3) for i, j in _PAIRS]
    return dict(zip(PICTURE_FEATURES, columns, strict=True))
