"""A recording as plain data, without its images, and back (`docs/shards.md`)."""

from __future__ import annotations

import json
import math
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data.frames.image_codecs import PackedFrames
from tactileforge.errors import DataError
from tactileforge.util.untrusted import load_json

#: Version of the layout; readers refuse other versions.
SHARD_VERSION = 3

#: Types of tracks: numbers alone, as numpy would build objects and strings from a foreign file.
_DTYPES = frozenset({"bool", *(f"{kind}{8 * n}" for kind in ("int", "uint") for n in (1, 2, 4, 8))})
_DTYPES |= {"float16", "float32", "float64"}
#: Errors of reading foreign plain data.
WRONG = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)


def describe_recording(recording: Recording) -> dict[str, Any]:
    """Describe a recording without its images as plain data."""
    force = None
    if recording.force is not None:
        rows = _plain(recording.force.astype(float))
        force = [None if row == [None] * 3 else row for row in rows]
    seen = recording.image_times
    return {
        "version": SHARD_VERSION,
        "key": recording.key,
        "sensor": recording.sensor,
        "times": recording.times.tolist(),
        "force": force,
        "action": None if recording.action is None else recording.action.tolist(),
        "object": recording.object,
        "text": recording.text,
        "image_times": None if seen is None else seen.tolist(),
        "labels": {
            name: None if isinstance(x, float) and math.isnan(x) else x
            for name, x in recording.labels.items()
        },
        "tracks": {
            name: {"dtype": values.dtype.name, "values": _plain(values)}
            for name, values in recording.tracks.items()
        },
        "source": recording.source,
        "tier": recording.tier,
        "licence": recording.licence,
    }


def _plain(values: NDArray[Any]) -> list[Any]:
    """Numbers as lists, NaN as None: JSON has no NaN (RFC 8259, section 6)."""
    if values.dtype.kind == "f" and np.isnan(values).any():
        unknown = np.isnan(values)
        values = values.astype(object)
        values[unknown] = None
    out: list[Any] = values.tolist()
    return out


def checksum(about: dict[str, Any]) -> int:
    """Checksum of a description, independent of the order of its keys."""
    return zlib.crc32(json.dumps(about, sort_keys=True).encode())


def parse_description(text: bytes, where: str) -> dict[str, Any]:
    """Parse the description of a recording; checks its version and checksum.

    Args:
        text: Text of the description, JSON.
        where: Name of the text, for messages.

    Raises:
        DataError: The text is damaged, of another version, or no description.
    """
    try:
        about = load_json(text)
        stated = about.pop("crc32")
        version = about["version"]
        actual = checksum(about)
    except WRONG as error:
        raise DataError(f"{where}: no description of a recording ({error!r})") from error
    # before the checksum: of another version, a pack again is the fix, not a download
    if version != SHARD_VERSION:
        raise DataError(
            f"{where}: shard version {version}, but this tactileforge reads {SHARD_VERSION}; pack "
            "the data again"
        )
    if stated != actual:
        raise DataError(
            f"{where}: damaged (its checksum does not match); download or pack it again"
        )
    return dict(about)


def build_recording(about: dict[str, Any], lazy: dict[str, PackedFrames]) -> Recording:
    """Build the recording of a description.

    Args:
        about: Plain data of the form of `describe_recording`, not trusted.
        lazy: Frames of each group of images.

    Raises:
        ValueError: Columns have other lengths than the frames, or a number is out of range; other
            errors of `WRONG` for values of another type.
    """
    times = np.array(about["times"], np.float64)
    if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) < 0).any():
        raise ValueError("times are finite numbers, one per frame, that do not go back")
    force, action = about["force"], _actions(about["action"])
    seen = _views(about["image_times"], lazy.get("image"))
    tracks = {name: _track(track) for name, track in about["tracks"].items()}
    surface = lazy.get("surface")
    own = {"times": times, "force": force, "action": action, "surface": surface}
    # one after the other: in one mapping, a track called "times" would hide the times
    for name, column in (*own.items(), *tracks.items()):
        if column is not None and len(column) != len(lazy["frames"]):
            raise ValueError(f"{len(lazy['frames'])} frames and {len(column)} rows of {name}")
    for name in ("key", "sensor", "source", "licence"):
        if not isinstance(about[name], str):
            raise TypeError(f"{name} is {about[name]!r}, not a string")
    for name in ("object", "text"):
        if not isinstance(about[name], str | None):
            raise TypeError(f"{name} is {about[name]!r}, neither a string nor null")
    # type(), not isinstance: JSON's true is a bool, and so an int
    if type(about["tier"]) is not int or not 1 <= about["tier"] <= 5:
        raise ValueError(f"tier is {about['tier']!r}, not 1 to 5")
    none = [math.nan] * 3
    rows = None if force is None else [none if row is None else row for row in force]
    forces = None if rows is None else np.array(rows, np.float64).reshape(len(rows), 3)
    if forces is not None and (np.abs(forces) > np.finfo(np.float32).max).any():
        raise ValueError("an invalid force")
    return Recording(
        key=about["key"],
        sensor=about["sensor"],
        frames=lazy["frames"],
        times=times,
        no_contact=lazy.get("background"),
        force=None if forces is None else forces.astype(np.float32),
        action=action,
        object=about["object"],
        text=about["text"],
        image=lazy.get("image"),
        image_times=seen,
        surface=surface,
        labels=_labels(about["labels"]),
        tracks=tracks,
        source=about["source"],
        tier=about["tier"],
        licence=about["licence"],
    )


def _track(track: Any) -> NDArray[Any]:
    if track["dtype"] not in _DTYPES:
        raise TypeError(f"a track of {track['dtype']!r}")
    with np.errstate(over="ignore"):  # the check below names the track
        values = np.array(track["values"], track["dtype"])
    if values.dtype.kind == "f" and np.isinf(values).any():
        raise ValueError(f"a track has a number that no {track['dtype']} holds")
    return values


def _actions(rows: Any) -> NDArray[np.int64] | None:
    if rows is None:
        return None
    actions = np.array(rows, np.int64)
    if actions.ndim != 1 or ((actions < -1) | (actions >= len(ACTIONS))).any():
        raise ValueError(f"actions are numbers from -1 to {len(ACTIONS) - 1}, one per frame")
    return actions


def _views(rows: Any, image: PackedFrames | None) -> NDArray[np.float64] | None:
    """Parse the times of camera views."""
    if rows is None:
        return None
    times = np.array(rows, np.float64)
    in_order = times.ndim == 1 and np.isfinite(times).all() and (np.diff(times) >= 0).all()
    if not in_order or len(times) != len(image or ()):
        raise ValueError("image_times are finite numbers, one per view, that do not go back")
    return times


def _labels(labels: Any) -> dict[str, str | float]:
    """Parse labels by name; null is NaN."""
    labels = dict(labels)
    for name, value in labels.items():
        if not isinstance(value, str | int | float | None):
            raise TypeError(f"label {name} is {str(value)[:60]}, neither a word nor a number")
    return {name: math.nan if x is None else x for name, x in labels.items()}
