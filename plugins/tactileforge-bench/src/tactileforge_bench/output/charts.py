"""The pictures of a bench, in the style of the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from tactileforge.pages import CLASSES, MINUS, NONE, agreement_figure, drawing, svg

#: Points that are drawn; numbers are of all.
POINTS = 300
#: Classes up to which a matrix has names.
NAMED = 30
#: Letters of a name beside the matrix, and shades of its squares.
_LETTERS = 14
_SHADES = 12
#: The darkest shade, so that words on it stay readable.
_DARKEST = 0.62


def rmse(truth: NDArray[Any], predicted: NDArray[Any]) -> float:
    """Root of the mean squared error."""
    error = predicted.astype(np.float64) - truth
    return float(np.sqrt(np.mean(error**2)))


def correlation(truth: NDArray[Any], predicted: NDArray[Any]) -> float:
    """Pearson's r; NaN where one of the two does not vary."""
    if truth.std() < 1e-9 or predicted.std() < 1e-9:
        return float("nan")
    return float(np.corrcoef(truth.astype(np.float64), predicted.astype(np.float64))[0, 1])


def scatter(
    truth: NDArray[Any],
    predicted: NDArray[Any],
    axis: str,
    limits: tuple[float, float],
    unit: str = "N",
) -> Markup:
    """Predicted against true values along one axis, with RMSE and r, and the line of no error.

    Args:
        truth: float (N,).
        predicted: float (N,); what lies outside the limits is drawn on their edge.
        axis: Name of the axis.
        limits: Lower and upper limit of both axes.
        unit: Unit of the values; errors of N are given in mN.
    """
    # spread evenly and not drawn, so that a page is the same each time
    rows = np.unique(np.linspace(0, len(truth) - 1, POINTS).round().astype(int))
    error = rmse(truth, predicted)
    told = f"{1000 * error:.0f} mN" if unit == "N" else f"{error:.3g} {unit}".rstrip()
    what = f"{axis} ({unit})" if unit else axis
    r = correlation(truth, predicted)
    told_r = f"{r:.2f}".replace("-", MINUS) if r == r else NONE  # NaN where one does not vary
    return agreement_figure(
        [(truth[rows], predicted[rows], np.zeros(len(rows), np.int64), 0.6)],
        (f"true {what}", f"predicted {what}"),
        limits=limits,
        words=f"RMSE {told}\nr {told_r}",
        name=f"predicted against true {axis}",
    )


def confusion(
    truth: NDArray[np.int64], predicted: NDArray[np.int64], names: Sequence[str]
) -> tuple[Markup, NDArray[np.int64]]:
    """Confusion matrix: shares of each true class predicted as each class.

    Args:
        truth: int64 (N,).
        predicted: int64 (N,).
        names: Names of the classes.

    Returns:
        The drawing, and the counts it shows, int64 (C, C), true classes first.
    """
    count = len(names)
    counts = np.zeros((count, count), np.int64)
    np.add.at(counts, (truth, predicted), 1)
    shares = counts / np.maximum(1, counts.sum(1, keepdims=True))
    size = 2.2 + 0.26 * count if count <= 8 else max(4.2, 1.9 + 0.17 * min(count, NAMED))
    with drawing(size, size) as (figure, axes):
        # a path for each shade, and not for each square: a matrix may have thousands of them
        for level in range(1, _SHADES + 1):
            low, high = (level - 0.5) / _SHADES, (level + 0.5) / _SHADES
            chosen = np.argwhere((shares >= low) & (shares < high))
            if len(chosen):
                axes.add_patch(_squares(chosen, _DARKEST * level / _SHADES))
        # what would be printed as 0 % is left out; in small squares, all below 10 %
        least = 0.005 if count <= 8 else 0.095
        small = 9 if count <= 8 else 7
        for row, column in np.argwhere(shares >= least) if count <= NAMED else ():
            words = f"{100 * shares[row, column]:.0f}"
            axes.text(column, row, words, ha="center", va="center", fontsize=small)
        _name(axes, names, counts.sum(1))
        return svg(figure, "shares of the true classes by predicted class"), counts


def _squares(places: NDArray[np.int64], strength: float) -> PathPatch:
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]]) * 0.96
    points = (places[:, None, ::-1] + corners).reshape(-1, 2)
    codes = np.tile([Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY], len(places))
    return PathPatch(Path(points, codes), facecolor=CLASSES[0][0], alpha=strength, linewidth=0)


def _name(axes: Any, names: Sequence[str], totals: NDArray[np.int64]) -> None:
    count = len(names)
    short = [name if len(name) <= _LETTERS else f"{name[: _LETTERS - 1]}…" for name in names]
    rows = [f"{name} ({total})" for name, total in zip(short, totals.tolist(), strict=True)]
    places = range(count) if count <= NAMED else ()
    size = 9 if count <= 8 else 8
    # names may have dollar signs, which would be read as formulas
    axes.set_xticks(places, short if places else (), rotation=90, fontsize=size, parse_math=False)
    axes.set_yticks(places, rows if places else (), fontsize=size, parse_math=False)
    axes.set(xlim=(-0.5, count - 0.5), ylim=(count - 0.5, -0.5), aspect="equal")
    axes.set(xlabel="predicted", ylabel="true (number of clips)")
    axes.grid(visible=False)
    axes.tick_params(length=0)
