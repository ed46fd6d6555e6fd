"""The figure of one recording, shared by the data sets."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tactileforge.contracts import Recording
from tactileforge.data.frames.cut import spread_rows
from tactileforge.pages.forces import draw_recording

#: Frames side by side.
_SHOWN = 8
_AXES = ("x right", "y down", "z into the gel")


def plot_recording(recording: Recording) -> Figure:
    """A figure of frames, their difference from the background, forces and actions.

    Args:
        recording: The recording; the panels of absent data are left out.

    Returns:
        A matplotlib figure without a window.

    Raises:
        DataError: A frame cannot be decoded.
    """
    count = len(recording.frames)
    frames = recording.frames.read(spread_rows(count, _SHOWN))
    strips = {"frames": frames}
    if (background := recording.background()) is not None:
        # int16, since a difference of bytes would wrap around
        change = frames.astype(np.int16) - background.astype(np.int16)
        strips["minus background"] = np.clip(128 + change, 0, 255).astype(np.uint8)
    has_curves = recording.force is not None or recording.action is not None
    heights = [1.0] * len(strips) + [1.2] * has_curves
    figure = Figure(figsize=(12, 1.5 * sum(heights) + 0.8), layout="constrained")
    panels = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    for panel, (name, strip) in zip(panels, strips.items(), strict=False):
        panel.imshow(np.concatenate(list(strip), axis=1), aspect="equal")
        panel.set_ylabel(name, fontsize=8)
        panel.set_xticks([])
        panel.set_yticks([])
    if has_curves:
        draw_recording(panels[-1], recording, shade="0.92")
        for line, name in zip(panels[-1].lines, _AXES, strict=False):
            line.set_label(name)
        # a still has one time, and matplotlib warns of an axis without a width
        panels[-1].set_xlim(recording.times[0], max(recording.times[-1], recording.times[0] + 1e-3))
        if panels[-1].lines:
            panels[-1].legend(fontsize=7, loc="upper right")
    title = f"{recording.key} · {recording.sensor} · {count} frames"
    figure.suptitle(f"{title}\n{recording.text}" if recording.text else title, fontsize=10)
    return figure
