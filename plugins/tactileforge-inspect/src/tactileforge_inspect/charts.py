"""Charts of a data set, in the style of the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from tactileforge.pages import CLASSES, drawing, svg
from tactileforge_inspect.counters import DURATIONS, Histogram

#: Longest label of a bar, letters.
_NAME = 28


def force_histogram(sensors: Sequence[Histogram], axis: str) -> Markup:
    """Shares of the frames of each sensor by force along one axis, on a logarithmic scale.

    Args:
        sensors: Histogram of each sensor; at least one has counts.
        axis: Name of the axis.
    """
    widest = max(sensors, key=lambda sensor: sensor.reach)
    # the bins of all sensors in common, as each histogram has grown by its own forces
    counts = [sensor.over(widest.reach) for sensor in sensors]
    filled = np.flatnonzero(sum(counts))
    with drawing(4.2, 2.4) as (figure, axes):
        least = 1.0
        for i, histogram in enumerate(counts):
            shares = histogram[filled[0] : filled[-1] + 1] / max(1, histogram.sum())
            edges = widest.edges[filled[0] : filled[-1] + 2]
            axes.stairs(shares, edges, color=CLASSES[i % len(CLASSES)][0], linewidth=1.6)
            least = min(least, *shares[shares > 0].tolist(), 1.0)
        axes.set(yscale="log", xlabel=f"{axis} (N)", ylabel="share of frames")
        # up to 2: a constant force has a share of 1, which the border would hide
        axes.set_ylim(least / 2, 2)
        middle = (edges[0] + edges[-1]) / 2  # a constant force should not fill the panel
        room = max(0.05, 0.55 * (edges[-1] - edges[0]))
        axes.set_xlim(middle - room, middle + room)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100 * share:g} %"))
        axes.yaxis.set_minor_formatter(FuncFormatter(lambda share, _: ""))
        return svg(figure, f"shares of frames by force along {axis}")


def bars(counts: Mapping[str, int], words: str) -> Markup:
    """Counts by name, the first at the top."""
    with drawing(5.2, 0.5 + 0.24 * max(2, len(counts))) as (figure, axes):
        names = [name if len(name) <= _NAME else f"{name[: _NAME - 1]}…" for name in counts]
        axes.barh(range(len(names)), counts.values(), height=0.72, color=CLASSES[0][0], linewidth=0)
        # names of objects may hold a $, which matplotlib would take for mathematics
        axes.set_yticks(range(len(names)), names, parse_math=False)
        for place, count in enumerate(counts.values()):
            axes.annotate(
                f"{count:,}", (count, place), (3, 0), textcoords="offset points", va="center",
                fontsize=8,
            )  # fmt: skip
        axes.set(ylim=(max(2, len(names)) - 0.5, -0.5), xlim=(0, 1.12 * max(counts.values())))
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        return svg(figure, words)


def durations(counts: NDArray[np.int64]) -> Markup:
    """Recordings by their duration, on a logarithmic axis."""
    with drawing(5.2, 2.4) as (figure, axes):
        axes.stairs(counts, DURATIONS, fill=True, color=CLASSES[0][0])
        filled = np.flatnonzero(counts)
        first, last = max(0, int(filled[0]) - 4), min(len(counts), int(filled[-1]) + 5)
        axes.set(xscale="log", xlabel="duration (s)", ylabel="recordings")
        axes.set_xlim(DURATIONS[first], DURATIONS[last])
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(FuncFormatter(lambda value, _: ""))
        axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
        return svg(figure, "recordings by duration")
