"""Layouts of samples: configuration of the meaning of each part."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from tactileforge.contracts import ACTIONS
from tactileforge.errors import ConfigError, unknown
from tactileforge.plugins import strict
from tactileforge.reading import (
    BackgroundRule,
    ForceKeys,
    Keys,
    OriginKeys,
    StreamKeys,
    as_texts,
    check_origin,
    check_sensor,
    check_stream,
    parse_background,
    without_nulls,
)
from tactileforge_datasets.samples.places import (
    PICTURES,
    TEXTS,
    VIDEOS,
    Place,
    check_kind,
    fields_of,
    kind_of,
    parse_place,
)

#: Placeholder of the number of a frame, in keys of samples and in names of parts.
FRAME = "frame"
#: Placeholders of every sample: its key, the tar without its ending, and the folder of the key.
ALWAYS = ("key", "tar", "folder")


@dataclass(frozen=True, kw_only=True)
class SampleTimes(Keys):
    """Times of frames.

    Attributes:
        values: Place of the times, such as ``json:t``.
        unit: ``s``, ``ms``, ``us`` or ``ns``.
    """

    values: str = field(metadata={"example": "json:t"})
    unit: Literal["s", "ms", "us", "ns"] = "s"


@dataclass(frozen=True, kw_only=True)
class SampleForce(ForceKeys):
    """Forces, x, y and z a frame.

    Attributes:
        values: Place of three values or more, or a list of the places of x, y and z, null for an
            axis that was not measured.
        columns: Columns of x, y and z in one place; null for an axis that was not measured.
    """

    values: str | tuple[str | None, str | None, str | None] = field(
        metadata={"example": "json:force"}
    )
    columns: tuple[int | None, int | None, int | None] = (0, 1, 2)


@dataclass(frozen=True, kw_only=True)
class SampleLayout(StreamKeys, OriginKeys):
    """Keys of a layout of samples.

    A part is the ending of a member's name behind the first dot: ``jpg``, ``touch.png``. A place is
    a part with a value: ``cls``, ``force.npy``, or ``json:contact.force`` for a value in a JSON;
    ``?`` behind it where samples may lack it. A template is text with places and placeholders of
    ``key`` in braces: ``touching a {json:object}``.

    Attributes:
        touch: Part of the touch: a picture, an array ``npy`` of one picture or of a clip, a video,
            or numbered pictures of a clip, ``{frame}.jpg``.
        sensor: Type of the sensor, or a template of it.
        background: ``{file: PART}`` of the sample, ``{first: N}``, ``{last: N}`` or
            ``{median: true}`` of the recording, or ``none``.
        samples: Template of the keys of samples, such as ``{object}/{clip}_{frame}``. With
            ``{frame}`` a sample is a frame of a clip; without, a recording. "" for any key.
        fps: Frames a second of clips without times.
        times: Times of frames; null for those of the video, or even ones.
        camera: Part of the paired camera view, with ``?`` where recordings may lack it; "" for
            none.
        force: Forces; null for none.
        action: An action, a template of it, ``force`` to read it from the forces, or ``none``; null
            for ``force`` where there are forces.
        object: Template of the name of the touched object; "" for none.
        text: Template of the caption, or several, of which those with a value are joined.
        words: Word for each value, by place: ``{cls: {0: mug, 1: pen}}``.
        tracks: Places of further values a frame, by name.
        labels: Templates of further labels, by name.
        hold_out: Template of the unit held out together; "" for the ``{object}`` of the
            key, if it has one, or else the recording.
    """

    touch: str = field(metadata={"example": "jpg"})
    sensor: str = field(metadata={"example": "digit"})
    background: BackgroundRule | str = field(metadata={"example": "{first: 3}, or none"})
    samples: str = ""
    fps: float | None = None
    times: SampleTimes | None = None
    camera: str = ""
    force: SampleForce | None = None
    action: str | None = None
    object: str = ""
    text: str | tuple[str, ...] = ()
    words: dict[Any, dict[Any, Any]] = field(default_factory=dict)
    tracks: dict[str, str] = field(default_factory=dict)
    labels: dict[str, str] = field(default_factory=dict)
    hold_out: str = ""

    @property
    def by_frame(self) -> bool:
        """Whether a sample is a frame of a clip."""
        return FRAME in fields_of(self.samples)

    @property
    def numbered(self) -> bool:
        """Whether a sample has numbered pictures."""
        return FRAME in fields_of(self.touch)

    @property
    def captions(self) -> tuple[str, ...]:
        """Templates of the caption."""
        return as_texts(self.text)

    @property
    def unit(self) -> str:
        """Template of the unit held out together; "" for the recording."""
        return self.hold_out or ("{object}" if "object" in self.placeholders else "")

    @property
    def placeholders(self) -> tuple[str, ...]:
        """Placeholders of the key, and those of every sample."""
        return (*(name for name in fields_of(self.samples) if name != FRAME), *ALWAYS)

    @property
    def numbers(self) -> list[str]:
        """Places of values per frame."""
        force = self.force.values if self.force else ()
        found = [force] if isinstance(force, str) else [one for one in force if one]
        return [*found, *([self.times.values] if self.times else []), *self.tracks.values()]

    @property
    def templates(self) -> dict[str, str]:
        """Templates by the name of their key."""
        return {
            "sensor": self.sensor,
            "object": self.object,
            "action": self.action or "",
            "hold_out": self.hold_out,
            **{f"text {i}": text for i, text in enumerate(self.captions)},
            **{f"labels.{name}": text for name, text in self.labels.items()},
        }

    @property
    def parts(self) -> set[str]:
        """Names of the parts to read."""
        names = {self.camera.removesuffix("?"), *(parse_place(one).part for one in self.numbers)}
        names |= {place.part for text in self.templates.values() for place in self.places(text)}
        if isinstance(self.background, BackgroundRule) and self.background.file:
            names.add(self.background.file)
        names |= set() if self.numbered else {self.touch}
        return {name.lower() for name in names} - {""}

    def places(self, template: str) -> Iterator[Place]:
        """Yields the places of a template, without placeholders of the key."""
        for name in fields_of(template):
            if name not in self.placeholders:
                yield parse_place(name)

    @property
    def provides(self) -> frozenset[str]:
        """Labels of the recordings."""
        there = {
            "force": self.force is not None,
            "action": self.action != "none" and bool(self.force or self.action),
            "object": bool(self.object),
            "text": bool(self.captions),
            "image": bool(self.camera),
        }
        return frozenset(label for label, is_there in there.items() if is_there)


def parse_samples(config: Any) -> SampleLayout:
    """Validates a layout and converts it to its types; reads no file.

    Args:
        config: Plain data; null stands for the default.

    Raises:
        ConfigError: A value is invalid; names the key and the valid values.
    """
    where = "data.layout"
    layout = strict.build(SampleLayout, where, without_nulls(strict.mapping(where, config)))
    check_kind(layout.touch, (*PICTURES, *VIDEOS, "npy"), f"{where}.touch")
    if layout.fps is not None and not 0 < layout.fps < 1e5:
        raise ConfigError(f"{where}.fps is {layout.fps}; give frames per second, e.g. 30")
    is_video = kind_of(layout.touch) in VIDEOS
    if layout.by_frame and (is_video or layout.numbered):
        raise ConfigError(
            f"{where}: {layout.touch} holds a clip, and {{frame}} of samples={layout.samples!r} "
            "says that a sample is a frame; leave one of them out"
        )
    if layout.numbered and (is_video or kind_of(layout.touch) == "npy"):
        raise ConfigError(f"{where}.touch is {layout.touch}: number pictures, {{frame}}.jpg")
    if (layout.by_frame or layout.numbered) and layout.fps is None and layout.times is None:
        raise ConfigError(f"{where}: fps is missing; give frames per second, or times")
    _check_templates(layout, where)
    parse_background(layout.background, f"{where}.background")
    if layout.camera:
        check_kind(layout.camera.removesuffix("?"), (*PICTURES, *VIDEOS, "npy"), f"{where}.camera")
    for place in layout.numbers:
        check_kind(parse_place(place).part, ("npy", *TEXTS), f"{where}: {place}")
    if layout.force:
        newtons(layout.force)
    check_stream(layout, where)
    check_origin(layout, where)
    return layout


def newtons(keys: SampleForce) -> float:
    """Newton of the unit of forces; see `newtons.newtons_of`."""
    places = (keys.values,) * 3 if isinstance(keys.values, str) else keys.values
    names = [place or "" for place in places]
    return keys.newtons(names, "data.layout.force")


def _check_templates(layout: SampleLayout, where: str) -> None:
    names = fields_of(layout.samples)
    for name in names:
        if not re.fullmatch(r"[a-z_]+", name) or names.count(name) > 1 or name in ALWAYS:
            raise ConfigError(
                f"{where}.samples: {{{name}}} must be a word of its own in small letters, once, "
                f"and none of {', '.join(ALWAYS)}"
            )
    for key, template in layout.templates.items():
        for place in layout.places(template):
            if kind_of(place.part) in TEXTS:
                continue
            known = (*layout.placeholders, *TEXTS)
            raise ConfigError(f"{where}.{key}: {unknown('value', place.part, known)}")
    if "{" not in layout.sensor:
        check_sensor(layout.sensor, f"{where}.sensor")
    action = layout.action
    if action == "force" and layout.force is None:
        raise ConfigError(f"{where}.action is force, but force is not given")
    if action and action not in ("force", "none", *ACTIONS) and "{" not in action:
        known = (*ACTIONS, "force", "none", "{json:action}")
        raise ConfigError(f"{where}: {unknown('action', action, known)}")


def words_of(layout: SampleLayout) -> Mapping[str, Mapping[str, str]]:
    """Words by place and value, all as text."""
    return {
        str(place): {str(value): str(word) for value, word in words.items()}
        for place, words in layout.words.items()
    }
