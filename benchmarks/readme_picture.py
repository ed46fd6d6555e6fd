"""Draws the picture of the README: a touch, its embedding, depth and forces.

Run: python benchmarks/readme_picture.py [--out docs/assets/touch.png]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tactileforge_depth.reader import DepthReader

import tactileforge
from tactileforge.contracts import Dataset, Recording
from tactileforge.plugins import build

SENSOR = "gelsight_mini"
Array = NDArray[Any]
INK, GREY = "#1f2430", "#8a93a3"
AXES = {"x": "#d1495b", "y": "#2e8b57", "z": "#2a6fdb"}


def touch() -> Recording:
    """A simulated press and slide of a GelSight Mini."""
    data: Dataset = build(
        "datasets",
        {
            "name": "sim",
            "scenes": 6,
            "val": 1,
            "sensors": [SENSOR],
            "indenters": ["ring_shaped"],
            "motions": "force_trial",
            "size": 240,
            "randomise": "none",
            "seed": 4,
        },
    )
    return max(data.recordings("train"), key=strength)


def strength(recording: Recording) -> float:
    """Largest force of a recording along any axis, N."""
    return float(np.nanmax(np.abs(np.asarray(recording.force))))


def read(recording: Recording) -> tuple[Array, Array, Array, Array, Array]:
    """Frames, times, tokens of the strongest clip, estimated forces, depth of its last frame."""
    model = tactileforge.load("anytouch2.tiny")
    count = len(recording.frames)
    frames, rest = recording.frames.read(range(count)), np.asarray(recording.background())
    step = max(1, round(model.spacing / recording.period))
    ends = np.arange(3 * step, count)
    forces = np.stack(
        [model.force(frames[end - 3 * step : end + 1 : step], rest, SENSOR)[-1] for end in ends]
    )
    top = int(ends[np.argmax(np.asarray(recording.force)[ends, 2])])
    tokens = model.features(frames[top - 3 * step : top + 1 : step], rest, SENSOR, tap="patches")
    depth = np.asarray(DepthReader(SENSOR).read(frames[top], rest).depth)
    shown = np.stack([frames[i] for i in (0, (top + int(ends[0])) // 2, top)])
    return shown, recording.times[ends], np.asarray(tokens), forces, depth


def colours(tokens: Array) -> Array:
    """The three main directions of the last patches (slots, rows, columns, width), as RGB."""
    grid = tokens.shape[1:3]
    rows = tokens[-1].reshape(-1, tokens.shape[-1])
    rows = rows - rows.mean(0)
    main = rows @ np.linalg.svd(rows, full_matrices=False)[2][:3].T
    low, high = np.percentile(main, [2, 98], axis=0)
    image: Array = np.clip((main - low) / (high - low), 0, 1).reshape(*grid, 3)
    return image


def bare(axis: Axes, title: str) -> None:
    """A panel without ticks."""
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_title(title, fontsize=11, color=INK, pad=8)
    for spine in axis.spines.values():
        spine.set_visible(False)


def draw(recording: Recording) -> Figure:
    """Draws the whole picture."""
    shown, times, tokens, forces, depth = read(recording)
    figure: Figure = plt.figure(figsize=(13.0, 3.3), dpi=150)
    grid = figure.add_gridspec(1, 4, width_ratios=[0.5, 1.0, 1.33, 1.5], wspace=0.16)
    left = grid[0].subgridspec(3, 1, hspace=0.06)
    for i, frame in enumerate(shown):
        axis = figure.add_subplot(left[i])
        axis.imshow(frame)
        bare(axis, "touch" if i == 0 else "")
    axis = figure.add_subplot(grid[1])
    axis.imshow(colours(tokens), interpolation="nearest")
    bare(axis, "embedding (PCA of patches)")
    axis = figure.add_subplot(grid[2])
    axis.imshow(depth, cmap="magma")
    bare(axis, f"depth (to {depth.max():.2f} mm)")
    axis = figure.add_subplot(grid[3])
    truth = np.asarray(recording.force)
    for i, (name, colour) in enumerate(AXES.items()):
        axis.plot(recording.times, truth[:, i], color=colour, alpha=0.35, lw=3)
        axis.plot(times, forces[:, i], color=colour, lw=1.4, label=name)
    axis.set_title("force, N (pale: true)", fontsize=11, color=INK, pad=8)
    axis.set_xlabel("time, s", color=GREY)
    axis.set_ylim(-6.6, 6)
    axis.legend(frameon=False, ncols=3, fontsize=9, loc="lower left")
    axis.tick_params(colors=GREY, labelsize=8)
    for side_name in ("top", "right"):
        axis.spines[side_name].set_visible(False)
    return figure


def main() -> None:
    """Draws and saves."""
    parser = argparse.ArgumentParser(description=__doc__)
    folder = Path(__file__).parents[1] / "docs" / "assets"
    parser.add_argument("--out", type=Path, default=folder / "touch.png")
    given = parser.parse_args()
    figure = draw(touch())
    figure.savefig(given.out, bbox_inches="tight", facecolor="white")
    print(given.out)


if __name__ == "__main__":
    main()
