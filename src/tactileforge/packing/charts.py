"""Charts of scores, in the style of the report."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from tactileforge.pages.figures import CLASSES, INK, SHADE, drawing, svg

#: Smallest score on the logarithmic axis; smaller ones (no motion) are drawn here.
_LEAST = 0.01


def score_histogram(
    scores: Mapping[str, NDArray[np.float64]], thresholds: Mapping[str, float | None]
) -> Markup:
    """Histogram of the scores of each sensor, with its threshold.

    Args:
        scores: Scores of frames, by sensor; NaN is ignored.
        thresholds: Threshold, by sensor; None for none.
    """
    drawn = {
        name: np.maximum(values[np.isfinite(values)], _LEAST) for name, values in scores.items()
    }
    every = np.concatenate([*drawn.values(), [value for value in thresholds.values() if value]])
    low, high = (float(every.min()), float(every.max())) if len(every) else (_LEAST, 1.0)
    edges = np.geomspace(low / 1.2, high * 1.2, 60)
    with drawing(5.2, 2.4) as (figure, axes):
        for i, (name, values) in enumerate(drawn.items()):
            colour = CLASSES[i % len(CLASSES)][0]
            shares = 100 * np.histogram(values, edges)[0] / max(1, len(values))
            axes.stairs(shares, edges, color=colour, linewidth=1.6)
            if (threshold := thresholds[name]) is not None:
                shared = len({*thresholds.values()}) == 1
                axes.axvline(threshold, color=INK if shared else colour, dashes=(4, 3), linewidth=1)
        axes.set(xscale="log", xlabel="score", ylabel="frames (%)")
        return svg(figure, "shares of frames by score")


def score_curve(
    times: NDArray[np.float64],
    scores: NDArray[np.float64],
    kept: NDArray[np.bool_],
    threshold: float | None,
) -> Markup:
    """Scores of a recording over time, with kept frames shaded.

    Args:
        times: float64 (n,), s.
        scores: float64 (n,), score of each frame.
        kept: bool (n,), mask of the kept frames.
        threshold: Score of the line to draw; None for none.
    """
    with drawing(5.2, 1.5) as (figure, axes):
        axes.plot(times, scores, color=CLASSES[0][0], linewidth=1.2)
        axes.set(xlabel="time (s)", ylabel="score", xlim=(times[0], times[-1]))
        # half a period to each side, so that a single kept frame shows
        half = float(np.median(np.diff(times))) / 2
        edges = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]]).astype(int)))
        for start, stop in edges.reshape(-1, 2):
            axes.axvspan(
                times[start] - half, times[stop - 1] + half, color=SHADE, linewidth=0, zorder=0
            )
        if threshold is not None:
            axes.axhline(threshold, color=INK, dashes=(4, 3), linewidth=0.8)
        axes.set_ylim(bottom=0)
        return svg(figure, "scores over time")
