"""Crops of frames, shared by videos and images."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError

#: Left, top, width and height of a part of a frame, in pixels.
Crop: TypeAlias = tuple[int, int, int, int]


class Cropped:
    """Base of frames of one size with a crop.

    Args:
        name: Name of the file, for messages.
        size: Height and width of a full frame, pixels.
        crop: Left, top, width and height, pixels; None shows everything.

    Attributes:
        full_shape: Height and width of a full frame, pixels.
        box: Left, top, width and height of the shown part, pixels.

    Raises:
        DataError: The crop lies outside the frame.
    """

    def __init__(self, name: str, size: tuple[int, int], crop: Crop | None) -> None:
        self._name = name
        self.full_shape = size
        self.box = _checked(crop, size, name)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        _, _, width, height = self.box
        return height, width

    def crop(self, box: Crop) -> Self:
        """The same frames with another crop of the full frame; reads nothing."""
        other = copy.copy(self)
        other.box = _checked(box, self.full_shape, self._name)
        return other

    def _show(self, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        left, top, width, height = self.box
        return frame[top : top + height, left : left + width]


def _checked(crop: Crop | None, size: tuple[int, int], name: str) -> Crop:
    height, width = size
    left, top, wide, high = crop or (0, 0, width, height)
    if min(left, top) < 0 or min(wide, high) < 1 or left + wide > width or top + high > height:
        raise DataError(
            f"{name}: the crop {list(crop or ())} (left, top, width, height) lies outside its "
            f"{size_text(size)} pixels; correct the crop"
        )
    return left, top, wide, high


def check_range(indices: Sequence[int], count: int, name: str) -> None:
    """Raise an `IndexError` for a frame number outside ``0..count - 1``."""
    for i in indices:
        if not 0 <= i < count:
            raise IndexError(f"{name}: frame {i} of {count}")


def check_background_size(
    background: Sequence[int],
    frames: Sequence[int],
    where: str,
    other: str = "the frames",
    fix: str = "give a background of the same size",
) -> None:
    """Check a background for the size of the frames.

    Args:
        background: Height and width of the background, pixels.
        frames: Height and width of the frames, pixels.
        where: Name of the background, for the message.
        other: Name of the frames.
        fix: Fix, as a phrase.

    Raises:
        DataError: The sizes differ.
    """
    if tuple(background) != tuple(frames):
        raise DataError(
            f"{where}: the background has {size_text(background)} pixels, {other} "
            f"{size_text(frames)}; {fix}"
        )


def size_text(shape: Sequence[int]) -> str:
    """Format (height, width) as width x height."""
    return f"{shape[1]}x{shape[0]}"
