"""Layouts: how the files of a folder become recordings, as configuration.

`docs/data.md` lists the keys. A value written as ``{column}`` is taken from the labels of the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from string import Formatter
from typing import Any

from tactileforge.contracts import ACTIONS
from tactileforge.data.frames.lazy import Crop
from tactileforge.errors import ConfigError, unknown
from tactileforge.node import Node
from tactileforge.sensors.specs import spec

SPLITS = ("recording", "object", "time", "train", "val")

#: Columns that every file has, whatever its labels.
FILE_COLUMNS = ("file", "stem", "folder")

EXAMPLE = """layouts:
  my_touches:
    videos: "*.mp4"          # or images: "*.png" with each: touch | sequence
    sensor: digit
    background: {first: 3}   # or {file: background.png}, {median: true}, none"""


@dataclass(frozen=True)
class Tile:
    """A part of the frames that is a sensor of its own."""

    box: Crop
    sensor: str


@dataclass(frozen=True)
class BackgroundRule:
    """Frames without contact: those of a file, or some of the recording.

    Attributes:
        file: An image, or a video of which ``first`` or ``last`` says which frames.
        first: The first frames.
        last: The last frames.
        median: Frames spread evenly over the recording, whose median leaves the contact out.
    """

    file: str | None
    first: int
    last: int
    median: bool


@dataclass(frozen=True)
class FrameTable:
    """A CSV of values per frame.

    Attributes:
        file: Path from the layout's folder.
        frame: Column of the frame number; None: row ``i`` is frame ``i``.
        columns: Columns of the values; "" for one that there is not.
        sign: What each value is multiplied by.
        lag_s: Seconds by which the images lag the values.
    """

    file: str
    frame: str | None
    columns: tuple[str, ...]
    sign: tuple[float, ...] = (1.0, 1.0, 1.0)
    lag_s: float = 0.0


@dataclass(frozen=True)
class ActionRange:
    """Frames ``start..stop - 1`` show an action."""

    start: int
    stop: int
    action: str


@dataclass(frozen=True)
class DatasetLayout:
    """One layout; see `docs/data.md` for what the fields mean."""

    name: str
    path: str
    globs: tuple[str, ...]
    each: str
    sensor: str | None
    fps: float | None
    crops: Mapping[str, Tile]
    background: BackgroundRule | None
    labels: str | None
    key: str
    words: Mapping[str, Mapping[str, str]]
    force: FrameTable | None
    action: str | FrameTable | tuple[ActionRange, ...] | None
    object: str | None
    text: tuple[str, ...]
    image: str | None
    source: str
    licence: str
    tier: int
    split: str
    provides: frozenset[str] = field(default_factory=frozenset)


def parse_layout(name: str, config: Any) -> DatasetLayout:
    """Checks a layout and gives it types; reads nothing.

    Args:
        name: Its name.
        config: Plain data.

    Raises:
        ConfigError: Names the layout, the key and what belongs there.
    """
    node = Node(config, f"layout {name!r}")
    globs, each = _files(node)
    sensor, crops = _sensors(node)
    labels = Node(node.take("labels", dict, {}), f"{node.where}, labels")
    force = _force(node)
    action = _action(node, force is not None)
    split = node.take("split", str, "recording")
    if not template_columns(split) and split not in SPLITS:
        raise ConfigError(f"{node.where}: {unknown('split', split, SPLITS)}")
    fps = node.take("fps", (int, float))
    if (each == "sequence" and fps is None) or (fps is not None and fps <= 0):
        raise ConfigError(f"{node.where}: fps is {fps}; give frames per second, e.g. fps: 30")
    text = node.take("text", (str, list), [])
    layout = DatasetLayout(
        name=name,
        path=node.take("path", str, "."),
        globs=globs,
        each=each,
        sensor=sensor,
        fps=fps,
        crops=crops,
        background=_background(node),
        labels=labels.take("file", str),
        key=labels.take("key", str, "file"),
        words=_words(node),
        force=force,
        action=action,
        object=node.take("object", str),
        text=(text,) if isinstance(text, str) else tuple(map(str, text)),
        image=node.take("image", str),
        source=node.take("source", str, ""),
        licence=node.take("licence", str, ""),
        tier=node.take("tier", int, 5),
        split=split,
        provides=frozenset(
            key
            for key, value in {
                "force": force is not None,
                "action": action is not None,
                "object": node.has("object"),
                "text": bool(text),
                "image": node.has("image"),
            }.items()
            if value
        ),
    )
    labels.close()
    node.close()
    if not 1 <= layout.tier <= 5:
        raise ConfigError(f"{node.where}: tier is {layout.tier}, but must be 1 to 5")
    return layout


def template_columns(template: str) -> list[str]:
    """The columns that a template takes values from.

    Raises:
        ConfigError: A brace is not closed.
    """
    try:
        return [name for _, name, _, _ in Formatter().parse(template) if name is not None]
    except ValueError as error:
        raise ConfigError(f"template {template!r}: {error}; write {{column}}") from error


def _files(node: Node) -> tuple[tuple[str, ...], str]:
    if node.has("videos") == node.has("images"):
        raise ConfigError(f'{node.where}: give one of videos: "*.mp4" and images: "*.png"')
    if node.has("videos"):
        return _patterns(node, "videos"), "video"
    each = node.need("each", str, "touch (one image, one touch) or sequence (one folder, one)")
    if each not in ("touch", "sequence"):
        raise ConfigError(f"{node.where}: {unknown('each', each, ('touch', 'sequence'))}")
    return _patterns(node, "images"), str(each)


def _patterns(node: Node, key: str) -> tuple[str, ...]:
    patterns = node.take(key, (str, list))
    return (patterns,) if isinstance(patterns, str) else tuple(map(str, patterns))


def _sensors(node: Node) -> tuple[str | None, dict[str, Tile]]:
    crops = {}
    sensor = node.take("sensor", str)
    for name, value in node.take("crops", dict, {}).items():
        tile = Node(value, f"{node.where}, crops.{name}")
        left, top, width, height = (int(v) for v in tile.numbers("box", 4))
        tile_sensor = tile.take("sensor", str, sensor) or tile.need("sensor", str, "digit")
        crops[str(name)] = Tile((left, top, width, height), tile_sensor)
        tile.close()
    if not crops:
        sensor = node.need("sensor", str, "digit")
    for name in {sensor, *(tile.sensor for tile in crops.values())} - {None}:
        if not template_columns(str(name)):
            check_sensor(str(name), f"{node.where}, key sensor")
    return sensor, crops


def check_sensor(name: str, where: str) -> None:
    """Raises a `ConfigError` that says where an unknown sensor was named."""
    try:
        spec(name)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _background(node: Node) -> BackgroundRule | None:
    value = node.need("background", (dict, str), "{first: 3}, {file: f.png} or none")
    if value == "none":
        return None
    inner = Node(value, f"{node.where}, background")
    rule = BackgroundRule(
        inner.take("file", str),
        inner.take("first", int, 0),
        inner.take("last", int, 0),
        inner.take("median", bool, False),
    )
    inner.close()
    chosen = sum([rule.first > 0, rule.last > 0, rule.median])
    allowed = chosen <= 1 and not rule.median if rule.file else chosen == 1
    if not allowed or min(rule.first, rule.last) < 0:
        raise ConfigError(
            f"{inner.where}: {dict(value)} must be one of {{file: background.png}}, {{first: 3}}, "
            "{last: 3}, {median: true}, or none"
        )
    return rule


def _words(node: Node) -> dict[str, dict[str, str]]:
    return {
        str(column): {str(rank): str(word) for rank, word in words.items()}
        for column, words in node.take("words", dict, {}).items()
    }


def _force(node: Node) -> FrameTable | None:
    if not node.has("force"):
        return None
    inner = Node(node.take("force", dict), f"{node.where}, force")
    names = inner.need("columns", list, "[fx, fy, fz]")
    if len(names) != 3:
        raise ConfigError(f"{inner.where}: columns are those of x, y and z, not {names}")
    columns = [name for name in names if name is not None]
    if not columns or len(set(columns)) < len(columns):
        raise ConfigError(
            f"{inner.where}: columns are {names}; give each axis a column of its own, and null to "
            "an axis that was not measured: [null, null, fz]"
        )
    table = FrameTable(
        file=inner.need("file", str, '"{stem}.csv"'),
        frame=inner.take("frame", str),
        columns=tuple("" if name is None else str(name) for name in names),
        sign=tuple(inner.numbers("sign", 3, [1, 1, 1])),
        lag_s=float(inner.take("lag_s", (int, float), 0)),
    )
    inner.close()
    return table


def _action(node: Node, has_force: bool) -> str | FrameTable | tuple[ActionRange, ...] | None:
    """Reads the origin of actions; ``force`` stands for the forces themselves."""
    value = node.take("action", (str, dict, list), "force" if has_force else "none")
    where = f"{node.where}, action"
    if isinstance(value, list):
        return tuple(_range(item, where) for item in value)
    if isinstance(value, Mapping):
        inner = Node(value, where)
        table = FrameTable(
            file=inner.need("file", str, '"{stem}.csv"'),
            frame=inner.take("frame", str),
            columns=(inner.need("column", str, "action"),),
        )
        inner.close()
        return table
    if value == "none":
        return None
    if value == "force" and not has_force:
        raise ConfigError(f"{where}: force is not given; add force: {{file: ..., columns: ...}}")
    if value != "force" and not template_columns(value):
        check_action(value, where)
    return str(value)


def _range(item: Any, where: str) -> ActionRange:
    node = Node(item, where)
    start, stop = node.numbers("frames", 2)
    action = node.need("action", str, "press")
    node.close()
    check_action(action, where)
    return ActionRange(int(start), int(stop), action)


def check_action(name: str, where: str) -> None:
    """Raises a `ConfigError` that says where an unknown action was named."""
    if name not in ACTIONS:
        raise ConfigError(f"{where}: {unknown('action', name, ACTIONS)}")
