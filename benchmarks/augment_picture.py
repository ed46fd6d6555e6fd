"""Draws the picture of docs/augmentation.md: a simulated touch, and each change of it.

Run: python benchmarks/augment_picture.py [--out docs/assets/augment.jpg]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from readme_picture import INK

from tactileforge import sample_touch as touch
from tactileforge.contracts import ACTIONS, Batch, Recording
from tactileforge.data import Augment, Clips, collate

#: What each panel shows: title, options, and the seed of its draw.
PANELS: tuple[tuple[str, dict[str, Any], int], ...] = (
    ("as recorded", {}, 0),
    ("horizontal", {"horizontal": 1.0}, 0),
    ("rotate=180", {"rotate": 180.0}, 4),
    ("shift=0.2", {"shift": 0.2}, 2),
    ("scale=0.5", {"scale": 0.5}, 5),
    ("blur=3", {"blur": 3.0}, 2),
    ("gain=0.4", {"gain": 0.4}, 3),
    ("colour=0.3", {"colour": 0.3}, 5),
    ("noise=20", {"noise": 20.0}, 2),
    ("five at once", {"rotate": 180.0, "shift": 0.1, "scale": 0.2, "gain": 0.2, "blur": 1.5}, 9),
)
#: Gain of the contrast in the second rows.
CONTRAST = 3.0


def clip_of(recording: Recording, height: int = 240) -> Batch:
    """The clip with the strongest shear."""
    size = height, height * recording.frames.shape[1] // recording.frames.shape[0]
    clips = Clips([recording], frames=2, spacing=0.0667, hop=0.05, size=size)
    force = np.asarray(recording.force)[clips.index[:, 1]]
    return collate([clips[int(np.argmax(np.hypot(force[:, 0], force[:, 1])))]])


def changed(batch: Batch, options: dict[str, Any], seed: int) -> Batch:
    """One clip after one change."""
    torch.manual_seed(seed)
    augment = Augment(**{"horizontal": 0.0, "vertical": 0.0, **options})
    after: Batch = augment(augment.labels(dict(batch)))
    return after


def show(axis: Axes, pixels: Any, title: str) -> None:
    """A panel without ticks."""
    axis.imshow(pixels)
    axis.set_axis_off()
    axis.set_title(title, fontsize=10, color=INK, pad=4)


def arrow(axis: Axes, batch: Batch, shape: tuple[int, int]) -> None:
    """The shear, from the middle of the picture."""
    shear = batch["force"][0, -1, :2].numpy()
    by = shear / np.abs(shear).max() * shape[0] * 0.35
    centre = shape[1] / 2, shape[0] / 2
    style = {"arrowstyle": "-|>", "color": "white", "lw": 2.2, "mutation_scale": 16}
    axis.annotate("", (centre[0] + by[0], centre[1] + by[1]), centre, arrowprops=style)


def draw(batch: Batch) -> Figure:
    """Draws every change: the frame, and below it its difference from the background."""
    columns = len(PANELS) // 2
    figure: Figure = plt.figure(figsize=(12.5, 8.6), dpi=110)
    outer = figure.add_gridspec(2, 1, hspace=0.12, left=0.01, right=0.99, bottom=0.03, top=0.97)
    inner = [
        rows.subgridspec(2, columns, hspace=0.02, wspace=0.04) for rows in (outer[0], outer[1])
    ]
    for number, (title, options, seed) in enumerate(PANELS):
        after = changed(batch, options, seed)
        places = [inner[number // columns][row, number % columns] for row in (0, 1)]
        above, below = (figure.add_subplot(place) for place in places)
        frame = after["frames"][0, -1].permute(1, 2, 0)
        rest = after["background"][0].permute(1, 2, 0)
        contrast = 128 + CONTRAST * (frame.float() - rest.float())
        x, y, z = after["force"][0, -1].tolist()
        said = ACTIONS[after["action"][0]] if after["action"][0] >= 0 else "action unknown"
        show(above, frame.numpy(), title)
        show(below, contrast.clamp(0, 255).byte().numpy(), "")
        arrow(below, after, (frame.shape[0], frame.shape[1]))
        label = f"{x:+.1f}, {y:+.1f}, {z:+.1f} N; {said}"
        below.set_title(label, fontsize=8, color=INK, y=-0.12)
    return figure


def main() -> None:
    """Draws and saves."""
    parser = argparse.ArgumentParser(description=__doc__)
    folder = Path(__file__).parents[1] / "docs" / "assets"
    parser.add_argument("--out", type=Path, default=folder / "augment.jpg")
    given = parser.parse_args()
    figure = draw(clip_of(touch()))
    smaller = {"quality": 72} if given.out.suffix == ".jpg" else None
    figure.savefig(given.out, facecolor="white", pil_kwargs=smaller)
    print(given.out)


if __name__ == "__main__":
    main()
