"""The page of a calibration: errors of the force fits, light and scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from tactileforge.pages import (
    INK,
    Section,
    agreement_figure,
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
from tactileforge.sensors import FORCE_AXES, PICTURE_FEATURES, SHAPE_FEATURES, ForceModel
from tactileforge_live.calibrate.calibrate import CalibrationResult
from tactileforge_live.calibrate.fit import AxisFit
from tactileforge_live.calibrate.scale import SCALED


def calibration_page(result: CalibrationResult) -> str:
    """Builds the page, as HTML."""
    calibration = result.calibration
    title = f"Calibration of {calibration.title}"
    top = paragraph(calibration.made, soft=True) + verdict(("bad", note) for note in result.notes)
    parts = [_force(result)] if calibration.force is not None else []
    parts += [_light(result)] if calibration.light is not None else []
    return html_page(title, top, [*parts, _scale(result)])


def _force(result: CalibrationResult) -> Section:
    force = result.calibration.force
    assert force is not None
    drawn = []
    for name, fit in result.fits.items():
        drawn += [panel(f"Force {name}", _against(fit, name))]
        drawn += [panel(f"Error of {name}", _residual(fit, name))]
    rows = [
        (
            name,
            number(axis.rmse),
            "" if axis.chosen == SCALED else number(axis.r2),
            f"{number(axis.span[0])} to {number(axis.span[1])}",
            str(len(result.fits[name].measured)),
            f"text|{axis.chosen}: {_told(list(axis.weights))}",
        )
        for name, axis in force.axes.items()
    ]
    rest = ("R\N{SUPERSCRIPT TWO}", "range (N)", "frames", "text|fitted to")
    text = "Fitted by ridge regression"
    text += f", images {1000 * force.lag:.0f} ms after forces." if force.lag else "."
    text += " Each frame is predicted by a fit that has not seen its block of time; colours are"
    text += " blocks."
    if any(axis.chosen == SCALED for axis in force.axes.values()):
        text += " A scaled axis is the model's times one factor, fitted to another axis."
    if any(axis.before is not None for axis in force.axes.values()):
        text += " Drawn faintly: the model as it is."
    body = paragraph(text) + table("axes", ("axis", "error (N)", *rest), rows)
    return Section("force", "Force", body + _candidates(force) + panels(drawn, wide=True))


def _candidates(force: ForceModel) -> Markup:
    errors = {name: axis.errors for name, axis in force.axes.items()} | force.left_out
    known = list(dict.fromkeys(name for row in errors.values() for name in row))
    rows = [
        (
            axis,
            *(number(errors[axis][name]) if name in errors[axis] else "" for name in known),
            f"text|{force.axes[axis].chosen if axis in force.axes else 'left out'}",
        )
        for axis in FORCE_AXES
        if axis in errors
    ]
    text = (
        "Error of each candidate on blocks of time that it did not see, N. A simpler one is kept "
        "where a richer one wins less than a quarter or the standard error over blocks. An axis "
        "has no fit where none beats the mean force and the model as it is and explains a fifth "
        "of the variance, or where it was hardly pressed; it takes the scale of another axis "
        "(scaled), or is left out."
    )
    head = ("axis", *known, "text|chosen")
    return paragraph(text) + table("candidates", head, rows)


def _told(names: Sequence[str]) -> str:
    hidden = [name for name in names if name not in (*FORCE_AXES, *PICTURE_FEATURES)]
    shape = [name for name in names if name in SHAPE_FEATURES]
    shown = [name for name in names if name not in hidden and name not in shape]
    counts = {"numbers of the picture's shape": shape, "values of the head": hidden}
    return ", ".join([*shown, *(f"{len(some)} {what}" for what, some in counts.items() if some)])


def _against(fit: AxisFit, name: str) -> Markup:
    groups = [(fit.measured, fit.predicted, fit.fold, 0.6)]
    if fit.before is not None:
        groups.insert(0, (fit.measured, fit.before, np.full_like(fit.fold, -1), 0.2))
    return agreement_figure(groups, (f"measured {name} (N)", f"predicted {name} (N)"))


def _residual(fit: AxisFit, name: str) -> Markup:
    with drawing(4.2, 3.2) as (drawn, axes):
        axes.axhline(0, color=INK, linewidth=0.9)
        draw_points(axes, (fit.measured, fit.predicted - fit.measured, fit.fold, 0.6))
        axes.autoscale_view()
        axes.set(xlabel=f"measured {name} (N)", ylabel="error (N)")
        return svg(drawn, f"error of the force along {name} against the measured force")


def _light(result: CalibrationResult) -> Section:
    calibration = result.calibration
    assert calibration.light is not None
    rows = [
        (name, number(mean), number(factor))
        for name, mean, factor in zip(
            ("red", "green", "blue"),
            calibration.light.colour,
            calibration.light.balance,
            strict=True,
        )
    ]
    shown = Markup()
    if result.still is not None:
        pictures = [result.still, calibration.balanced(result.still)]
        shown = figure(pictures, "background; the same in balanced colours", "background", 2)
    body = table("light-table", ("colour", "mean (grey levels)", "balance"), rows)
    return Section("light", "Light", body + panels([shown]))


def _scale(result: CalibrationResult) -> Section:
    calibration = result.calibration
    height, width = calibration.size
    if calibration.mm_per_pixel is None:
        return Section("scale", "Scale", paragraph(f"mm per pixel: {result.scale}."))
    scale = calibration.mm_per_pixel
    text = (
        f"{scale:.4g} mm per pixel, from {result.scale}: the image of {height} x {width} pixels "
        f"shows {height * scale:.3g} x {width * scale:.3g} mm."
    )
    return Section("scale", "Scale", paragraph(text))
