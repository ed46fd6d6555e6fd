"""Cards of data readers: the sensors and columns of each, drawn from simulated touch."""

from __future__ import annotations

import re
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from gallery.entry import Entry
from gallery.touches import AXES, GREY, INK, moments, picture, read, simulated, taxels
from tactileforge.contracts import ACTIONS, Recording
from tactileforge.plugins import registry

#: Columns in the order of the card.
COLUMNS = ("image", "object", "text", "action", "force", "surface", "action_chunk")
#: Readers without fixed sensors: first line, sensors on the card, columns, pages.
GENERAL: dict[str, tuple[str, tuple[str, ...], tuple[str, ...], str]] = {
    "recordings": (
        "Your videos, images and CSV files, described by a few lines of YAML.",
        ("digit", "gelsight_mini"),
        ("object", "force", "image"),
        "[Your recordings](data.md)",
    ),
    "shards": (
        "Packed touch in tar files, local or streamed.",
        ("digit", "gelsight_mini"),
        ("image", "object", "text", "action", "force", "surface"),
        "[Shards](shards.md) · [packing](packing.md)",
    ),
    "webdataset": (
        "Tars of samples by other programs, read where they lie.",
        ("digit",),
        ("object", "text", "action", "force"),
        "[Tars of samples](data.md#tars-of-samples)",
    ),
    "image_tables": (
        "Tables with images in their cells: parquet, and folders of `save_to_disk`.",
        ("digit",),
        ("image", "object", "text", "force"),
        "[Tables with images](datasets.md#tables-with-images)",
    ),
    "rosbags": (
        "ROS 1 and ROS 2 bags: pictures, wrenches and joints by topic (`tactileforge-rosbags`).",
        ("digit",),
        ("image", "force"),
        "[ROS bags](data.md#ros-bags)",
    ),
    "mixture": (
        "Several data sets as one; every batch holds a fixed share of each.",
        ("digit", "gelsight", "gelsight_mini"),
        ("image", "object", "text", "action", "force"),
        "[Shards and mixtures](shards.md)",
    ),
    "sim": (
        "Touches simulated on first use, with exact forces.",
        ("gelsight", "digit", "gelsight_mini"),
        ("image", "object", "text", "action", "force", "surface"),
        "[Simulated touch](simulator.md)",
    ),
    "sim_array": (
        "The touches of `sim`, measured by arrays of taxels (`tactileforge-arrays`).",
        ("serial_array",),
        ("image", "object", "text", "action", "force"),
        "[Simulated touch](simulator.md)",
    ),
    "lerobot": (
        "Any LeRobot data set of version 2.0, 2.1 or 3 (`tactileforge-lerobot`).",
        ("digit",),
        ("image", "text", "action_chunk"),
        "[LeRobot](lerobot.md)",
    ),
    "episodes": (
        "Episodes in zarr, HDF5 and npz: twelve formats of other labs (`tactileforge-episodes`).",
        ("gelsight_mini",),
        ("image", "text", "force"),
        "[Zarr, HDF5 and npz](data.md#arrays)",
    ),
    "demonstrations": (
        "Episodes of a task, for policies (`tactileforge-policies`).",
        ("digit", "digit"),
        ("image", "text", "force", "action_chunk"),
        "[Policies](policies.md)",
    ),
}
#: Heights of the lines that are not words, in heights of a row of frames.
_TALL = {"force": 0.9, "image": 0.9, "surface": 0.9}
#: Code in a docstring, which Markdown has between single ticks.
_LINKS = re.compile(r"`{2}([^`]+)`{2}")


def touch_of(sensor: str) -> Recording:
    """A simulated touch in place of a sensor's."""
    return taxels() if sensor == "serial_array" else simulated()[sensor]


def draw_reader(sensors: tuple[str, ...], columns: tuple[str, ...]) -> Image.Image:
    """Frames of up to three sensors, and a line for each column."""
    shown, lines = sensors[:3], [name for name in COLUMNS if name in columns]
    tall = [1.0] * len(shown) + [_TALL.get(name, 0.3) for name in lines]
    figure = Figure(figsize=(6.4, 0.95 * sum(tall) + 0.1), dpi=130)
    grid = figure.add_gridspec(
        len(tall), 1, height_ratios=tall, left=0.17, right=0.99, top=0.99, bottom=0.02, hspace=0.12
    )
    recording = touch_of(shown[0])
    for row, sensor in enumerate(shown):
        axis = figure.add_subplot(grid[row])
        frames = read(touch_of(sensor), moments(touch_of(sensor), 8))
        frames = frames[:, :, : frames.shape[1] * 4 // 3]
        axis.imshow(np.concatenate(list(frames), 1), aspect="auto", interpolation="nearest")
        _bare(axis, sensor)
    for row, name in enumerate(lines, len(shown)):
        axis = figure.add_subplot(grid[row])
        _column(axis, name, recording)
        _bare(axis, name)
    return picture(figure)


def _bare(axis: Axes, label: str) -> None:
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_ylabel(label, rotation=0, ha="right", va="center", fontsize=8, color=INK)
    for spine in axis.spines.values():
        spine.set_visible(False)


def _column(axis: Axes, name: str, recording: Recording) -> None:
    """A line of the card: curves, spans or words."""
    films = {"image": recording.image, "surface": recording.surface}
    if (film := films.get(name)) is not None:
        rows = np.linspace(0, len(film) - 1, 8).round().astype(int).tolist()
        axis.imshow(np.concatenate(list(film.read(rows)), 1), aspect="auto")
        return
    axis.set_xlim(0, 1)
    if name == "force":
        force = np.asarray(recording.force)
        for column, colour in enumerate(AXES.values()):
            axis.plot(np.linspace(0, 1, len(force)), force[:, column], color=colour, lw=1.2)
        return
    axis.set_ylim(0, 1)
    if name == "action":
        spans = np.asarray(recording.action)
        edges = [0, *(np.flatnonzero(np.diff(spans)) + 1).tolist(), len(spans)]
        for start, stop in pairwise(edges):
            left, right = start / len(spans), stop / len(spans)
            axis.axvspan(left, right, color=f"C{int(spans[start]) % 10}", alpha=0.3, lw=0)
            if right - left > 0.07:
                word = ACTIONS[int(spans[start])]
                axis.text((left + right) / 2, 0.5, word, fontsize=6, ha="center", va="center")
        return
    words = {
        "object": "name or class of the object",
        "text": "caption",
        "action_chunk": "state and commands of the robot",
    }
    axis.text(0, 0.5, words[name], fontsize=7.5, color=GREY, va="center")


def published_entry(name: str) -> Entry:
    """Card of a reader of published data, from its class."""
    reader: Any = registry.get("datasets", name)
    first = re.split(r"(?<=[.;]) |\n\n", reader.__doc__.replace("\n    ", " "))[0]
    columns = tuple(sorted(reader.provides))
    sensors: tuple[str, ...] = tuple(reader.sensors)
    return _reader(
        name,
        _LINKS.sub(r"`\1`", first.strip()).rstrip(";.") + ".",
        sensors,
        columns,
        f"[Source]({reader.url}) · [{reader.citation.partition(',')[0]}](datasets.md)",
    )


def _reader(
    name: str, first: str, sensors: tuple[str, ...], columns: tuple[str, ...], links: str
) -> Entry:
    gives = ", ".join(columns)
    return Entry(
        kind="reader",
        name=name,
        lines=(first, f"Sensors: {', '.join(dict.fromkeys(sensors))}. Gives: {gives}.", links),
        alt=f"Schematic of {name}",
        draw=partial(draw_reader, sensors, columns),
    )


def entries() -> list[Entry]:
    """Cards of all readers, those for your own data first."""
    general = [_reader(name, *facts) for name, facts in GENERAL.items()]
    published = sorted(set(registry.names("datasets")) - set(GENERAL))
    return [*general, *(published_entry(name) for name in published if _is_ours(name))]


def _is_ours(name: str) -> bool:
    """Whether a reader belongs to this repository."""
    return registry.get("datasets", name).__module__.startswith("tactileforge")
