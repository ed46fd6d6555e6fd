"""Figures of force: predicted against measured, and force over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.pages.figures import (
    CLASSES,
    INK,
    SHADE,
    SPLITS,
    Points,
    Series,
    draw_points,
    drawing,
    svg,
)

#: Largest number of drawn samples of a force curve.
_SAMPLES = 400
#: Width of a letter of an action's name, as a share of the time axis.
_LETTER = 0.022


def agreement_figure(
    groups: Sequence[Points],
    labels: tuple[str, str],
    *,
    limits: tuple[float, float] | None = None,
    words: str = "",
    name: str = "",
) -> Markup:
    """Predicted against measured values, with the line of agreement.

    Args:
        groups: Groups of points, later ones drawn over earlier ones; classes by colour and shape.
        labels: Labels of the x and y axes, with units.
        limits: Lowest and highest value of both axes; points beyond lie on the edge. None for the
            span of the points.
        words: Text in the upper left corner.
        name: Description for screen readers; made of the labels if empty.
    """
    known = [np.isfinite(x) & np.isfinite(y) for x, y, *_ in groups]
    groups = [(x[k], y[k], c[k], s) for (x, y, c, s), k in zip(groups, known, strict=True)]
    values = np.concatenate([part for x, y, *_ in groups for part in (x, y)])
    span = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    low, high = limits or span
    # at least 0.2 N across, so that noise alone does not fill the panel
    room = 0.02 * (high - low) if limits else max(0.05 * (high - low), 0.1 - (high - low) / 2)
    ends = (low - room, high + room)
    with drawing(3.9, 3.6) as (figure, axes):
        axes.plot((low, high), (low, high), color=INK, linewidth=0.8, dashes=(4, 3), zorder=1.5)
        for x, y, classes, strength in groups:
            draw_points(axes, (x.clip(low, high), y.clip(low, high), classes, strength))
        if words:
            place = {"transform": axes.transAxes, "va": "top", "linespacing": 1.4, "zorder": 4}
            axes.text(0.04, 0.97, words, **place)
        axes.set(xlim=ends, ylim=ends, aspect="equal", xlabel=labels[0], ylabel=labels[1])
        return svg(figure, name or f"{labels[1]} against {labels[0]}")


def prediction_figure(
    measured: Sequence[Series], predicted: Mapping[str, Series], axis: str
) -> Markup:
    """One axis of the force of a recording over time, in N, and its predictions.

    Args:
        measured: Times and measured forces, one line for each part of the recording.
        predicted: Times and predicted forces, drawn as points, by split.
        axis: Name of the axis: x, y or z.
    """
    with drawing(4.2, 2.4) as (figure, axes):
        for times, values in measured:
            draw_force(axes, times, values[:, None], [INK], f"{axis} (N)")
        for split, (times, values) in predicted.items():
            colour = CLASSES[SPLITS[split]][0]
            axes.plot(times, values, "o", color=colour, markersize=3, markeredgewidth=0)
        _leave_room(axes)
        return svg(figure, f"measured and predicted force along {axis} over time")


def force_curves_figure(
    curves: Sequence[tuple[Series, int]], label: str, words: str, height: float = 2.4
) -> Markup:
    """Several curves of force over time, N and s, each in the colour of its class.

    Args:
        curves: Times, values and class of each curve; odd classes are dashed, so that two curves
            on top of each other are both visible.
        label: Label of the axis of force.
        words: Description for screen readers.
        height: Height of the figure, inches.
    """
    with drawing(4.2, height) as (figure, axes):
        for (times, values), number in curves:
            draw_force(axes, times, values[:, None], [CLASSES[number][0]], label)
            if number % 2:
                axes.lines[-1].set_dashes((4, 3))
        _leave_room(axes)
        return svg(figure, words)


def recording_figure(recording: Recording, shown: Sequence[float]) -> Markup:
    """Force along x, y and z over time, with shaded and named stretches of one action.

    Args:
        recording: Recording with force or actions.
        shown: Times of the frames shown above the figure, s; marked on the axis.
    """
    times = recording.times
    if recording.force is not None and not np.isfinite(recording.force).any():
        recording = replace(recording, force=None)
    with drawing(5.2, 0.9 if recording.force is None else 1.9) as (figure, axes):
        draw_recording(axes, recording)
        axes.plot(
            shown, [0] * len(shown), "|", transform=axes.get_xaxis_transform(), clip_on=False,
            color=INK, markersize=7,
        )  # fmt: skip
        axes.set_xlim(times[0], times[-1])
        return svg(figure, f"{'actions' if recording.force is None else 'force'} over time")


def draw_recording(axes: Any, recording: Recording, shade: str = SHADE) -> None:
    """Draws force along x, y and z over time, N and s; shades and names stretches of one action.

    Args:
        axes: Axes of matplotlib.
        recording: Recording with force or actions.
        shade: Colour of a stretch.
    """
    if recording.force is not None:
        colours = [light for light, _ in CLASSES]
        draw_force(axes, recording.times, recording.force, colours, "N")
        _leave_room(axes)
    else:
        axes.set(yticks=[], ylim=(0, 1), xlabel="time (s)")
    if recording.action is None:
        return
    span = recording.times[-1] - recording.times[0]
    for name, start, stop in _stretches(recording.action, recording.times):
        axes.axvspan(start, stop, color=shade, linewidth=0, zorder=0)
        if (stop - start) > _LETTER * len(name) * span:
            place = dict(x=(start + stop) / 2, y=1.0, s=name, ha="center", va="bottom")
            axes.text(**place, transform=axes.get_xaxis_transform(), fontsize=8)


def draw_force(
    axes: Any, times: NDArray[Any], force: NDArray[Any], colours: Sequence[str], label: str
) -> None:
    """Draws force over time, at most 400 samples; NaN leaves a gap.

    Args:
        axes: Axes of matplotlib.
        times: Times, float (T,), s.
        force: Forces, float (T, n), N; one line for each column.
        colours: Colours of the columns.
        label: Label of the axis of force.
    """
    rows = np.unique(np.linspace(0, len(times) - 1, _SAMPLES).round().astype(int))
    for values, colour in zip(force[rows].T, colours, strict=False):
        axes.plot(times[rows], values, color=colour, linewidth=1.2)
    axes.set(xlabel="time (s)", ylabel=label)


def _leave_room(axes: Any) -> None:
    """Widens the axis of force to at least 0.2 N, so noise alone does not fill the panel."""
    low, high = axes.get_ylim()
    room = max(0.0, 0.1 - (high - low) / 2)
    axes.set_ylim(low - room, high + room)


def _stretches(
    action: NDArray[np.int64], times: NDArray[np.float64]
) -> list[tuple[str, float, float]]:
    """Name, start and end (s) of each stretch of one known action, with gaps between them."""
    edges = [0, *(np.flatnonzero(np.diff(action)) + 1).tolist(), len(action)]
    gap = 0.002 * float(times[-1] - times[0])  # neighbours stay two stretches to the eye
    return [
        (ACTIONS[action[a]].replace("_", " "), float(times[a]) + gap, float(times[b - 1]) - gap)
        for a, b in pairwise(edges)
        if 0 <= action[a] < len(ACTIONS) and times[b - 1] - times[a] > 2 * gap
    ]
