"""Force by least squares, cross-validated on held-out presses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.calibration.file import Axis
from tactileforge.errors import DataError

#: Number of parts, held out in turn.
_FOLDS = 5
#: Smallest number of frames for a fit, and smallest number of frames per feature.
_LEAST_FRAMES, _PER_FEATURE = 20, 5
#: Relative cut-off of singular values: directions of the features with less variation are noise.
_RCOND = 1e-6
#: Number of features above which several cut-offs are tried, to regularise the fit; the best on
#: held-out presses is taken.
_MANY, _RCONDS = 12, (3e-1, 1e-1, 3e-2, 1e-2)


@dataclass(frozen=True)
class AxisFit:
    """The fit of one axis, and its predictions for held-out frames.

    Attributes:
        axis: Fit to all frames.
        measured: Measured force, float64 (N,), newton.
        predicted: Force predicted by the fit to the other folds, float64 (N,), newton.
        fold: Number of the fold of each frame, int64 (N,).
        before: Force of the uncalibrated model, float64 (N,), newton; None without a model.
    """

    axis: Axis
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    fold: NDArray[np.int64]
    before: NDArray[np.float64] | None = None


def folds(lengths: Sequence[int]) -> NDArray[np.int64]:
    """Assigns each frame to a fold, int64 (N,).

    With enough presses, each is held out as a whole; fewer presses are cut into stretches, so that
    neighbouring frames, which are similar, are held out together.

    Args:
        lengths: Number of frames of each press.
    """
    if len(lengths) >= _FOLDS:
        return np.repeat(np.arange(len(lengths)) % _FOLDS, lengths)
    return np.concatenate([np.arange(n) * _FOLDS // max(n, 1) for n in lengths])


def fit_axis(
    features: Mapping[str, NDArray[np.float64]],
    choices: Sequence[Sequence[str]],
    force: NDArray[np.floating],
    fold: NDArray[np.int64],
    name: str,
    raw: str | None = None,
) -> AxisFit:
    """Fits one axis with the best set of features for held-out frames.

    Args:
        features: Features by name, float64 (N,) each.
        choices: Candidate sets of features, by name.
        force: Force, float (N,), newton; NaN for unknown values.
        fold: Number of the fold of each frame, int64 (N,), see `folds`.
        name: Name of the axis, for messages.
        raw: Name of a feature that is already a force, to report its error beside that of the fit;
            None for none.

    Raises:
        DataError: There are too few forces, or the force does not vary.
    """
    known = np.isfinite(force)
    for values in features.values():
        known &= np.isfinite(values)
    measured, held_out = np.asarray(force, np.float64)[known], fold[known]
    if len(measured) < _LEAST_FRAMES or len(np.unique(held_out)) < 2:
        raise DataError(
            f"force {name}: {len(measured)} frames with a force; give {_LEAST_FRAMES} or more, of "
            "several presses"
        )
    if float(np.ptp(measured)) < 1e-3:
        raise DataError(f"force {name}: it is {measured[0]:.3g} N throughout; press harder")
    best: AxisFit | None = None
    # few features come first: a later set has to lower the error on held-out presses
    for names in _affordable(choices, len(measured)):
        columns = np.stack([features[column][known] for column in names], 1)
        for rcond in _RCONDS if len(names) > _MANY else (_RCOND,):
            candidate = _fit(names, columns, measured, held_out, rcond)
            if best is None or candidate.axis.rmse < best.axis.rmse:
                best = candidate
    assert best is not None
    return best if raw is None else _beside(best, features[raw][known])


def _beside(fitted: AxisFit, raw: NDArray[np.float64]) -> AxisFit:
    error = _short(float(np.sqrt(np.mean((raw - fitted.measured) ** 2))))
    return replace(fitted, axis=replace(fitted.axis, before=error), before=raw)


def _affordable(choices: Sequence[Sequence[str]], frames: int) -> Iterator[Sequence[str]]:
    yield choices[0]
    yield from (names for names in choices[1:] if _PER_FEATURE * len(names) <= frames)


def _fit(
    names: Sequence[str],
    columns: NDArray[np.float64],
    measured: NDArray[np.float64],
    held_out: NDArray[np.int64],
    rcond: float,
) -> AxisFit:
    predicted = np.empty_like(measured)
    for number in np.unique(held_out):
        out = held_out == number
        offset, weights = _solved(columns[~out], measured[~out], rcond)
        predicted[out] = offset + columns[out] @ weights
    offset, weights = _solved(columns, measured, rcond)
    error = predicted - measured
    axis = Axis(
        offset=_short(offset),
        weights={name: _short(weight) for name, weight in zip(names, weights, strict=True)},
        rmse=_short(float(np.sqrt(np.mean(error**2)))),
        r2=_short(float(1 - np.mean(error**2) / np.var(measured))),
        span=[_short(float(measured.min())), _short(float(measured.max()))],
    )
    return AxisFit(axis, measured, predicted, held_out)


def _solved(
    columns: NDArray[np.float64], measured: NDArray[np.float64], rcond: float
) -> tuple[float, NDArray[np.float64]]:
    """Offset and weights of the least squares, on standardised features."""
    middle, scale = columns.mean(0), columns.std(0)
    scale = np.where(scale > 0, scale, 1.0)
    level = float(measured.mean())
    weights, *_ = np.linalg.lstsq((columns - middle) / scale, measured - level, rcond=rcond)
    weights = weights / scale
    return level - float(middle @ weights), weights


def _short(value: float) -> float:
    """Rounds to seven significant digits."""
    return float(f"{value:.7g}")
