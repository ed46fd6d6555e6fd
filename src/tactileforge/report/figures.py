"""Figures as inline SVG, whose colours follow the page's light or dark theme."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactileforge.report.metrics import Curve

#: Colours of classes, light and dark theme; after Okabe and Ito, so that the colour-blind tell them apart.
CLASSES = (
    ("#0072b2", "#4ba7e0"),
    ("#d55e00", "#ff8a3d"),
    ("#009e73", "#2bcf9f"),
    ("#b3579a", "#e08fcb"),
    ("#b98000", "#f0b83c"),
    ("#3f4a9e", "#9aa5f5"),
)
#: Shapes of classes: with six colours, 18 classes.
MARKERS = "o^s"
_INK, _LINE, _OTHER, _SHADE = "#010203", "#040506", "#070809", "#0a0b0c"
_VARIABLES = {
    _INK: "currentColor",
    _LINE: "var(--line)",
    _OTHER: "var(--other)",
    _SHADE: "var(--shade)",
} | {light: f"var(--c{i})" for i, (light, _) in enumerate(CLASSES)}
_STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "tactileforge",
    "font.size": 10,
    "text.color": _INK,
    "axes.labelcolor": _INK,
    "axes.edgecolor": _LINE,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.formatter.limits": (-3, 5),
    "grid.color": _LINE,
    "grid.linewidth": 0.6,
    "xtick.color": _LINE,
    "ytick.color": _LINE,
    "xtick.labelcolor": _INK,
    "ytick.labelcolor": _INK,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
}

#: Points, class of each (-1 for those that have none), and how strongly to draw them.
Points = tuple[NDArray[Any], NDArray[Any], NDArray[np.int64], float]


def loss_figure(
    train: Curve | None, val: Curve | None, weight: Curve | None, last_step: int
) -> str:
    """Loss in training and validation, over the weight of the objective as a shaded area."""
    figure, axes = _start(4.2, 2.5)
    if weight is not None:
        behind = axes.twinx()
        axes.set_zorder(behind.get_zorder() + 1)
        behind.fill_between(weight.steps, weight.values, color=_SHADE, linewidth=0)
        top = max(float(weight.values.max()), 1e-9)
        behind.set_ylim(0, 1.05 * top)
        behind.set_yticks([0, top], ["0", f"{top:g}"])
        behind.set_ylabel("weight", labelpad=-6)
        behind.grid(False)
        behind.tick_params(length=0)
    drawn = [curve for curve in (train, val) if curve is not None]
    if train is not None:
        axes.plot(train.steps, train.values, color=CLASSES[0][0])
    if val is not None:
        axes.plot(val.steps, val.values, "o-", color=CLASSES[1][0], markersize=4, linewidth=1.2)
    _log_if_wide(axes, [curve.values for curve in drawn])
    _step_axis(axes, last_step)
    axes.set_ylabel("loss")
    return _svg(figure, "loss over steps, and the weight of the objective behind it")


def curve_figure(curve: Curve, last_step: int, label: str, val: Curve | None = None) -> str:
    """One value over the run, in training and, where there is one, in validation."""
    figure, axes = _start(4.2, 2.5)
    axes.plot(curve.steps, curve.values, color=CLASSES[0][0])
    if val is not None:
        axes.plot(val.steps, val.values, "o-", color=CLASSES[1][0], markersize=4, linewidth=1.2)
    _step_axis(axes, last_step)
    axes.set_ylabel(label)
    return _svg(figure, f"{label} over steps")


def scatter_figure(groups: Sequence[Points], labels: tuple[str, str], identity: bool = False) -> str:
    """Points coloured and shaped by class, on equal axes if they compare like with like."""
    figure, axes = _start(3.9, 3.6)
    for x, y, classes, strength in groups:
        for number in np.unique(classes):
            chosen = classes == number
            axes.plot(
                x[chosen],
                y[chosen],
                marker_of(int(number)),
                color=_OTHER if number < 0 else CLASSES[number % len(CLASSES)][0],
                alpha=strength,
                markersize=4 if strength > 0.5 else 3,
                markeredgewidth=0,
                zorder=2 + strength + (number >= 0),
            )
    if identity:
        everything = np.concatenate([part for x, y, *_ in groups for part in (x, y)])
        low, high = float(everything.min()), float(everything.max())
        room = 0.05 * max(high - low, 1e-3)
        ends = (low - room, high + room)
        axes.plot(ends, ends, color=_INK, linewidth=0.8, dashes=(4, 3), zorder=1.5)
        axes.set(xlim=ends, ylim=ends, aspect="equal")
    axes.set(xlabel=labels[0], ylabel=labels[1])
    return _svg(figure, f"{labels[1]} against {labels[0]}")


def force_curve_figure(
    times: tuple[NDArray[Any], NDArray[Any]], forces: tuple[NDArray[Any], NDArray[Any]], axis: str
) -> str:
    """One axis of the force of a recording: measured as a line, predicted as points, in N."""
    figure, axes = _start(4.2, 2.5)
    axes.plot(times[0], forces[0], color=_INK, linewidth=1.2)
    axes.plot(times[1], forces[1], "o", color=CLASSES[1][0], markersize=3, markeredgewidth=0)
    axes.set(xlabel="time (s)", ylabel=f"{axis} (N)")
    return _svg(figure, f"measured and predicted force along {axis} over time")


def marker_of(number: int) -> str:
    """The shape of a class."""
    return MARKERS[max(number, 0) // len(CLASSES) % len(MARKERS)]


def _start(width: float, height: float) -> tuple[Figure, Any]:
    with mpl.rc_context(_STYLE):
        figure = Figure((width, height), layout="constrained", facecolor="none")
        FigureCanvasSVG(figure)
        return figure, figure.add_subplot()


def _step_axis(axes: Any, last_step: int) -> None:
    axes.set_xlim(0, max(last_step, 1))
    axes.set_xlabel("step")


def _log_if_wide(axes: Any, parts: Sequence[NDArray[np.float64]]) -> None:
    """A logarithmic axis where values span more than 30 to 1; else one that shows small changes."""
    values = np.concatenate([part[np.isfinite(part)] for part in parts] or [np.zeros(0)])
    if len(values) and values.min() > 0 and values.max() > 30 * values.min():
        axes.set_yscale("log")


def _svg(figure: Figure, words: str) -> str:
    """Inline SVG: no fixed size or colours, no ids but those that it refers to."""
    file = io.StringIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    text = file.getvalue()
    text = text[text.index("<svg") :]
    used = set(re.findall(r'(?:#)([^")]+)', "".join(re.findall(r'(?:href="|url\()#[^")]+', text))))
    text = re.sub(r' id="([^"]+)"', lambda m: m[0] if m[1] in used else "", text)
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(r"\s*<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    for colour, variable in _VARIABLES.items():
        text = text.replace(colour, variable)
    return text.replace("<svg", f'<svg role="img" aria-label="{words}"', 1)
