"""Touch of a guessed map: its arrays and their pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from tactileforge.data import EncodedFrames, is_deep
from tactileforge.errors import DataError, unknown
from tactileforge.reading import (
    DERIVED,
    STILL,
    VIEWS,
    guess_sensor,
    says_scene,
    says_touch,
    scene_among,
    touch_among,
)
from tactileforge_episodes.guessed_arrays import ACTIONS, FORCES, TIMES, FoundArrays, short_names
from tactileforge_episodes.looks import Look, deep_keys, is_one_picture, taxel_keys

#: Attributes that say the order of channels.
_ORDERS = (
    *("color_order", "colour_order", "channel_order", "channels", "color_space", "colorspace"),
    *("color_format", "pixel_format", "image_format", "encoding"),
)


def guess_touch(found: FoundArrays, given: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Entries of touch by key; {} where no array is touch by its name.

    Args:
        found: The arrays.
        given: Keys of touch; () for those whose names say it.

    Raises:
        DataError: A given key is missing, or holds neither pictures nor taxels.
    """
    chosen = [_given(found, key) for key in given] or _named(found)
    if not chosen:
        return {}
    counts = Counter(found.looks[key].facts.rows for key in chosen)
    ((rows, _),) = counts.most_common(1)
    entries: dict[str, dict[str, Any]] = {}
    for key, finger in short_names(chosen).items():
        look = found.looks[key]
        found.used.add(key)
        if look.facts.rows != rows:
            found.doubts.append(f"left out: {look}, where other touch has {rows} rows")
            continue
        entries[key] = {"array": key, "finger": finger} | _shown(found, look)
    if any(not {"taxels", "channels"} & one.keys() for one in entries.values()):
        found.doubts.append("channels: red is taken to be the first (data.channels)")
    return entries


def _given(found: FoundArrays, key: str) -> str:
    plain = key.removeprefix(found.top)
    if plain not in found.looks:
        raise DataError(f"{found.name}: {unknown('key of data.touch', key, found.looks)}")
    if is_deep(found.looks[plain].facts.dtype) and (keys := deep_keys(found, found.looks[plain])):
        found.pictures[plain] = keys
    if plain not in found.pictures and taxel_keys(found.looks[plain]) is None:
        why = "holds no pictures and no taxels"
        if is_one_picture(found.looks[plain]):
            why = "is one picture; save those of a recording as one array (T, H, W, 3), np.stack"
        raise DataError(f"{found.name}: data.touch: {found.looks[plain]} {why}")
    return plain


def _named(found: FoundArrays) -> list[str]:
    """Pictures of touch by their names, or else the only pictures, or numbers of taxels."""
    named = [key for key, look in found.looks.items() if says_touch(look.words)]
    if chosen := touch_among([*found.pictures]):
        return chosen
    if not named and len(found.pictures) == 1:
        (key,) = found.pictures
        if says_scene(found.looks[key].words):
            return []
        found.doubts.append(f"touch: {key} is the only array of pictures, so it is taken for touch")
        return [key]
    beside = TIMES | FORCES | DERIVED | STILL | ACTIONS
    looks = [found.looks[key] for key in named]
    return [one.key for one in looks if not one.has(beside) and taxel_keys(one) is not None]


def _shown(found: FoundArrays, look: Look) -> dict[str, Any]:
    """Keys of how an array of touch is shown."""
    if look.key not in found.pictures:
        return {"sensor": "serial_array", **_drawn(found, look), **_reference(found, look)}
    shape = found.pictures[look.key]
    entry = {"sensor": _sensor(found, look), **shape, **_reference(found, look)}
    if is_deep(look.facts.dtype):
        found.doubts.append(
            f"white: {look.key} has 16 bits, and by its largest values {shape['white']} is white "
            f"({shape['white'].bit_length()} bits)"
        )
    if said := _said_channels(found, look.key):
        entry["channels"] = said
        found.doubts.append(f"channels: {said}, as an attribute of {look.key} says")
    elif "bgr" in look.words:
        entry["channels"] = "bgr"
        found.doubts.append(f"channels: bgr, as the name {look.key} says")
    return entry


def _drawn(found: FoundArrays, look: Look) -> dict[str, Any]:
    """Keys of drawn numbers: the change from the first row, up to its largest."""
    keys = dict(taxel_keys(look) or {})
    values = found.values(look).astype(np.float64)
    change = np.abs(values - values[0])
    most = float(np.nanmax(change)) if np.isfinite(change).any() else 0.0
    span = float(f"{most:.3g}") or 1.0
    keys["taxels"] = {**keys["taxels"], "span": span, "baseline": "first"}
    found.doubts.append(
        f"span: {look.key} is drawn as its change from the first row; {span:g} is full colour"
    )
    return keys


def _said_channels(found: FoundArrays, key: str) -> str:
    """Order of channels by an attribute of an array, or of its group; "" for none."""
    for place in (found.top + key, found.group, ""):
        for name in _ORDERS:
            said = str(found.attribute(place, name)).lower().removesuffix("8")
            if said in ("rgb", "bgr"):
                return said
    return ""


def _sensor(found: FoundArrays, look: Look) -> str:
    """Type of the sensor by the words of the array, of its file, or by the shape of pictures."""
    shape = _size(found, look)
    for words in (look.key, "/".join([*found.name.split("/")[-2:], look.key])):
        doubts: list[str] = []
        sensor = guess_sensor(words, lambda: shape, doubts)
        if not doubts:
            break
    found.doubts += [f"{line} ({look.key})" for line in doubts]
    return str(sensor["sensor"])


def _size(found: FoundArrays, look: Look) -> tuple[int, int]:
    """Height and width of pictures."""
    keys = found.pictures[look.key]
    sizes = look.width[1:] if keys.get("pads") else look.width
    if len(sizes) < 2:  # encoded images
        raw = bytes(found.array(look.key).rows([0])[0])
        return EncodedFrames(f"{found.name}: {look.key}", [raw]).shape
    height, width = sizes[1:] if keys.get("axes") == "chw" else sizes[:2]
    return height, width


def _reference(found: FoundArrays, look: Look) -> dict[str, Any]:
    """Key of the picture without contact with the words of a touch."""
    own = {*look.words} - VIEWS
    for key, other in found.looks.items():
        fits = other.facts.shape in (look.width, (1, *look.width)) and len(look.width) == 3
        if fits and other.has(STILL) and {*other.words} - VIEWS - STILL <= own:
            found.used.add(key)
            found.doubts.append(f"reference: {key} is {look.key} without contact")
            return {"reference": key}
    return {}


def guess_camera(found: FoundArrays, rows: int) -> dict[str, Any]:
    """Key of the view of the scene; {} for none.

    Args:
        found: The arrays.
        rows: Rows of touch.
    """
    views = [
        key
        for key, shape in found.pictures.items()
        if key not in found.used and found.looks[key].facts.rows == rows and not shape.get("pads")
    ]
    if not (best := scene_among(views)):
        return {}
    found.used.add(best)
    found.doubts.append(f"camera: {best} is the view of the scene")
    return {"camera": {"array": f"{best}?", **found.pictures[best]}}
