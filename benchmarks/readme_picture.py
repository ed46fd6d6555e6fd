"""Draws the picture of the README: a touch, the displacement of its gel, and its forces in shape.

Run: python benchmarks/readme_picture.py [--out docs/assets/touch.png]
"""

from __future__ import annotations

import argparse
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import tactileforge

Array = NDArray[Any]
INK, GREY = "#1f2430", "#8a93a3"
AXES = {"x": "#d1495b", "y": "#2e8b57", "z": "#2a6fdb"}
#: Columns of arrows of the shear.
_ARROWS = 12


def bare(axis: Axes, title: str) -> None:
    """A panel without ticks."""
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_title(title, fontsize=10, color=INK, pad=6)
    for spine in axis.spines.values():
        spine.set_visible(False)


def read(touch: Any) -> tuple[Array, Array, Array]:
    """Forces (n, 3) of the last frames of all clips, their numbers, and the last displacement."""
    model = tactileforge.load("anytouch2.tiny")
    frames, rest = touch.frames.read(range(len(touch.frames))), np.asarray(touch.background())
    ends = np.arange(3, len(frames))
    # in newtons, as shear has one scale below; shown in shape, shear and normal by their largest
    read_force = partial(model.force, background=rest, unit="uncalibrated")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        clips = (frames[end - 3 : end + 1] for end in ends)
        forces = np.stack([read_force(clip, sensor=touch.sensor)[-1] for clip in clips])
    top = int(np.argmax(np.linalg.norm(np.asarray(touch.force), axis=1)))
    surface = np.asarray(model.surface(frames[top - 3 : top + 1], rest, touch.sensor))[-1]
    return forces, ends, surface


def draw(touch: Any) -> Figure:
    """Draws the whole picture."""
    forces, ends, surface = read(touch)
    truth = np.asarray(touch.force)
    top = int(np.argmax(np.linalg.norm(truth, axis=1)))
    frame = touch.frames.read([top])[0]
    height, width = frame.shape[:2]
    figure: Figure = plt.figure(figsize=(12.0, 3.0), dpi=150, layout="constrained")
    grid = figure.add_gridspec(1, 3, width_ratios=[1.0, 1.0, 1.25])
    axis = figure.add_subplot(grid[0])
    axis.imshow(frame)
    bare(axis, "touch of a GelSight Mini (simulated)")
    axis = figure.add_subplot(grid[1])
    depth = cv2.resize(surface[2], (width, height), interpolation=cv2.INTER_CUBIC)
    axis.imshow(depth, cmap="magma", vmin=np.percentile(depth, 5))
    rows, columns = (np.linspace(0, 31, _ARROWS).round().astype(int) for _ in range(2))
    x, y = np.meshgrid((columns + 0.5) * width / 32, (rows + 0.5) * height / 32)
    shear = surface[:2][:, rows][:, :, columns]
    axis.quiver(x, y, shear[0], shear[1], color="white", angles="xy", width=0.004)
    bare(axis, "what the model reads: depth and shear of the gel")
    axis = figure.add_subplot(grid[2])
    for i, (name, color) in enumerate(AXES.items()):
        same = slice(2, 3) if name == "z" else slice(0, 2)  # shear has one scale
        scale = np.abs(truth[:, same]).max(), np.abs(forces[:, same]).max()
        axis.plot(touch.times, truth[:, i] / scale[0], color=color, alpha=0.35, lw=3)
        axis.plot(touch.times[ends], forces[:, i] / scale[1], color=color, lw=1.4, label=name)
    axis.set_title("forces in shape (pale: true)", fontsize=10, color=INK, pad=6)
    axis.set_xlabel("time, s", color=GREY, fontsize=8)
    axis.legend(frameon=False, ncols=3, fontsize=8, loc="lower left")
    axis.tick_params(colors=GREY, labelsize=8)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    return figure


def main() -> None:
    """Draws and saves."""
    parser = argparse.ArgumentParser(description=__doc__)
    folder = Path(__file__).parents[1] / "docs" / "assets"
    parser.add_argument("--out", type=Path, default=folder / "touch.png")
    given = parser.parse_args()
    draw(tactileforge.sample_touch()).savefig(given.out, facecolor="white")
    print(given.out)


if __name__ == "__main__":
    main()
