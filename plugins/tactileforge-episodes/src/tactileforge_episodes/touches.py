"""Touch in an episode file: the arrays, pads and parts of each sensor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactileforge.errors import DataError
from tactileforge_episodes.map_keys import EpisodeMap, PartKeys, TaxelKeys, TouchKeys
from tactileforge_episodes.names import fill, placeholders
from tactileforge_episodes.refs import ArrayRef
from tactileforge_episodes.shown import is_encoded
from tactileforge_episodes.values import EpisodeArrays


@dataclass(frozen=True)
class Touch:
    """One sensor of an episode file.

    Attributes:
        entry: Number of its entry in the map.
        keys: That entry.
        ref: Its array.
        finger: Its name, unique in the file.
        values: Values of the placeholders.
        pad: Index along the second axis; None where there is none.
        part: First column or value, and the one after the last; None for all.
        taxels: How its numbers are drawn; None for pictures.
    """

    entry: int
    keys: TouchKeys
    ref: ArrayRef
    finger: str
    values: Mapping[str, str]
    pad: int | None = None
    part: tuple[int, int] | None = None
    taxels: TaxelKeys | None = None


def find_touches(
    arrays: EpisodeArrays, keys: EpisodeMap, names: Mapping[str, str], draw: str | None
) -> list[Touch]:
    """Finds the sensors of an episode file.

    Args:
        arrays: Arrays of the file.
        keys: The map.
        names: Values of the placeholders of its path.
        draw: Which numbers are touch, ``none``, ``grids`` or ``all``; None for what the map says.

    Raises:
        DataError: There is none, or two have one name.
    """
    found: list[Touch] = []
    vectors: list[str] = []
    for number, entry in enumerate(keys.touch):
        for key, values in arrays.match(entry.array, names):
            ref = arrays.ref(key)
            taxels = _taxels(ref, entry, draw or entry.draw)
            if isinstance(taxels, str):
                vectors.append(key)
                continue
            base = Touch(number, entry, ref, "", values, taxels=taxels)
            found += _parts(base)
    if not found and vectors:
        raise DataError(
            f"{arrays.place}: no pictures and no grids of taxels; to draw {', '.join(vectors)} in "
            "the order of the file, give data.draw=all"
        )
    if not found:
        raise arrays.missing(keys.touch[0].array, names)
    fingers = [touch.finger for touch in found]
    if twice := sorted({name for name in fingers if fingers.count(name) > 1}):
        raise DataError(
            f"{arrays.place}: two arrays of touch are called {twice[0]!r}; give `finger` a "
            "placeholder of their keys"
        )
    return found


def _taxels(ref: ArrayRef, entry: TouchKeys, draw: str) -> TaxelKeys | str | None:
    """How an array is drawn; None for pictures, ``vector`` for numbers that are not drawn."""
    axes = len(ref.facts.shape) - 1 - entry.pads
    if entry.taxels is None or (ref.facts.dtype == np.uint8 and axes == 3) or is_encoded(ref):
        return None
    if draw == "none":
        return "vector"
    if entry.taxels.form != "grid" or axes >= 2:
        return entry.taxels
    return replace(entry.taxels, form="flat", size=1) if draw == "all" else "vector"


def _parts(touch: Touch) -> Iterator[Touch]:
    """Pads and parts of an array, a sensor each."""
    shape, entry = touch.ref.facts.shape, touch.keys
    if entry.pads and len(shape) < 3:
        raise DataError(f"{touch.ref}: {shape} has no axis of pads; correct `pads` in the map")
    pads: Sequence[int | None] = range(shape[1]) if entry.pads else (None,)
    for pad in pads:
        for part, columns in _columns(touch, shape):
            values = {**touch.values, "pad": "" if pad is None else str(pad), "part": part}
            name = entry.finger or touch.ref.key.rpartition("/")[2]
            if pad is not None and len(pads) > 1 and "pad" not in placeholders(name):
                name += "_{pad}"
            if part and "part" not in placeholders(name):
                name += "_{part}"
            yield replace(touch, finger=fill(name, values), values=values, pad=pad, part=columns)


def _columns(touch: Touch, shape: Sequence[int]) -> Iterator[tuple[str, tuple[int, int] | None]]:
    parts = touch.keys.parts
    if parts is None:
        yield "", None
    elif isinstance(parts, PartKeys):
        yield from _attributes(touch, parts, shape[-1])
    else:
        axis = 2 + (touch.pad is not None)
        for name, (start, stop) in parts.items():
            if len(shape) <= axis or stop > shape[axis]:
                raise DataError(
                    f"{touch.ref}: {tuple(shape)} has no columns {start} to {stop - 1} (part "
                    f"{name!r}); correct `parts` in the map"
                )
            yield name, (start, stop)


def _attributes(touch: Touch, parts: PartKeys, size: int) -> Iterator[tuple[str, tuple[int, int]]]:
    names, lengths = (touch.ref.attribute(name) for name in (parts.names, parts.lengths))
    try:
        words = [one.decode() if isinstance(one, bytes) else str(one) for one in names]
        ends = np.cumsum([int(one) for one in lengths]).tolist()
    except (TypeError, ValueError, UnicodeDecodeError):
        words, ends = [], []
    values = touch.taxels.size if touch.taxels else 1
    whole = all(int(end) % values == 0 for end in ends)
    if not words or len(words) != len(ends) or ends[-1] != size or not whole:
        raise DataError(
            f"{touch.ref}: attributes {parts.names} and {parts.lengths} ({names}, {lengths}) do "
            f"not divide {size} values into parts of {values} a taxel; correct the file"
        )
    for word, start, stop in zip(words, [0, *ends], ends, strict=False):
        yield word, (start, stop)
