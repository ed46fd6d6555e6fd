"""Simulated touches of the gallery, and panels to draw them."""

from __future__ import annotations

import os
import tempfile
from functools import cache
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from tactileforge.contracts import Dataset, Recording
from tactileforge.plugins import build
from tactileforge.specs import SIMULATED

Array = NDArray[Any]
INK, GREY = "#1f2430", "#8a93a3"
AXES = {"x": "#d1495b", "y": "#2e8b57", "z": "#2a6fdb"}
#: Rows of a picture; the tests take fewer.
SIZE = int(os.environ.get("GALLERY_SIZE", "160"))


@cache
def simulated(indenter: str = "pentagram", motions: str = "force_trial") -> dict[str, Recording]:
    """One touch on every simulated type of sensor, by type."""
    options = {
        "name": "sim",
        "scenes": 1,
        "val": 0,
        "sensors": list(SIMULATED),
        "indenters": [indenter],
        "motions": motions,
        "size": SIZE,
        "randomise": "none",
        "seed": 4,
        "processes": 1,
        "cache": tempfile.mkdtemp(),
    }
    dataset: Dataset = build("datasets", options)
    return {recording.sensor: recording for recording in dataset.recordings("train")}


@cache
def taxels() -> Recording:
    """One press on an array of 8 x 8 taxels, one pixel a taxel."""
    options = {
        "name": "sim_array",
        "scenes": 1,
        "val": 0,
        "size": None,
        "indenters": ["ring_shaped"],
        "motions": "force_trial",
        "force": [7.0, 8.0],
        "span": 0.3,
        "processes": 1,
        "cache": tempfile.mkdtemp(),
    }
    dataset: Dataset = build("datasets", options)
    return next(iter(dataset.recordings("train")))


def strongest(recording: Recording, axis: int | None = None) -> int:
    """Number of the frame with the largest force along an axis, or in all."""
    force = np.asarray(recording.force)
    return int(np.argmax(np.linalg.norm(force, axis=1) if axis is None else np.abs(force[:, axis])))


def moments(recording: Recording, count: int) -> list[int]:
    """Numbers of frames from the first to the strongest."""
    top = strongest(recording)
    return [round(row) for row in np.linspace(0, top, count)]


def read(recording: Recording, rows: list[int]) -> Array:
    """Frames of a recording, uint8 (T, H, W, 3)."""
    return np.asarray(recording.frames.read(rows))


def contrast(frames: Array, rest: Array, gain: float = 3.0) -> Array:
    """Amplified change from a frame without contact around grey, uint8."""
    change = frames.astype(np.float32) - rest.astype(np.float32)
    return np.asarray((128 + gain * change).clip(0, 255), np.uint8)


def canvas(columns: int, rows: int = 1, *, side: float = 1.55) -> tuple[Figure, Array]:
    """A figure of panels, and its axes (rows, columns)."""
    figure = Figure(figsize=(side * columns, side * rows * 1.12), dpi=150, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def show(axis: Axes, pixels: Array, title: str = "", **options: Any) -> None:
    """A picture without ticks."""
    axis.imshow(pixels, **options)
    axis.set_title(title, fontsize=8, color=INK, pad=3)
    axis.set_axis_off()


def curves(axis: Axes, times: Array, values: Array, title: str, names: list[str]) -> None:
    """Curves (T, n) over time, in s."""
    colours = [*AXES.values(), "#8e6c8a", "#c08a2d", "#4c8c96", GREY]
    for column, name in enumerate(names):
        axis.plot(times, values[:, column], color=colours[column], lw=1.3, label=name)
    axis.set_title(title, fontsize=8, color=INK, pad=3)
    axis.tick_params(labelsize=6, colors=GREY)
    if names[0]:
        axis.legend(fontsize=6, frameon=False, ncols=3)
    for edge in ("top", "right"):
        axis.spines[edge].set_visible(False)


def picture(figure: Figure) -> Image.Image:
    """The pixels of a figure, without its white margins above and below."""
    drawn = FigureCanvasAgg(figure)
    drawn.draw()
    pixels = np.asarray(drawn.buffer_rgba())[..., :3]
    inked = np.flatnonzero((pixels < 250).any((1, 2)))
    return Image.fromarray(pixels[max(0, inked[0] - 6) : inked[-1] + 7])
