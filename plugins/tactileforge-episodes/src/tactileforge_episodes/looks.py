"""Looks of an array's values, and the words in its name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from tactileforge.data import is_deep, white_of
from tactileforge.reading import DERIVED, Facts, Values, says_touch

#: Begins of encoded images: JPEG, PNG, WebP, BMP, TIFF, JPEG XL.
_IMAGES = (
    *(b"\xff\xd8\xff", b"\x89PNG", b"RIFF", b"BM", b"II*\0", b"MM\0*"),
    *(b"\xff\x0a", b"\0\0\0\x0cJXL "),
)
#: Fewest pixels of a side of pictures of bytes, and of those of fractions or without channels.
_SIDE, _LONG_SIDE = 8, 16
#: Fewest pixels of a side of pictures of 16 bits: smaller ones are numbers of taxels.
_DEEP_SIDE = 64
#: Smallest side of a single picture: tables of points with three values are narrower.
_ONE_SIDE = 32
#: Most sensors along the second axis of an array.
_PADS = 16


class Arrays(Protocol):
    """Arrays by name: a container, or an episode in it."""

    def array(self, key: str) -> Values:
        """An array by its name."""
        ...


@dataclass(frozen=True)
class Look:
    """An array as its name and description show it.

    Attributes:
        key: Its path.
        facts: Its shape and type.
        words: Words of its path, in small letters.
    """

    key: str
    facts: Facts
    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.key} {self.facts.dtype} {self.facts.shape}"

    @property
    def is_numbers(self) -> bool:
        """Whether its values are numbers."""
        return self.facts.dtype.kind in "biuf"

    @property
    def width(self) -> tuple[int, ...]:
        """Sizes of a row."""
        return self.facts.shape[1:]

    def has(self, words: Iterable[str]) -> bool:
        """Whether one of the words is in its name."""
        return not {*words}.isdisjoint(self.words)


def picture_keys(file: Arrays, look: Look) -> dict[str, Any] | None:
    """Keys of a map to read an array as pictures; None for other values.

    Args:
        file: The container or episode.
        look: The array.

    Raises:
        DataError: It is damaged.
    """
    dtype, width = look.facts.dtype, look.width
    if is_deep(dtype):
        is_touch = says_touch(look.words) and not look.has(DERIVED)
        return deep_keys(file, look) if is_touch else None
    if not look.facts.rows or not look.facts.shape:
        return None
    if (dtype == np.uint8 and len(width) == 1) or (dtype.kind in "SO" and not width):
        return {} if _is_image(file.array(look.key).rows([0])[0]) else None
    if dtype != np.uint8 and dtype.kind != "f":
        return None
    found = _axes(width, _SIDE if dtype == np.uint8 else _LONG_SIDE)
    if found is None and dtype == np.uint8 and len(width) == 2 and min(width) >= _LONG_SIDE:
        found = {"axes": "hw"}
    if found is None and len(width) > 1 and width[0] <= _PADS:
        found = _axes(width[1:], _SIDE if dtype == np.uint8 else _LONG_SIDE)
        if dtype == np.uint8 and len(width) == 3 and found is None and min(width[1:]) >= _LONG_SIDE:
            found = {"axes": "hw"}
        found = None if found is None else {**found, "pads": True}
    if found is None or dtype == np.uint8:
        return found
    values = file.array(look.key).rows(_some(look.facts.rows)).astype(np.float64)
    low, high = float(values.min()), float(values.max())
    if not 0 <= low <= high <= 255:
        return None
    return {**found, "white": 255.0 if high > 1 else 1.0}


def deep_keys(file: Arrays, look: Look) -> dict[str, Any] | None:
    """Keys of a map to read an array of 16 bits as pictures; None for taxels and other values.

    Args:
        file: The container or episode.
        look: The array.

    Raises:
        DataError: It is damaged.
    """
    found = _axes(look.width, _DEEP_SIDE)
    if found is None and len(look.width) == 2 and min(look.width) >= _DEEP_SIDE:
        found = {"axes": "hw"}
    if found is None or not look.facts.rows:
        return None
    most = int(file.array(look.key).rows(_some(look.facts.rows)).max())
    return {**found, "white": white_of(most)}


def _axes(width: Sequence[int], least: int) -> dict[str, Any] | None:
    """Key of the axes of a picture with channels; None for none."""
    if len(width) != 3:
        return None
    if width[2] in (1, 3, 4) and min(width[:2]) >= least:
        return {}
    if width[0] in (1, 3, 4) and min(width[1:]) >= least:
        return {"axes": "chw"}
    return None


def _is_image(cell: Any) -> bool:
    if isinstance(cell, str):
        return False
    try:
        return bytes(cell[:16]).startswith(_IMAGES)
    except (TypeError, ValueError):
        return False


def _some(rows: int) -> list[int]:
    return sorted({0, rows // 2, rows - 1})


def is_one_picture(look: Look) -> bool:
    """Whether an array is a single picture with channels: its rows are no frames."""
    shape = look.facts.shape
    return (
        look.facts.dtype == np.uint8
        and len(shape) == 3
        and shape[2] in (1, 3, 4)
        and min(shape[:2]) >= _ONE_SIDE
    )


def taxel_keys(look: Look) -> dict[str, Any] | None:
    """Keys of a map to read an array as numbers of taxels; None for other values."""
    width = look.width
    if not look.is_numbers or not look.facts.rows or 0 in width or is_one_picture(look):
        return None
    if len(width) == 1 and width[0] > 1:
        return {"taxels": {"form": "flat"}}
    if len(width) == 2:
        return {"taxels": {"form": "points" if width[1] == 3 else "grid"}}
    if len(width) == 3 and width[2] <= 3:
        return {"taxels": {"form": "grid"}}
    if len(width) in (3, 4) and width[0] <= _PADS:
        return {"taxels": {"form": "grid"}, "pads": True}
    return None
