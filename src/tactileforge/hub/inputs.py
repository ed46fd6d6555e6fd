"""Frames and background as users have them, words included, as an encoder takes them."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

from tactileforge.encoders.inputs import Images, check_clip
from tactileforge.errors import ConfigError

__all__ = ["Clips", "Images", "prepare"]


class Clips(NamedTuple):
    """A batch of clips.

    Attributes:
        frames: uint8 (B, T, 3, H, W).
        background: uint8 (B, 3, H, W).
        single: Whether one clip was given, without the axis of a batch.
    """

    frames: Tensor
    background: Tensor
    single: bool


def prepare(frames: Images, background: Images | str | None, count: int, needed: bool) -> Clips:
    """Checks frames and background, and puts them into a batch.

    Args:
        frames: See `check_clip`; where ``count`` is 1, one image will do.
        background: See `check_clip`; or ``"none"``, which subtracts nothing, or ``"first"``, the
            first frame of each clip.
        count: Frames of a clip.
        needed: Whether the encoder uses the background; if not, None will do.

    Raises:
        DataError: Another type, layout, size or number of frames; says what was expected.
        ConfigError: No background, or an unknown word for it.
    """
    if count == 1 and getattr(frames, "ndim", 0) == 3:
        frames = frames[None]
    single = getattr(frames, "ndim", 0) == 4
    if not isinstance(background, str) and background is not None:
        return Clips(*check_clip(frames, background, count), single)
    clips, neutral = check_clip(frames, None, count)
    if background == "first":
        return Clips(clips, clips[:, 0], single)
    if background == "none" or (background is None and not needed):
        return Clips(clips, neutral, single)
    given = "no background" if background is None else f"background={background!r}"
    raise ConfigError(
        f"{given}: give a frame without contact of the same recording; background='first' takes "
        "the first frame of each clip, background='none' subtracts nothing"
    )
