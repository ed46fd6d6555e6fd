"""The page of an optical calibration: depths of held-out presses, before and after."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from tactileforge_depth.reader import depth_image

from tactileforge.pages import (
    INK,
    Section,
    draw_points,
    drawing,
    figure,
    html_page,
    number,
    panel,
    panels,
    paragraph,
    svg,
    table,
    verdict,
)
from tactileforge_live.calibrate.depth import DepthCalibration, DepthFit

#: Presses shown as pictures.
_SHOWN = 6


def depth_page(result: DepthCalibration) -> str:
    """Builds the page, as HTML."""
    presses = result.presses
    about = (
        f"{len(presses)} presses of a ball of {2 * presses.ball:g} mm, {presses.spacing:.4g} mm "
        f"per pixel, gel of {presses.thickness:g} mm. Each press is read by a calibration fitted "
        "without it."
    )
    top = paragraph(about, soft=True) + verdict(("bad", note) for note in result.notes)
    title = f"Depth calibration of {result.sensor}"
    return html_page(title, top, [_errors(result), _pictures(result)])


def depth_table(result: DepthCalibration) -> list[tuple[str, str, str, str]]:
    """Rows of a table: source of the depth, correlation, error in mm, and deepest place in mm.

    Args:
        result: Calibration with its evidence.
    """
    fits = {"shipped calibration": result.before, "this calibration": result.after}
    rows = [
        (name, number(fit.correlation.mean()), number(fit.error.mean()), _mean(_deepest(fit.depth)))
        for name, fit in fits.items()
        if fit is not None
    ]
    return [*rows, ("contact mechanics", "", "", _mean(_deepest(result.truth)))]


def _errors(result: DepthCalibration) -> Section:
    text = (
        "Means over presses. The surface around the ball follows from contact mechanics and the "
        "circle of contact, so it has errors of its own."
    )
    if result.before is not None:
        text += " Drawn faintly: the shipped calibration."
    head = ("text|depth by", "correlation", "error (mm)", "deepest place (mm)")
    body = paragraph(text) + table("depths", head, depth_table(result))
    return Section("depth", "Depth", body + panels([panel("Deepest place", _agreement(result))]))


def _agreement(result: DepthCalibration) -> Markup:
    truth = _deepest(result.truth)
    drawn: list[tuple[DepthFit | None, int, float]] = [
        (result.before, -1, 0.4),
        (result.after, 0, 0.8),
    ]
    with drawing(4.2, 3.2) as (shown, axes):
        axes.axline((float(truth.min()),) * 2, slope=1, color=INK, linewidth=0.9)
        for fit, kind, strength in drawn:
            if fit is not None:
                kinds = np.full(len(truth), kind)
                draw_points(axes, (truth, _deepest(fit.depth), kinds, strength))
        axes.autoscale_view()
        axes.set(xlabel="contact mechanics (mm)", ylabel="read (mm)")
        return svg(shown, "deepest place of each press as read, against contact mechanics")


def _deepest(depth: Any) -> NDArray[np.float64]:
    out: NDArray[np.float64] = depth.amax((1, 2)).double().numpy()
    return out


def _mean(values: NDArray[np.float64]) -> str:
    return number(float(values.mean()))


def _pictures(result: DepthCalibration) -> Section:
    step = max(1, len(result.presses) // _SHOWN)
    chosen = range(0, len(result.presses), step)[:_SHOWN]
    shown = [result.presses.pictures[i].movedim(0, -1).numpy() for i in chosen]
    rows = [figure(shown, "pictures", "picture of a press", _SHOWN)]
    maps = {"by contact mechanics": result.truth}
    if result.before is not None:
        maps["by the shipped calibration"] = result.before.depth
    maps["by this calibration, fitted without the press"] = result.after.depth
    for words, depths in maps.items():
        images = [depth_image(depths[i].numpy()) for i in chosen]
        rows.append(figure(images, f"depth {words}", f"depth of a press, {words}", _SHOWN))
    text = "Each map is brightest at its own deepest place."
    return Section("pictures", "Presses", paragraph(text) + Markup().join(rows))
