"""Forces of one unit: candidates to fit, lag of the images, and omitted axes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import DataError
from tactileforge.plugins import Bar
from tactileforge.sensors import (
    BORDER_FEATURES,
    CHANGE_FEATURE,
    FORCE_AXES,
    MOMENT_FEATURES,
    PICTURE_FEATURES,
    SHAPE_FEATURES,
    WITH_MODEL,
    ForceModel,
    ForceReader,
    border_range,
    force_features,
)
from tactileforge_live.calibrate.fit import (
    BEFORE,
    MEAN,
    AxisFit,
    Candidate,
    fit_axis,
    folds,
    hardly_pressed,
)
from tactileforge_live.calibrate.scale import share_scale

#: Step between candidate lags, s: a frame at 60 Hz.
_LAG_STEP = 1 / 60


def fit_forces(
    recordings: Sequence[Recording],
    kind: str,
    wanted: Sequence[str],
    max_lag: float,
    notes: list[str],
    model: ForceReader | None,
) -> tuple[ForceModel, dict[str, AxisFit]]:
    """Fits the forces of a unit; also the fit of each kept axis.

    Args:
        recordings: Recordings of the unit; those without forces are left out.
        kind: Kind of features, see `force_features`.
        wanted: Axes to fit, of ``x``, ``y`` and ``z``, in this order.
        max_lag: Largest delay of images behind forces in the search for it, s; 0 for no search.
        notes: Warnings for the user; a line for each axis without a fit is added.
        model: Model for the kinds ``head`` and ``both``.

    Raises:
        DataError: There are no forces, too few, or none that a candidate explains.
    """
    presses = [recording for recording in recordings if recording.force is not None]
    if not presses:
        raise DataError(
            "no recording has forces: record with force=NAME, or give fit=none to leave them out"
        )
    reading = Bar(presses, desc="read", unit="recording", disable=kind not in WITH_MODEL)
    parts = [force_features(press, kind, model) for press in reading]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    # not to fit to: they tell another light at reading
    around = {name: joined.pop(name) for name in BORDER_FEATURES if name in joined}
    fold = folds([len(press.frames) for press in presses])
    with_model = kind in WITH_MODEL

    def earlier(name: str, lag: float) -> NDArray[np.float64]:
        column = FORCE_AXES.index(name)
        return np.concatenate([_lagged(press, column, lag) for press in presses])

    def fitted(name: str, force: NDArray[np.float64]) -> AxisFit:
        known = candidates(kind, name, joined)
        return fit_axis(joined, known, force, fold, name, name if with_model else None)

    # the lag is fitted on the last wanted axis: the normal force, if it is among them
    lag = 0.0
    if max_lag:
        # a little more, so that rounding does not leave out the last lag
        lags = np.arange(0, max_lag + 1e-9, _LAG_STEP)
        tried = np.stack([earlier(wanted[-1], float(at)) for at in lags])
        tried[:, ~np.isfinite(tried).all(0)] = np.nan  # compare all lags on the same frames
        lowest = [min(fitted(wanted[-1], force).errors.values()) for force in tried]
        lag = float(lags[np.argmin(lowest)])
    fits = {name: fitted(name, earlier(name, lag)) for name in wanted}
    measured = np.concatenate([press.force for press in presses if press.force is not None])
    kept, told = keep_axes(fits, hardly_pressed(measured))
    left_out = {name: fit.errors for name, fit in fits.items() if name not in kept}
    if not kept:
        raise DataError(f"forces do not follow from {kind}: {'; '.join(told)}")
    notes += told
    of = model.fingerprint if with_model and model is not None else ""
    axes = {name: fit.axis for name, fit in kept.items() if fit.axis is not None}
    borders = border_range(around) if around else []
    return ForceModel(kind, round(lag, 4), axes, of, left_out, borders), kept


def keep_axes(
    fits: Mapping[str, AxisFit], unpressed: Sequence[str]
) -> tuple[dict[str, AxisFit], list[str]]:
    """Keeps the axes with a fit; also a line on each of the others.

    A shear axis without a fit takes the scale of the other one, or else of the normal force.

    Args:
        fits: Fit of each axis, by name.
        unpressed: Names of axes that were hardly pressed.
    """
    good = {name: fit for name, fit in fits.items() if fit.axis and name not in unpressed}
    kept, notes = {}, []
    for name, fit in fits.items():
        if name in good:
            kept[name] = fit
            continue
        pressed = name not in unpressed
        for source in good if name != "z" else ():
            scaled = share_scale(good[source], fit, name, pressed)
            if scaled is not None:
                kept[name] = scaled
                notes.append(_scaled(name, source, scaled, pressed))
                break
        else:
            notes.append(_left_out(name, fit, not pressed))
    return kept, notes


def _scaled(name: str, source: str, fit: AxisFit, pressed: bool) -> str:
    assert fit.axis is not None
    why = "no candidate explains it; record more presses"
    if not pressed:
        why = f"its own range is {np.ptp(fit.measured):.2g} N; press along it too"
    return (
        f"force {name} is the model's times {fit.axis.weights[name]:.3g}, the scale of "
        f"{source}: {why}"
    )


def _left_out(name: str, fit: AxisFit, unpressed: bool) -> str:
    if unpressed:
        return (
            f"force {name} is left out: its range is {np.ptp(fit.measured):.2g} N, small beside "
            "that of another axis; press along it too"
        )
    tried = [error for key, error in fit.errors.items() if key not in (MEAN, BEFORE)]
    best = min(tried, default=fit.errors[MEAN])
    known = f"{fit.errors[MEAN]:.3g} N for its mean"
    known += f", {fit.errors[BEFORE]:.3g} N for the model as it is" if BEFORE in fit.errors else ""
    return (
        f"force {name} is left out: the best fit has an error of {best:.3g} N on blocks of time "
        f"that it did not see, against {known}; record more presses, or larger forces"
    )


def candidates(kind: str, axis: str, inputs: Collection[str]) -> list[Candidate]:
    """Candidates to fit an axis to, the simplest first.

    Arrays and tracks get a scale and an offset. ``change`` is the mean change of the picture,
    ``pictures`` all of `pictures.PICTURES`; ``head`` is the model's force along the axis, its
    forces along all three, or also what its last layer reads; ``both`` are pictures and forces.

    Args:
        kind: Kind of features, see `force_features`.
        axis: ``x``, ``y`` or ``z``.
        inputs: Names of all inputs.
    """
    change = Candidate("change", [[CHANGE_FEATURE]])
    pictures = [[CHANGE_FEATURE], *([name] for name in MOMENT_FEATURES), SHAPE_FEATURES]
    if kind == "pictures":
        return [change, Candidate("pictures", pictures)]
    if kind not in WITH_MODEL:
        return [Candidate(kind, [[axis]])]
    forces = [[name] for name in FORCE_AXES]
    hidden = [name for name in inputs if name not in (*FORCE_AXES, *PICTURE_FEATURES)]
    head = [Candidate("head", [[axis]]), Candidate("head", forces)]
    wide = [Candidate("head", [*forces, hidden])] if hidden else []
    if kind == "head":
        return [*head, *wide]
    both = [Candidate("pictures", pictures), Candidate("both", [*forces, *pictures])]
    return [change, *head, *both, *wide]


def _lagged(recording: Recording, column: int, lag: float) -> NDArray[np.float64]:
    """One axis of the force, ``lag`` seconds before each frame; NaN for unknown values."""
    assert recording.force is not None
    force = recording.force[:, column].astype(np.float64)
    if lag == 0:
        return force
    known, before = np.isfinite(force), recording.times - lag
    out = np.interp(before, recording.times, np.where(known, force, 0.0))
    # 1 where the force is known on both sides of the moment
    share = np.interp(before, recording.times, known.astype(float), left=0.0)
    return np.where(share < 1 - 1e-9, np.nan, out)
