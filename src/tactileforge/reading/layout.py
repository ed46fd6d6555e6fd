"""Layouts: configuration of the conversion from files of a folder to recordings.

`docs/data.md` lists the keys. A value written as ``{column}`` is taken from the labels of the file.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tactileforge.contracts import ACTIONS
from tactileforge.data.frames.lazy import Crop
from tactileforge.data.labels.clock import seconds_of
from tactileforge.errors import ConfigError, unknown
from tactileforge.reading.clock_keys import parse_order, parse_times
from tactileforge.reading.layout_keys import (
    ActionKeys,
    BackgroundRule,
    ClockKeys,
    ColumnKeys,
    ForceKeys,
    FrameTable,
    LayoutKeys,
    TrackKeys,
    TrackRanges,
)
from tactileforge.reading.templates import template_columns
from tactileforge.reading.vocabulary import StreamKeys, check_origin, check_stream
from tactileforge.specs.published import spec
from tactileforge.util.strict import build, mapping

#: What is held out together; ``none`` is all for training, and ``all`` for validation.
UNITS_HELD_OUT = ("trial", "recording", "object", "time", "none", "all")
#: Words for where the clock of a table meets that of the frames, and what else may be given.
STARTS = ("first_row", "contact")
OTHER_STARTS = 'the time of the first frame by that clock, or "{column}" of the labels'

#: A code of checks, or the beginning of one.
_CODE = re.compile(r"[A-Z]{2,4}\d{0,3}")
#: Columns of every file, independent of its labels.
FILE_COLUMNS = ("file", "stem", "prefix", "rest", "folder", "parent", "above")

EXAMPLE = """layouts:
  my_touches:
    videos: "*.mp4"          # or images: "*.png" with each: touch | sequence
    sensor: digit
    background: {first: 3}   # or {file: background.png}, {median: true}, none"""


@dataclass(frozen=True)
class Tile:
    """A crop of the frames with a sensor of its own."""

    box: Crop
    sensor: str


@dataclass(frozen=True)
class ActionRange:
    """Frames ``start..stop - 1`` show an action."""

    start: int
    stop: int
    action: str


@dataclass(frozen=True)
class DatasetLayout:
    """One layout; `docs/data.md` describes the fields."""

    name: str
    path: str
    globs: tuple[str, ...]
    each: str
    singles: bool
    films: Mapping[str, int] | None
    recording: str
    sensor: str | None
    fps: float | None
    times: ClockKeys | str
    order: ClockKeys | str
    stream: StreamKeys
    white: float | None
    every: float
    ignore: tuple[str, ...]
    crops: Mapping[str, Tile]
    background: BackgroundRule | None
    labels: str | None
    key: str
    only: bool
    words: Mapping[str, Mapping[str, str]]
    force: FrameTable | None
    action: str | FrameTable | tuple[ActionRange, ...] | None
    tracks: TrackKeys | tuple[TrackRanges, ...] | None
    object: str | None
    text: tuple[str, ...]
    camera: str | None
    source: str
    licence: str
    tier: int
    hold_out: str
    provides: frozenset[str] = field(default_factory=frozenset)


def parse_layout(name: str, config: Any) -> DatasetLayout:
    """Validates a layout and converts it to its types; reads no file.

    Args:
        name: Name of the layout.
        config: Plain data; null stands for the default.

    Raises:
        ConfigError: A value is invalid; names the layout, the key and the valid values.
    """
    where = f"layout {name!r}"
    keys = build(LayoutKeys, where, without_nulls(mapping(where, config)))
    globs, each = _files(keys, where)
    sensor, crops = _sensors(keys, where)
    force = _force(keys.force, f"{where}: force")
    action = _action(keys, f"{where}: action")
    _check(keys, each, where)
    # labels of the layout: objectives with others are refused before any file is read
    provided = {
        "force": force is not None,
        "action": action is not None,
        "object": keys.object is not None,
        "text": bool(keys.text),
        "image": keys.camera is not None,
    }
    return DatasetLayout(
        name=name,
        path=keys.path,
        globs=globs,
        each=each,
        singles=each == "video" and keys.each == "touch",
        films={"": keys.stream} if isinstance(keys.stream, int) else keys.stream,
        recording=keys.recording or "",
        sensor=sensor,
        fps=keys.fps,
        times=parse_times(keys.times, each, where),
        order=parse_order(keys.order, each, where),
        stream=StreamKeys(channels=keys.channels, rotate=keys.rotate, mirror=keys.mirror),
        white=keys.white,
        every=keys.every,
        ignore=keys.ignore,
        crops=crops,
        background=parse_background(keys.background, f"{where}: background"),
        labels=keys.labels.file,
        key=keys.labels.key,
        only=keys.labels.only,
        words={
            # YAML has ranks as numbers, a CSV as text
            str(column): {str(rank): str(word) for rank, word in words.items()}
            for column, words in keys.words.items()
        },
        force=force,
        action=action,
        tracks=keys.tracks,
        object=keys.object,
        text=as_texts(keys.text),
        camera=keys.camera,
        source=keys.source,
        licence=keys.licence,
        tier=keys.tier,
        hold_out=keys.hold_out,
        provides=frozenset(label for label, is_given in provided.items() if is_given),
    )


def without_nulls(values: Mapping[str, Any]) -> dict[str, Any]:
    """Drops nulls, at any depth of mappings."""
    return {
        key: without_nulls(value) if isinstance(value, Mapping) else value
        for key, value in values.items()
        if value is not None
    }


def as_texts(value: str | Sequence[str]) -> tuple[str, ...]:
    """One or more texts, as several."""
    return (value,) if isinstance(value, str) else tuple(value)


def _check(keys: LayoutKeys, each: str, where: str) -> None:
    """Validates constraints beyond types."""
    if not template_columns(keys.hold_out) and keys.hold_out not in UNITS_HELD_OUT:
        raise ConfigError(f"{where}: {unknown('hold_out', keys.hold_out, UNITS_HELD_OUT)}")
    is_open = each == "sequence" and keys.times is None
    if (is_open and keys.fps is None) or (keys.fps is not None and keys.fps <= 0):
        raise ConfigError(f"{where}: fps is {keys.fps}; give frames per second, e.g. fps: 30")
    if keys.recording and (each != "sequence" or not template_columns(keys.recording)):
        raise ConfigError(
            f"{where}: recording is {keys.recording!r}; give what tells the recordings of one "
            "folder of each: sequence apart: {column} of the labels, or {prefix}"
        )
    if keys.stream is not None:
        numbers = [keys.stream] if isinstance(keys.stream, int) else list(keys.stream.values())
        if each != "video" or not numbers or min(numbers) < 0 or len({*numbers}) < len(numbers):
            raise ConfigError(
                f"{where}: stream is {keys.stream}; give the number of a stream of videos, from 0, "
                "or several by name: {left: 0, right: 1}"
            )
    tables = (keys.force, keys.action, keys.tracks)
    if each == "video" and any(
        getattr(table, "key", None)
        and not (getattr(table, "frame", None) or getattr(table, "times", None))
        for table in tables
    ):
        raise ConfigError(
            f"{where}: key: names images, and these are videos; give frame: or times:"
        )
    check_stream(keys, where)
    check_origin(keys, where)
    if isinstance(keys.tracks, tuple):
        names = [track.name for track in keys.tracks]
        if not names or "" in names or len(set(names)) < len(names):
            raise ConfigError(
                f"{where}: tracks have the names {names}; give each a name of its own"
            )
        for track in keys.tracks:
            if track.margin < 0 or not track.frames:
                raise ConfigError(
                    f"{where}: track {track.name!r} has {len(track.frames)} ranges and margin "
                    f"{track.margin}; give frames: [[first, end], ...] and 0 or more"
                )
    is_thinned = keys.every != 1 or (isinstance(keys.tracks, TrackKeys) and keys.tracks.drop)
    if each == "video" and keys.each == "touch" and is_thinned:
        raise ConfigError(
            f"{where}: each: touch takes each frame of videos; leave out every: and drop:"
        )
    if keys.white is not None and not 255 < keys.white <= 65535:
        raise ConfigError(
            f"{where}: white is {keys.white:g}; give the value of white in pictures of 16 bits: "
            "1023, 4095, 16383 or 65535 (10, 12, 14 or 16 bits)"
        )
    if not 1 <= keys.every < float("inf"):
        raise ConfigError(
            f"{where}: every is {keys.every:g}; give the stored frames for each frame of the "
            "camera, 1 or more: 2 where each was stored twice"
        )
    if odd := [code for code in keys.ignore if not _CODE.fullmatch(code)]:
        raise ConfigError(
            f"{where}: ignore has {odd[0]!r}; give codes of checks, or their beginnings: [TF307]"
        )


def _files(keys: LayoutKeys, where: str) -> tuple[tuple[str, ...], str]:
    if (keys.videos is None) == (keys.images is None):
        raise ConfigError(f'{where}: give one of videos: "*.mp4" and images: "*.png"')
    if keys.videos is not None:
        return as_texts(keys.videos), "video"
    if keys.each is None:
        raise ConfigError(
            f"{where}: each is missing; give each: touch (one image, one touch) or each: sequence "
            "(one folder, one touch)"
        )
    if keys.each not in ("touch", "sequence"):
        raise ConfigError(f"{where}: {unknown('each', keys.each, ('touch', 'sequence'))}")
    return as_texts(keys.images or ()), keys.each


def _sensors(keys: LayoutKeys, where: str) -> tuple[str | None, dict[str, Tile]]:
    crops = {
        name: Tile(crop.box, sensor)
        for name, crop in keys.crops.items()
        if (sensor := crop.sensor or keys.sensor)
    }
    if len(crops) < len(keys.crops) or not (crops or keys.sensor):
        raise ConfigError(f"{where}: sensor is missing; for example sensor: digit")
    for name in {keys.sensor, *(tile.sensor for tile in crops.values())} - {None}:
        if not template_columns(str(name)):
            check_sensor(str(name), f"{where}, key sensor")
    return keys.sensor, crops


def check_sensor(name: str, where: str) -> None:
    """Raises a `ConfigError` for an unknown sensor, with its place in the configuration."""
    try:
        spec(name)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def parse_background(rule: BackgroundRule | str, where: str) -> BackgroundRule | None:
    """Validates a rule; None for ``none``.

    Args:
        rule: The rule, as given.
        where: Name of its key, for errors.

    Raises:
        ConfigError: It is another word, or none or several of the ways.
    """
    if rule == "none":
        return None
    if isinstance(rule, BackgroundRule) and min(rule.first, rule.last) >= 0:
        chosen = sum([rule.first > 0, rule.last > 0, rule.median, rule.frames is not None])
        if rule.frames and not 0 <= rule.frames[0] < rule.frames[1]:
            raise ConfigError(
                f"{where}: frames are {list(rule.frames)}; give the first and the one after the "
                "last: [3, 6]"
            )
        # a file may be a video, of which first or last say the frames; its median is not offered
        if chosen <= 1 and not rule.median if rule.file else chosen == 1:
            return rule
    raise ConfigError(
        f"{where}: {rule} must be one of {{file: background.png}}, {{first: 3}}, {{last: 3}}, "
        "{frames: [3, 6]}, {median: true}, or none"
    )


def _force(keys: ForceKeys | None, where: str) -> FrameTable | None:
    if keys is None:
        return None
    names = list(keys.columns)
    if len(names) != 3:
        raise ConfigError(
            f"{where}: columns are those of x, y and z, not {names}; give null to an axis that was "
            "not measured: [fx, null, fz]"
        )
    columns = [name for name in names if name is not None]
    if not columns or len(set(columns)) < len(columns):
        raise ConfigError(
            f"{where}: columns are {names}; give each axis a column of its own, and null to an "
            "axis that was not measured: [null, null, fz]"
        )
    if keys.frame is not None and keys.times is not None:
        raise ConfigError(f"{where}: give one of frame and times: each says what a row is of")
    times = ColumnKeys(keys.times) if isinstance(keys.times, str) else keys.times
    if times and times.unit is not None:
        seconds_of(times.unit, f"{where}: times")
    if keys.start is not None and times is None:
        raise ConfigError(f"{where}: start is of rows with times; give their column, times:, too")
    start = keys.start if isinstance(keys.start, str) else STARTS[0]
    if start not in STARTS and not template_columns(start):
        raise ConfigError(f"{where}: {unknown('start', start, STARTS)}, {OTHER_STARTS}")
    # YAML reads a header such as 0 as a number; in a CSV it is text
    columns_or_none = tuple("" if name is None else str(name) for name in names)
    newton = keys.newtons(columns_or_none, where)
    return FrameTable(
        keys.file,
        keys.frame,
        columns_or_none,
        # the unit goes into the signs: readers of tables multiply once
        sign=tuple(factor * newton for factor in keys.sign),
        lag_s=keys.lag_s,
        time=None if times is None else times.column,
        key=keys.key,
        unit=None if times is None else times.unit,
        start=keys.start,
        partial=keys.partial,
    )


def _action(keys: LayoutKeys, where: str) -> str | FrameTable | tuple[ActionRange, ...] | None:
    """The origin of actions; ``force`` derives them from the forces."""
    action = keys.action
    if isinstance(action, ActionKeys):
        return FrameTable(action.file, action.frame, (action.column,), key=action.key)
    if isinstance(action, tuple):
        for part in action:
            check_action(part.action, where)
        return tuple(ActionRange(*part.frames, part.action) for part in action)
    if action is None:
        return "force" if keys.force else None
    if action == "none":
        return None
    if action == "force" and not keys.force:
        raise ConfigError(f"{where}: force is not given; add force: {{file: ..., columns: ...}}")
    if action not in ("force", *ACTIONS) and not template_columns(action):
        known = (*ACTIONS, "force", "none", "{column}")
        raise ConfigError(f"{where}: {unknown('action', action, known)}")
    return action


def check_action(name: str, where: str) -> None:
    """Raises a `ConfigError` for an unknown action, with its place in the configuration."""
    if name not in ACTIONS:
        raise ConfigError(f"{where}: {unknown('action', name, ACTIONS)}")
