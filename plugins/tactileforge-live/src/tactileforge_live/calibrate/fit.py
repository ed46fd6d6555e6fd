"""Force by ridge regression in closed form, judged on held-out blocks of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.sensors import FORCE_AXES, ForceAxis
from tactileforge_live.calibrate.judged import Frames, short

#: Number of blocks of time, held out in turn, and fewest of them to choose a penalty.
_FOLDS, _LEAST_FOLDS = 5, 3
#: Smallest number of frames for a fit.
_LEAST_FRAMES = 12
#: Penalties on squared weights of inputs whose groups have variance 1, largest first.
_PENALTIES = (1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4, 1e-6)
#: Errors within this factor of a simpler candidate's are a tie. Blocks of one trial are more alike
#: than presses to come: on a public trial, a fit to all of the picture won by a fifth over the mean
#: change on blocks of ten seconds, and was three times worse in the thirteen seconds after.
_TIE = 0.75
#: The same for the model without a calibration: a calibration is wanted.
TIE_BEFORE = 0.98
#: Smallest share of explained variance of an accepted fit.
_LEAST_R2 = 0.2
#: Smallest range of a force for a fit, N, and as a share of the largest range of an axis: of less,
#: a fit says little about forces like those along the other axes.
LEAST_RANGE, _LEAST_SHARE = 1e-3, 0.15
#: Names of two baselines: the mean force, and the model without a calibration.
MEAN, BEFORE = "mean", "as it is"


@dataclass(frozen=True)
class Candidate:
    """Inputs to fit a force to.

    Attributes:
        name: Name in the file and on the page; the best of several with one name stands for it.
        groups: Names of inputs, in groups; each is scaled to a variance of 1.
    """

    name: str
    groups: Sequence[Sequence[str]]

    @property
    def inputs(self) -> list[str]:
        """Names of all inputs."""
        return [name for group in self.groups for name in group]


@dataclass(frozen=True)
class AxisFit:
    """The fit of one axis, and its predictions for held-out frames.

    Attributes:
        axis: Fit to all frames; None if nothing is won: no candidate beats the mean force and the
            model as it is, or the best explains less than a fifth of the variance.
        errors: Held-out root mean square error of each candidate, of the mean force (``mean``) and
            of the model without a calibration (``as it is``), N.
        measured: Measured force, float64 (N,), newton.
        predicted: Force predicted by the best fit to the other folds, float64 (N,), newton.
        fold: Number of the fold of each frame, int64 (N,).
        before: Force of the uncalibrated model, float64 (N,), newton; None without a model.
    """

    axis: ForceAxis | None
    errors: dict[str, float]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    fold: NDArray[np.int64]
    before: NDArray[np.float64] | None = None


def folds(lengths: Sequence[int]) -> NDArray[np.int64]:
    """Assigns each frame to a fold, int64 (N,).

    With enough presses, each is held out as a whole; fewer presses are cut into blocks of time, so
    that neighbouring frames, which are similar, are held out together.

    Args:
        lengths: Number of frames of each press.
    """
    if len(lengths) >= _FOLDS:
        return np.repeat(np.arange(len(lengths)) % _FOLDS, lengths)
    return np.concatenate([np.arange(n) * _FOLDS // max(n, 1) for n in lengths])


def hardly_pressed(forces: NDArray[np.floating]) -> list[str]:
    """Names of axes with a force of hardly any variation, beside the axis of the largest.

    Args:
        forces: Forces, float (N, 3), newton; NaN for unknown values.
    """
    known = [column[np.isfinite(column)] for column in forces.T]
    ranges = [float(np.ptp(column)) if len(column) else 0.0 for column in known]
    least = max(LEAST_RANGE, _LEAST_SHARE * max(ranges))
    return [name for name, size in zip(FORCE_AXES, ranges, strict=True) if size < least]


def fit_axis(
    inputs: Mapping[str, NDArray[np.float64]],
    candidates: Sequence[Candidate],
    force: NDArray[np.floating],
    fold: NDArray[np.int64],
    name: str,
    raw: str | None = None,
) -> AxisFit:
    """Fits one axis with the candidate of the lowest error on held-out blocks of time.

    A candidate replaces a simpler one if its error is lower by more than a tie: by a quarter, and
    by more than the standard error over blocks of the difference of squared errors.

    Args:
        inputs: Inputs by name, float64 (N,) each.
        candidates: Candidates, the simplest first.
        force: Force, float (N,), newton; NaN for unknown values.
        fold: Number of the fold of each frame, int64 (N,), see `folds`.
        name: Name of the axis, for messages.
        raw: Name of an input that is already a force, to compare with; None for none.

    Raises:
        DataError: There are too few forces.
    """
    known = _known(inputs, force, fold, name)
    # the mean force of the other blocks: what a fit has to beat
    level = np.empty_like(known.force)
    for number in known.blocks:
        out = known.fold == number
        level[out] = known.force[~out].mean()
    before = None if raw is None else known.inputs[raw]
    errors = {MEAN: known.rmse(level)}
    best: tuple[Candidate, NDArray[np.float64]] | None = None
    if float(np.ptp(known.force)) >= LEAST_RANGE:
        for candidate in candidates:
            predicted = _held_out(known, candidate)
            error = known.rmse(predicted)
            errors[candidate.name] = min(error, errors.get(candidate.name, error))
            enough = known.r2(predicted) >= _LEAST_R2 and known.better(predicted, level, 1)
            if enough and (best is None or known.better(predicted, best[1], _TIE)):
                best = candidate, predicted
    if before is not None:
        errors[BEFORE] = known.rmse(before)
        if best is not None and not known.better(best[1], before, TIE_BEFORE):
            best = None
    axis = None if best is None else _axis(known, *best, errors, raw)
    predicted = level if best is None else best[1]
    return AxisFit(axis, errors, known.force, predicted, known.fold, before)


def _known(
    inputs: Mapping[str, NDArray[np.float64]],
    force: NDArray[np.floating],
    fold: NDArray[np.int64],
    name: str,
) -> Frames:
    known = np.isfinite(force)
    for values in inputs.values():
        known &= np.isfinite(values)
    measured = np.asarray(force, np.float64)[known]
    if len(measured) < _LEAST_FRAMES or len(np.unique(fold[known])) < _LEAST_FOLDS:
        raise DataError(
            f"force {name}: {len(measured)} frames with a force; give {_LEAST_FRAMES} or more, "
            "spread over a ramp or several presses"
        )
    return Frames(measured, fold[known], {key: values[known] for key, values in inputs.items()})


def _held_out(known: Frames, candidate: Candidate) -> NDArray[np.float64]:
    """Predictions of each block by a fit to the others, float64 (N,).

    The penalty of a fit is chosen by its own blocks, so the held-out one has no say in it.
    """
    columns, predicted = known.columns(candidate.inputs), np.empty_like(known.force)
    for number in known.blocks:
        out = known.fold == number
        offset, weights = _chosen(candidate, columns[~out], known.force[~out], known.fold[~out])
        predicted[out] = offset + columns[out] @ weights
    return predicted


def _chosen(
    candidate: Candidate,
    columns: NDArray[np.float64],
    force: NDArray[np.float64],
    fold: NDArray[np.int64],
) -> tuple[float, NDArray[np.float64]]:
    """Offset and weights with the best penalty for the prediction of blocks of these frames."""
    loss = np.zeros(len(_PENALTIES))
    for number in np.unique(fold):
        out = fold == number
        for place, (offset, weights) in enumerate(_path(candidate, columns[~out], force[~out])):
            loss[place] += ((offset + columns[out] @ weights - force[out]) ** 2).sum()
    return _path(candidate, columns, force)[int(loss.argmin())]


def _path(
    candidate: Candidate, columns: NDArray[np.float64], force: NDArray[np.float64]
) -> list[tuple[float, NDArray[np.float64]]]:
    """Offset and weights of ridge regression at each penalty, in closed form."""
    ends = np.cumsum([len(group) for group in candidate.groups])[:-1]
    spreads = [np.sqrt(part.var(0).sum()) for part in np.split(columns, ends, 1)]
    sizes = [len(group) for group in candidate.groups]
    # a group has variance 1 as a whole: many inputs weigh no more than a few
    factor = np.repeat([1 / spread if spread > 0 else 0.0 for spread in spreads], sizes)
    middle, level = columns.mean(0), float(force.mean())
    scaled = (columns - middle) * factor
    # one decomposition for all penalties
    values, axes = np.linalg.eigh(scaled.T @ scaled)
    along = axes.T @ (scaled.T @ (force - level))
    found = []
    for penalty in _PENALTIES:
        weights = axes @ (along / (values.clip(min=0) + penalty * len(force))) * factor
        found.append((level - float(middle @ weights), weights))
    return found


def _axis(
    known: Frames,
    candidate: Candidate,
    predicted: NDArray[np.float64],
    errors: dict[str, float],
    raw: str | None,
) -> ForceAxis:
    names = candidate.inputs
    offset, weights = _chosen(candidate, known.columns(names), known.force, known.fold)
    return ForceAxis(
        offset=short(offset),
        weights={name: short(weight) for name, weight in zip(names, weights, strict=True)},
        rmse=known.rmse(predicted),
        r2=known.r2(predicted),
        span=[short(float(known.force.min())), short(float(known.force.max()))],
        before=errors[BEFORE] if raw is not None else None,
        chosen=candidate.name,
        errors=errors,
    )
