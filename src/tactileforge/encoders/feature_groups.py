"""Features of a clip in named groups: from trained networks, and directly from the pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal, get_args

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.encoders.preprocess import ANYTOUCH2, Preprocess
from tactileforge.encoders.summary import CELLS, encode_summary, summarise, summary_width
from tactileforge.errors import ConfigError, check_names

Group = Literal["summary", "photographs", "difference", "statistics"]
#: Names of all groups, in the order of their concatenation.
FEATURE_GROUPS: tuple[str, ...] = get_args(Group)
#: Rows and columns of the cells averaged by `low_pass_difference`.
LOW_PASS = 8
#: Rows and columns of resized images for `picture_statistics`.
STATISTICS_SIZE = 128
_QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
#: Edges of the rings of the spectrum, in cycles per pixel.
_RINGS = (0.0, 0.015, 0.03, 0.06, 0.12, 0.2, 0.3, 0.5)
#: Number of statistics of a picture: moments, slopes, quantiles and rings of three channels, and
#: correlations.
_STATISTICS = 3 * (4 + 4 + len(_QUANTILES) + len(_RINGS) - 1) + 3

#: Factor of each group in the joint vector, see `joint_vector`. The best of thirteen choices that
#: were tried on suite=real (docs/reports/gate.md).
SCALES = {"summary": 0.0118, "photographs": 0.0011, "difference": 0.0015, "statistics": 0.0078}


def group_sizes(encoder: Any) -> dict[str, int]:
    """Sizes of an encoder's groups, by name, in the order of `GROUPS`."""
    stream = getattr(encoder, "photo_stream", None)
    sizes = {"summary": summary_width(encoder)}
    if stream is not None:
        sizes["photographs"] = (CELLS**2 + 1) * len(stream.deviation)
    return sizes | {"difference": 2 * 3 * LOW_PASS**2, "statistics": _STATISTICS}


def check_groups(encoder: Any, names: Sequence[str] | None) -> tuple[str, ...]:
    """Names of groups in the order of `GROUPS`; None takes all groups of the encoder.

    Raises:
        ConfigError: The encoder has no such group, or no group is named.
    """
    sizes = group_sizes(encoder)
    if names is None:
        return tuple(sizes)
    if isinstance(names, str) or not names:
        raise ConfigError(f"groups={names!r}: give a list of names, of: {', '.join(sizes)}")
    check_names("group of features of the model", names, sizes)
    return tuple(name for name in sizes if name in names)


def encode_groups(
    encoder: Any, frames: Tensor, background: Tensor, sensor: Tensor, names: Sequence[str]
) -> dict[str, Tensor]:
    """Computes the named groups of features, each once, and no others.

    ``summary`` and ``photographs`` share one pass of the encoder. ``photographs`` alone runs the
    network of photographs and no block of the transformer; without both, no network runs.

    Args:
        encoder: Touch encoder; see `contracts.Encoder`.
        frames: uint8 (B, T, 3, H, W).
        background: uint8 (B, 3, H, W).
        sensor: int64 (B,), rows of the sensor table.
        names: Names of the groups, see `check_groups`.

    Returns:
        float32 (B, n) by name: ``summary``, see `encode_summary`; ``photographs``, maps of the
        network of photographs, divided by their usual deviations, as means of quarters and
        deviations over the picture, (B, 2360); ``difference``, see `low_pass_difference`;
        ``statistics``, see `picture_statistics`.
    """
    out: dict[str, Tensor] = {}
    if "summary" in names:
        _, _, out = encode_trained(encoder, frames, background, sensor, "photographs" in names)
    elif "photographs" in names:
        stream = encoder.photo_stream
        patches = encoder.patchify(encoder.preprocess(frames, background, sensor))
        scaled = stream.maps(patches, None) / stream.deviation
        out["photographs"] = summarise(scaled.flatten(1, 2), encoder.grid)
    return {name: values.float() for name, values in out.items()} | free_groups(
        frames, background, names
    )


def encode_trained(
    encoder: Any, frames: Tensor, background: Tensor, sensor: Tensor, photographs: bool = True
) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """Runs an encoder once for tokens, projected class tokens, and the groups of its networks.

    Args:
        encoder: Touch encoder; see `contracts.Encoder`.
        frames: uint8 (B, T, 3, H, W).
        background: uint8 (B, 3, H, W).
        sensor: int64 (B,), rows of the sensor table.
        photographs: Whether to compute the group ``photographs``, if the encoder has it.
    """
    stream = getattr(encoder, "photo_stream", None) if photographs else None
    maps: list[Tensor] = []
    # the maps on their way into the stream's projection: the network runs once for both
    hook = stream and stream.project.register_forward_pre_hook(lambda _, x: maps.append(x[0]))
    try:
        tokens, projected, summary = encode_summary(encoder, frames, background, sensor)
    finally:
        if hook is not None:
            hook.remove()
    groups = {"summary": summary}
    if maps:
        groups["photographs"] = summarise(maps[0], encoder.grid)
    return tokens, projected, groups


def free_groups(frames: Tensor, background: Tensor, names: Sequence[str]) -> dict[str, Tensor]:
    """Computes the named groups among those without a network; see `encode_groups`."""
    free = {"difference": low_pass_difference, "statistics": picture_statistics}
    return {name: read(frames, background) for name, read in free.items() if name in names}


def joint_vector(groups: Mapping[str, Tensor]) -> Tensor:
    """Concatenates groups, each times its fixed factor, to float32 (..., n).

    Factors are constants, so a vector depends on its clip alone and keeps the strength of a touch.
    With them the total variance within a task is about 1, with shares of .98 for the summary, .01
    for the photographs, and .005 each for difference and statistics: the best of thirteen sets of
    shares for a plain linear probe on ``suite=real``. Larger shares of the other groups cost more
    on forces and hardness than they gained elsewhere. Variances are medians over those tasks, of
    ``anytouch2.tiny-real``.

    Args:
        groups: Groups by name, float (..., n) each, see `encode_groups`.
    """
    return torch.cat([SCALES[name] * values for name, values in groups.items()], -1)


def low_pass_difference(frames: Tensor, background: Tensor) -> Tensor:
    """Coarse changes in grey levels, float32 (B, 384), neither normalised nor clamped.

    Means over 8 x 8 cells (channel, row, column) of the difference between the last frame and the
    background, then between the last frame and the first. Red, green and blue stay separate: their
    light comes from different sides, so shear and depth differ between them.

    Args:
        frames: uint8 (B, T, 3, H, W).
        background: uint8 (B, 3, H, W).
    """
    last = frames[:, -1].float()
    change = torch.cat([last - background.float(), last - frames[:, 0].float()], 1)
    return F.adaptive_avg_pool2d(change, LOW_PASS).flatten(1)


def picture_statistics(frames: Tensor, background: Tensor) -> Tensor:
    """Statistics of the last frame minus its background at 128 x 128, float32 (B, 69).

    Args:
        frames: uint8 (B, T, 3, H, W).
        background: uint8 (B, 3, H, W).
    """
    pixels = Preprocess.of((STATISTICS_SIZE, STATISTICS_SIZE), ANYTOUCH2).to(frames.device)
    return statistics_of(pixels(frames[:, -1:], background)[:, 0])


def statistics_of(picture: Tensor) -> Tensor:
    """Moments, slopes, quantiles and rings of the spectrum of each channel, and correlations.

    Args:
        picture: Preprocessed image, float (B, 3, H, W).

    Returns:
        float (B, 69): mean, deviation, skewness and kurtosis of the channels; mean absolute slope
        and deviation of the slope, down and across; seven quantiles; logarithms of the power in
        seven rings; and correlations between channels.
    """
    flat = picture.flatten(2)
    mean, spread = flat.mean(2), flat.std(2)
    # a flat channel, as the difference of a frame to itself, has no deviation
    unit = (flat - mean[..., None]) / spread[..., None].clamp(min=1e-6)
    edges = torch.tensor(_QUANTILES, device=picture.device)
    quantiles = flat.quantile(edges, dim=2).permute(1, 2, 0)
    steps = [picture.diff(dim=dim).flatten(2) for dim in (2, 3)]
    slopes = [part for step in steps for part in (step.abs().mean(2), step.std(2))]
    each = [mean, spread, unit.pow(3).mean(2), unit.pow(4).mean(2), *slopes]
    between = (unit[:, [0, 0, 1]] * unit[:, [1, 2, 2]]).mean(2)
    return torch.cat([*each, quantiles.flatten(1), rings(picture).flatten(1), between], 1)


def rings(x: Tensor) -> Tensor:
    """Logarithm of the power in rings of the spectrum, (B, C, 7) of (B, C, H, W)."""
    # ortho: the power does not grow with the number of pixels
    power = torch.fft.fft2(x, norm="ortho").abs().square()
    across, down = (torch.fft.fftfreq(n, device=x.device) for n in (x.shape[3], x.shape[2]))
    radius = (across[None] ** 2 + down[:, None] ** 2).sqrt()
    inside = [(radius > low) & (radius <= high) for low, high in pairwise(_RINGS)]
    return (
        torch.stack([(power * ring).sum((2, 3)) / ring.sum() for ring in inside], 2).add(1e-6).log()
    )
