"""The scale of a unit, from one axis of the force to another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.sensors import ForceAxis
from tactileforge_live.calibrate.fit import BEFORE, LEAST_RANGE, TIE_BEFORE, AxisFit
from tactileforge_live.calibrate.judged import Frames, short

#: Name in the file of the model's force with the scale of another axis.
SCALED = "scaled"


def share_scale(source: AxisFit, axis: AxisFit, name: str, pressed: bool) -> AxisFit | None:
    """Scales the model's force along one axis by the factor of another axis of the unit.

    The axes of a unit share its gel and its light, and so how many newtons one of the model's
    stands for. On both public trials the factor of the pressed shear axis is 3.3 and 4.1, that of
    the other, pressed ten seconds later, 4.8 and 5.4, and that of the normal force 2.4 and 1.8.

    Args:
        source: Fit of a pressed axis.
        axis: Fit of an axis to scale.
        name: Name of that axis.
        pressed: Whether forces along the axis can judge the factor.

    Returns:
        Fit with the scaled force; its error is that on the frames of the axis, none of which the
        factor was fitted to. None without a model, where the factor does not improve the source on
        blocks of time that it did not see, is below zero (the sign of an axis is its own), or
        worsens a pressed axis; None too for an axis that no force was measured along.
    """
    if source.before is None or axis.before is None or np.ptp(axis.measured) < LEAST_RANGE:
        return None
    known, said = Frames(source.measured, source.fold), source.before

    def factor(use: NDArray[np.bool_]) -> float:
        # through zero: without a touch there is no force
        return float(said[use] @ source.measured[use] / max(float(said[use] @ said[use]), 1e-12))

    outs = [source.fold == number for number in known.blocks]
    predicted = sum((factor(~out) * said * out for out in outs), np.zeros_like(said))
    if not known.better(predicted, said, TIE_BEFORE):
        return None
    scale = short(factor(np.ones(len(said), bool)))
    own, scaled = Frames(axis.measured, axis.fold), scale * axis.before
    if scale <= 0 or (pressed and own.rmse(scaled) >= own.rmse(axis.before)):
        return None
    errors = axis.errors | {SCALED: own.rmse(scaled)}
    found = ForceAxis(
        offset=0.0,
        weights={name: scale},
        rmse=errors[SCALED],
        r2=own.r2(scaled),
        span=[short(float(own.force.min())), short(float(own.force.max()))],
        before=errors[BEFORE],
        chosen=SCALED,
        errors=errors,
    )
    return replace(axis, axis=found, errors=errors, predicted=scaled)
