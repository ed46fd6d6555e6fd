"""Figures as inline SVG in the colours of the page's light or dark theme."""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from tactileforge.pages.curves import Curve
from tactileforge.pages.drawings import collect

#: Colours of classes, light and dark theme, after Okabe and Ito so that colour-blind readers can
#: tell them apart.
CLASSES = (
    ("#0072b2", "#4ba7e0"),
    ("#d55e00", "#ff8a3d"),
    ("#009e73", "#2bcf9f"),
    ("#b3579a", "#e08fcb"),
    ("#b98000", "#f0b83c"),
    ("#3f4a9e", "#9aa5f5"),
)
#: Shapes of classes: with six colours, 18 classes differ.
MARKERS = "o^s"
#: Classes of the splits.
SPLITS = {"train": 0, "val": 1}
TRAIN, VAL = CLASSES[0][0], CLASSES[1][0]
# placeholders, since matplotlib takes no CSS variables: `svg` replaces them
INK = "#010203"
_LINE, _OTHER = "#040506", "#070809"
SHADE = "#0a0b0c"
_VARIABLES = {
    INK: "currentColor",
    _LINE: "var(--line)",
    _OTHER: "var(--other)",
    SHADE: "var(--shade)",
} | {light: f"var(--c{i})" for i, (light, _) in enumerate(CLASSES)}
_STYLE = {
    "svg.fonttype": "none",  # text as text: smaller, and read by screen readers
    "svg.hashsalt": "tactileforge",  # random by default, and a report written again would differ
    "font.size": 10,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": _LINE,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.formatter.limits": (-4, 5),
    "axes.formatter.useoffset": False,
    "grid.color": _LINE,
    "grid.linewidth": 0.6,
    "xtick.color": _LINE,
    "ytick.color": _LINE,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
}

#: Letters of a name beside a bar.
_LETTERS = 26

#: Times and values.
Series = tuple[NDArray[Any], NDArray[Any]]
#: x, y, class of each point (-1 without a class), and opacity 0..1.
Points = tuple[NDArray[Any], NDArray[Any], NDArray[np.int64], float]


def curve_figure(
    label: str,
    last_step: int,
    train: Curve | None,
    val: Curve | None = None,
    weight: Curve | None = None,
    *,
    unit: str = "step",
    of: str = "",
) -> Markup:
    """A value in training and validation over the steps of a run.

    Args:
        label: Name of the value.
        last_step: End of the horizontal axis.
        train: Training values, drawn as a line.
        val: Validation values, drawn as joined points.
        weight: Weight of the objective, drawn as a shaded area on an axis of its own.
        unit: Name of a step.
        of: Name of the owner of the value, such as an objective.
    """
    with drawing(4.2, 2.4) as (figure, axes):
        if weight is not None:
            behind = axes.twinx()
            axes.set_zorder(behind.get_zorder() + 1)  # a twin is drawn on top by default
            behind.fill_between(weight.steps, weight.values, color=SHADE, linewidth=0)
            top = float(weight.values.max()) or 1.0
            behind.set_ylim(0, 1.05 * top)
            behind.set_yticks([0, top], ["0", f"{top:.2g}"])
            behind.grid(False)
            behind.tick_params(length=0)
        if train is not None:
            thin = train.thinned()
            axes.plot(thin.steps, thin.values, ".-" if len(thin.steps) < 3 else "-", color=TRAIN)
        if val is not None:
            axes.plot(val.steps, val.values, "o-", color=VAL, markersize=4, linewidth=1.2)
        if label == "loss":
            values = [curve.values for curve in (train, val) if curve is not None]
            _log_if_wide(axes, np.concatenate(values or [np.zeros(0)]))
        axes.set(xlim=(0, max(last_step, 1)), xlabel=unit, ylabel=label)
        shaded = ", and the weight of the objective" * (weight is not None)
        return svg(figure, f"{of} {label}".strip() + f" over {unit}s{shaded}")


def lines_figure(label: str, last_step: int, lines: Mapping[str, Curve]) -> Markup:
    """Several values over the steps of a run, each in the colour of its place.

    Args:
        label: Name of the values.
        last_step: End of the horizontal axis.
        lines: Curves by name.
    """
    with drawing(4.2, 2.4) as (figure, axes):
        for number, curve in enumerate(lines.values()):
            thin = curve.thinned()
            style = ".-" if len(thin.steps) < 30 else "-"
            axes.plot(thin.steps, thin.values, style, color=CLASSES[number % len(CLASSES)][0])
        values = np.concatenate([curve.values for curve in lines.values()])
        _log_if_wide(axes, values)
        axes.set(xlim=(0, max(last_step, 1)), xlabel="step", ylabel=label)
        return svg(figure, f"{label} over steps: {', '.join(lines)}")


def bars_figure(
    label: str, bars: Sequence[tuple[str, float, float]], limits: tuple[float, float] | None = None
) -> Markup:
    """Horizontal bars with intervals, from the top.

    Args:
        label: Name of the values, with their unit.
        bars: Name, value and half of the interval (NaN for none) of each.
        limits: Ends of the axis; None to start it at 0.
    """
    names = [name if len(name) <= _LETTERS else f"{name[: _LETTERS - 1]}…" for name, *_ in bars]
    with drawing(4.2, 0.75 + 0.26 * len(bars)) as (figure, axes):
        for place, (_, value, half) in enumerate(bars):
            axes.barh(place, value, 0.62, color=CLASSES[0][0], alpha=0.75)
            if half == half:
                ends = [value - half, value + half]
                axes.plot(ends, [place] * 2, "|-", color=INK, linewidth=1.2, markersize=6)
        # names may have dollar signs, which would be read as formulas
        axes.set_yticks(range(len(bars)), names, parse_math=False)
        axes.set(ylim=(len(bars) - 0.5, -0.5))
        axes.set_xlabel(label, loc="right")  # a long one reaches below the names, not off the page
        if limits:
            axes.set_xlim(*limits)
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        return svg(figure, f"{label} of {', '.join(name for name, *_ in bars)}")


def scatter_figure(groups: Sequence[Points], labels: tuple[str, str]) -> Markup:
    """Points coloured and shaped by class, on axes without a scale.

    Args:
        groups: Groups of points, later ones drawn over earlier ones.
        labels: Labels of the x and y axes.
    """
    with drawing(3.9, 3.6) as (figure, axes):
        for points in groups:
            draw_points(axes, points)
        axes.autoscale_view()
        axes.tick_params(length=0, labelbottom=False, labelleft=False)
        axes.set(xlabel=labels[0], ylabel=labels[1])
        return svg(figure, f"{labels[1]} against {labels[0]}")


def draw_points(axes: Any, points: Points) -> None:
    """Draws points, coloured and shaped by class.

    Args:
        axes: Axes of matplotlib.
        points: Group of points.
    """
    x, y, classes, strength = points
    size = 4 if strength > 0.6 else 3
    for number in np.unique(classes).tolist():
        chosen = classes == number
        style = {
            "color": _OTHER if number < 0 else CLASSES[number % len(CLASSES)][0],
            "alpha": strength,
            "zorder": 2 + strength + (number >= 0),
        }
        right, up, shape = x[chosen], y[chosen], marker_of(number)
        if shape != "o":
            axes.plot(right, up, shape, markersize=size, markeredgewidth=0, **style)
            continue
        # all dots as one path, each a short round line: a tenth of the bytes of markers
        length = float(np.ptp(right)) / 2000
        dots = np.stack([np.stack([right, up], 1), np.stack([right + length, up], 1)], 1)
        path = Path(dots.reshape(-1, 2), np.tile([Path.MOVETO, Path.LINETO], len(right)))
        axes.add_patch(PathPatch(path, fill=False, linewidth=size, capstyle="round", **style))


def marker_of(number: int) -> str:
    """The shape of a class."""
    return MARKERS[max(number, 0) // len(CLASSES) % len(MARKERS)]


@contextmanager
def drawing(width: float, height: float) -> Iterator[tuple[Figure, Any]]:
    """A figure with one pair of axes, in inches; the page scales it."""
    with mpl.rc_context(_STYLE):
        figure = Figure((width, height), layout="constrained", facecolor="none")
        FigureCanvasSVG(figure)
        yield figure, figure.add_subplot()


def _log_if_wide(axes: Any, values: NDArray[np.float64]) -> None:
    """Makes the axis logarithmic for positive values spanning more than 30 to 1."""
    values = values[np.isfinite(values)]
    if len(values) and values.min() > 0 and values.max() > 30 * values.min():
        axes.set_yscale("log")


def svg(figure: Figure, words: str) -> Markup:
    """Inline SVG without own size, fonts and colours, and with ids unique on the page."""
    file = io.StringIO()
    # not `savefig`, which draws the figure twice to lay it out: the same bytes, in 0.6 of its time
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasSVG)
    canvas.print_svg(file, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    # before `collect`, which changes the colours of the figure
    text = file.getvalue()
    collect(figure, words, {INK: "#222222", _LINE: "#cccccc", _OTHER: "#999999", SHADE: "#e8e8e8"})
    text = text[text.index("<svg") :]
    # a page of several figures needs ids of their own, its own font and colours, and no <style>,
    # which holds for all of it; unused ids, digits and blanks are dropped for length alone: with
    # the fonts, 27.5 kB of a curve over 300 steps become 17.5 kB
    name = hashlib.sha256(text.encode()).hexdigest()[:8]
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    text = re.sub(r' id="([^"]+)"', lambda m: m[0] if m[1] in used else "", text)
    text = re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{name}-", text)
    text = re.sub(r"<style.*?</style>|<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.S)
    text = re.sub(r" font-family: [^;\"]*;?", "", text)
    text = re.sub(r"<[^>]+>", lambda m: re.sub(r"(\.\d\d)\d+", r"\1", m[0]), text)
    text = re.sub(r"\s*\n\s*", " ", text)
    for colour, variable in _VARIABLES.items():
        text = text.replace(colour, variable)
    size = re.compile(r'(<svg[^>]*?) (?:width|height)="[^"]*"')
    text = size.sub(r"\1", size.sub(r"\1", text, count=1), count=1)
    return Markup(text.replace("<svg", f'<svg role="img" aria-label="{escape(words)}"', 1))
