"""Summary vector of a clip from several depths of an encoder: local means and deviations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.errors import ConfigError

#: Largest number of summarised blocks, evenly spaced up to the last.
BLOCKS = 4
#: Rows and columns of the cells to average.
CELLS = 2


def encode_summary(
    encoder: Any, frames: Tensor, background: Tensor, sensor: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Runs an encoder once for its tokens, projected class tokens, and the summary.

    For at most four blocks, evenly spaced, the summary holds the mean of the patch tokens in each
    quarter of the image and their standard deviation over the whole image. Deeper blocks hold more
    of the training task, earlier ones more of texture and strength of contact, and a mean alone
    hides the variation of a feature. A second stream is summarised like a block. For an encoder
    without blocks the tokens are summarised.
    Source: concatenated blocks as in DINOv2's linear probes (Oquab et al. 2023), means of quarters
    as in spatial pyramids (Lazebnik et al. 2006), deviations as in statistics pooling (Snyder et
    al. 2018).

    Args:
        encoder: Touch encoder; see `contracts.Encoder`.
        frames: uint8 (B, T, 3, H, W).
        background: uint8 (B, 3, H, W).
        sensor: int64 (B,), rows of the sensor table.

    Returns:
        float (B, L, width), (B, projected) and (B, `summary_width`).
    """
    states: list[Tensor] = []
    # by hooks, since an encoder returns its last state alone
    hooks = [
        part.register_forward_hook(lambda _module, _given, state: states.append(state))
        for part in summarised_parts(encoder)
    ]
    try:
        tokens, projected = encoder(frames, background, sensor)
    finally:
        for hook in hooks:
            hook.remove()
    # encoders without blocks like ours have their tokens alone
    return tokens, projected, join_summary(states or [tokens], encoder.grid)


def join_summary(states: Sequence[Tensor], grid: tuple[int, int, int]) -> Tensor:
    """Summary of the outputs of `summarised_parts`, or of the tokens without such parts.

    Args:
        states: float32 (B, L, width) each; see `summarise`.
        grid: Numbers of temporal slots, rows and columns of the patches.

    Raises:
        ConfigError: A part gives no tokens.
    """
    for state in states:
        if not isinstance(state, Tensor) or state.dim() != 3:
            raise ConfigError(
                "blocks of this encoder (encoder.transformer.blocks) do not give (B, L, width), "
                "as a summary needs: give groups= without it, or call its blocks otherwise"
            )
    return torch.cat([summarise(state, grid) for state in states], dim=1)


def summary_width(encoder: Any) -> int:
    """Length of the summary of an encoder."""
    count = max(1, len(summarised_parts(encoder)))
    width = int(encoder.width)
    if _second_stream(encoder):  # its channels are concatenated to the blocks': half of the width
        width //= 2
    return count * (CELLS**2 + 1) * width


def summarised_parts(encoder: Any) -> list[Any]:
    """Modules with outputs to summarise: some blocks and any second stream; empty for none."""
    blocks = getattr(getattr(encoder, "transformer", None), "blocks", ())
    count = min(BLOCKS, len(blocks))
    chosen = [blocks[(i + 1) * len(blocks) // count - 1] for i in range(count)]
    return [*chosen, *_second_stream(encoder)]


def _second_stream(encoder: Any) -> list[Any]:
    stream = getattr(encoder, "photo_stream", None)
    return [] if stream is None else [stream]


def summarise(tokens: Tensor, grid: tuple[int, int, int]) -> Tensor:
    """Means of the patch tokens in each quarter, and their deviations, float (B, 5 * width).

    Args:
        tokens: float (B, L, width); the last of the L are the patches.
        grid: Numbers of temporal slots, rows and columns of the patches.
    """
    slots, rows, columns = grid
    patches = tokens[:, -slots * rows * columns :].float()
    maps = patches.reshape(len(patches), *grid, -1).mean(1).permute(0, 3, 1, 2)
    means = F.adaptive_avg_pool2d(maps, CELLS).flatten(2).mT
    # by two passes, a tenth of the time of `Tensor.std` on a CPU
    deviations = (patches - patches.mean(1, keepdim=True)).square_().mean(1).sqrt_()
    return torch.cat([means.flatten(1), deviations], dim=1)
