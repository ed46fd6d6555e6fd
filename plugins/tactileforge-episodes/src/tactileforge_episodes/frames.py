"""Frames of arrays, as a map describes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames
from tactileforge.data import EncodedFrames, LazyImages, is_deep, pixels_of
from tactileforge.errors import DataError
from tactileforge_episodes.map_keys import PictureKeys
from tactileforge_episodes.refs import ArrayRef
from tactileforge_episodes.shown import check_frames, encoded_image, is_encoded


@dataclass(frozen=True)
class Pictures:
    """Rows of an array of pictures.

    Attributes:
        ref: The array.
        start: First row.
        stop: Row after the last.
        keys: Order of its channels and axes, and its white.
        pad: Index along the second axis; None where there is none.
        columns: First column, and the one after the last; None for all.
    """

    ref: ArrayRef
    start: int
    stop: int
    keys: PictureKeys
    pad: int | None = None
    columns: tuple[int, int] | None = None

    def __len__(self) -> int:
        return self.stop - self.start

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        sizes = self.ref.facts.shape[1 if self.pad is None else 2 :]
        height, width = sizes[1:] if self.keys.axes == "chw" else sizes[:2]
        return height, width if self.columns is None else self.columns[1] - self.columns[0]

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Reads pictures; see `contracts.Frames.read`."""
        check_frames(indices, len(self), self.ref)
        values = self.ref.rows([self.start + i for i in indices])
        values = values if self.pad is None else values[:, self.pad]
        values = values[..., None] if self.keys.axes == "hw" else values
        values = np.moveaxis(values, 1, -1) if self.keys.axes == "chw" else values
        values = np.repeat(values, 3, -1) if values.shape[-1] == 1 else values[..., :3]
        if self.columns is not None:
            values = values[:, :, slice(*self.columns)]
        pixels = pixels_of(values, self.keys.white, str(self.ref))
        if not pixels.any():  # since it was opened, a chunk may have gone
            check_stored(self.ref, range(self.start + min(indices), self.start + max(indices) + 1))
        return np.ascontiguousarray(pixels[..., ::-1] if self.keys.is_bgr else pixels)


@dataclass(frozen=True)
class Reference:
    """A single picture without contact, uint8 or with fractions from 0 to white.

    Attributes:
        ref: The array, (H, W, 3), or (pads, H, W, 3).
        pad: Index along the first axis; None where there is none.
        is_bgr: Whether blue comes first.
        white: Value of white.
    """

    ref: ArrayRef
    pad: int | None
    is_bgr: bool
    white: float = 255.0

    def __len__(self) -> int:
        return 1

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        height, width = self.ref.facts.shape[-3:-1]
        return height, width

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Reads the picture; see `contracts.Frames.read`."""
        check_frames(indices, 1, self.ref)
        values = self.ref.whole()
        values = values if self.pad is None or values.ndim < 4 else values[self.pad]
        pixels = pixels_of(values.reshape(values.shape[-3:]), self.white, str(self.ref))
        return np.stack([pixels[..., ::-1] if self.is_bgr else pixels] * len(indices))


def open_pictures(
    ref: ArrayRef,
    rows: range,
    keys: PictureKeys,
    pad: int | None = None,
    columns: tuple[int, int] | None = None,
) -> Frames:
    """Frames of an array of pictures or of encoded images.

    Args:
        ref: The array.
        rows: Its rows.
        keys: Order of its channels and axes, and its white.
        pad: Index along the second axis; None where there is none.
        columns: First column, and the one after the last; None for all.

    Raises:
        DataError: The array holds no pictures.
    """
    facts = ref.facts
    check_stored(ref, rows)
    if is_encoded(ref):
        is_bgr = (keys.encoded or keys.channels) == "bgr"
        return EncodedFrames(
            str(ref), LazyImages(len(rows), partial(encoded_image, ref, rows)), bgr=is_bgr
        )
    sizes = facts.shape[1 if pad is None else 2 :]
    sizes = (*sizes, 1) if keys.axes == "hw" else sizes
    channel = 0 if keys.axes == "chw" else 2
    has_white = facts.dtype.kind == "f" or is_deep(facts.dtype)
    good_type = facts.dtype == np.uint8 or (has_white and keys.white is not None)
    if len(sizes) != 3 or sizes[channel] not in (1, 3, 4) or not good_type or 0 in sizes:
        wanted = {"hwc": "(T, H, W, 3)", "chw": "(T, 3, H, W)", "hw": "(T, H, W)"}[keys.axes]
        wanted = wanted if pad is None else wanted.replace("(T", "(T, pads")
        fix = "; for fractions or 16 bits give `white`" if has_white and not good_type else ""
        raise DataError(
            f"{ref}: {facts.dtype} {facts.shape}, where uint8 {wanted} is expected{fix}; correct "
            "the map, or the file"
        )
    if columns is not None and not 0 <= columns[0] < columns[1] <= sizes[1 if channel else 2]:
        raise DataError(f"{ref}: {facts.shape} has no columns {columns[0]} to {columns[1] - 1}")
    return Pictures(ref, rows.start, rows.stop, keys, pad, columns)


def check_stored(ref: ArrayRef, rows: range) -> None:
    """Raises a `DataError` for pictures of a missing chunk: they would be black."""
    if len(rows) and ref.facts.rows >= rows.stop and (lost := ref.lost(rows.start, rows.stop)):
        raise DataError(
            f"{ref}: {len(lost)} of {len(rows)} pictures, the first of row {lost[0]}, lie in a "
            "chunk that is missing; download it again"
        )
