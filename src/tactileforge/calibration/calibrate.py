"""A calibration from recordings of one unit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.calibration import features
from tactileforge.calibration.file import AXES, Calibration, ForceModel, Light
from tactileforge.calibration.fit import AxisFit, fit_axis, folds
from tactileforge.calibration.light import estimate_light, light_drift, punch_mm_per_pixel
from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.sensors.specs import spec

#: Step between candidate lags, s.
_LAG_STEP = 1 / 60
#: Smallest share of explained variance of an accepted fit.
_LEAST_R2 = 0.2


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions:
    """Keys of ``tactileforge calibrate``, except those of data and files.

    Attributes:
        device: Sensor, for data of several: the label ``device``, or the type; None for any.
        unit: Unit of the sensor, by the label ``unit``; None for any.
        fit: Features for the forces: ``auto``, ``none``, ``pictures``, ``taxels``, ``head``, or the
            name of a track.
        axes: Axes of the force to fit, of x, y and z.
        max_lag: Largest delay of images behind forces in the search for it, 0 to 1 s; 0 for no
            search.
        punch_mm: Diameter of a flat round punch, mm, pressed in the recordings with the ``object``
            ``punch``, or in all if there are no such recordings; None for no punch.
        mm_per_pixel: Scale of the images, mm per pixel; None if it is not known.
        frames: Number of frames after which no more recordings are read.
    """

    device: str | None = None
    unit: str | None = None
    fit: str = "auto"
    axes: Sequence[str] = AXES
    max_lag: float = 0.0
    punch_mm: float | None = None
    mm_per_pixel: float | None = None
    frames: int = 5000

    def __post_init__(self) -> None:
        for name in self.axes:
            if name not in AXES:
                raise ConfigError(unknown("axis", name, AXES))
        if not self.axes:
            raise ConfigError("axes=[]: give some of x, y, z")
        if not 0 <= self.max_lag <= 1:
            raise ConfigError(f"max_lag={self.max_lag}: give 0 to 1 s")
        for name in ("punch_mm", "mm_per_pixel", "frames"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ConfigError(f"{name}={value}: give a value above 0")
        if self.punch_mm is not None and self.mm_per_pixel is not None:
            raise ConfigError("punch_mm and mm_per_pixel both set the scale: give one of them")


@dataclass(frozen=True)
class CalibrationResult:
    """A calibration, and the fits and images behind it.

    Attributes:
        calibration: Content of the file.
        fits: Fit of each axis, by name.
        still: Background, uint8 (H, W, 3); None for an array of taxels.
        scale: Source of the scale, in words.
        notes: Warnings for the user, one line each.
    """

    calibration: Calibration
    fits: dict[str, AxisFit]
    still: NDArray[np.uint8] | None
    scale: str
    notes: list[str]


def calibrate(
    recordings: Iterable[Recording],
    options: CalibrateOptions,
    reference: Calibration | None = None,
    model: features.ForceReader | None = None,
) -> CalibrationResult:
    """Calibrates one unit.

    Args:
        recordings: Recordings of the unit; those of others are left out by ``device`` and ``unit``.
        options: Options of the calibration.
        reference: Calibration of another unit, with the colours to balance to; see
            `light.estimate_light`.
        model: Model for the fit ``head``. The features are its force along one axis (a gain and an
            offset), its forces along all three, or the inputs of the last layer of its head,
            whichever predicts held-out presses best.

    Raises:
        ConfigError: The recordings are of several units, or the options do not fit them.
        DataError: The recordings lack needed data; says which.
    """
    chosen = _chosen(recordings, options)
    first = chosen[0]
    notes: list[str] = []
    sizes = {recording.frames.shape for recording in chosen}
    if len(sizes) > 1:
        shapes = " and ".join(f"{h} x {w}" for h, w in sorted(sizes))
        raise DataError(f"frames of {shapes} pixels: calibrate recordings of one size")
    # light, scale and force are fitted independently: a recording may tell only one of them
    kind = _kind(first, chosen, options, model)
    shines, still = _light(chosen, reference, notes)
    scale, source = _scale(chosen, options)
    force, fits = _force(chosen, kind, options, notes, model) if kind != "none" else (None, {})
    calibration = Calibration(
        sensor=first.sensor,
        unit=str(first.labels.get("unit", "")),
        made=f"{datetime.now(UTC):%Y-%m-%d} from {len(chosen)} recordings, {first.key} and on",
        light=shines,
        mm_per_pixel=scale,
        size=list(first.frames.shape),
        force=force,
    )
    return CalibrationResult(calibration, fits, still, source, notes)


def _chosen(recordings: Iterable[Recording], options: CalibrateOptions) -> list[Recording]:
    chosen: list[Recording] = []
    others: set[str] = set()
    for recording in recordings:
        names = {recording.sensor, str(recording.labels.get("device", recording.sensor))}
        unit = str(recording.labels.get("unit", ""))
        if options.device not in (None, *names) or options.unit not in (None, unit):
            others |= {*names, unit} - {""}
            continue
        chosen.append(recording)
        if sum(len(each.frames) for each in chosen) >= options.frames:
            break
    if not chosen:
        wanted = options.unit or options.device or ""
        if wanted:
            raise ConfigError(unknown("device or unit", wanted, others))
        raise DataError("there are no recordings: record a series of presses first")
    units = {
        f"{item.labels.get('device', item.sensor)} {item.labels.get('unit', '')}".strip()
        for item in chosen
    }
    if len(units) > 1:
        raise ConfigError(
            f"recordings of {', '.join(sorted(units))}: a calibration belongs to a single unit; "
            "choose it with device=NAME or unit=NAME"
        )
    return chosen


def _kind(
    first: Recording,
    chosen: Sequence[Recording],
    options: CalibrateOptions,
    model: features.ForceReader | None,
) -> str:
    if (options.fit == "head") > (model is not None):
        raise ConfigError("fit=head needs a model: give model=NAME")
    if options.fit != "auto":
        return options.fit
    if all(recording.force is None for recording in chosen):
        return "none"
    if model is not None:
        return "head"
    return "taxels" if spec(first.sensor).kind == "array" else "pictures"


def _light(
    chosen: Sequence[Recording], reference: Calibration | None, notes: list[str]
) -> tuple[Light | None, NDArray[np.uint8] | None]:
    if spec(chosen[0].sensor).kind == "array":
        return None, None
    stills = [
        features.median_background(recording)
        for recording in chosen
        if recording.no_contact is not None
    ]
    if not stills:
        notes.append("no recording has a frame without contact: the light is not calibrated")
        return None, None
    unit_light = estimate_light(stills, None if reference is None else reference.light)
    worst = max(light_drift(still, unit_light) for still in stills)
    if worst > 10:
        notes.append(
            f"backgrounds differ by up to {worst:.0f} grey levels: the gel or its light has changed"
        )
    still = np.median(np.stack(stills), axis=0)
    return unit_light, np.rint(still).clip(0, 255).astype(np.uint8)


def _scale(chosen: Sequence[Recording], options: CalibrateOptions) -> tuple[float | None, str]:
    if options.mm_per_pixel is not None:
        return options.mm_per_pixel, "given"
    if options.punch_mm is not None:
        punched = [recording for recording in chosen if recording.object == "punch"] or chosen
        scales = [
            punch_mm_per_pixel(
                (frame for part in features.chunks(press.frames) for frame in part),
                features.median_background(press),
                options.punch_mm,
                press.key,
            )
            for press in punched[:20]
        ]
        spread = 100 * float(np.std(scales) / np.mean(scales))
        summary = f"{len(scales)} presses of a {options.punch_mm:g} mm punch, which differ by "
        return round(float(np.median(scales)), 6), f"{summary}{spread:.1f} %"
    known = spec(chosen[0].sensor)
    if known.area_mm is None:
        return None, "not known: give punch_mm or mm_per_pixel"
    return round(known.area_mm[0] / chosen[0].frames.shape[0], 6), "the area of the sensor's type"


def _force(
    chosen: Sequence[Recording],
    kind: str,
    options: CalibrateOptions,
    notes: list[str],
    model: features.ForceReader | None,
) -> tuple[ForceModel, dict[str, AxisFit]]:
    presses = [recording for recording in chosen if recording.force is not None]
    if not presses:
        raise DataError(
            "no recording has forces: record with force=NAME, or give fit=none to leave them out"
        )
    noise = max(features.noise_threshold(press) for press in presses) if kind == "pictures" else 0.0
    parts = [features.force_features(press, kind, noise, model) for press in presses]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    fold = folds([len(press.frames) for press in presses])

    def earlier(name: str, lag: float) -> NDArray[np.float64]:
        column = AXES.index(name)
        return np.concatenate([_lagged(press, column, lag) for press in presses])

    def fitted(name: str, force: NDArray[np.float64]) -> AxisFit:
        raw = name if kind == "head" else None
        return fit_axis(joined, _choices(kind, name, joined), force, fold, name, raw)

    # the lag is fitted on the last wanted axis: the normal force, if it is among them
    wanted = [name for name in AXES if name in options.axes]
    lag = 0.0
    if options.max_lag:
        lags = np.arange(0, options.max_lag + 1e-9, _LAG_STEP)
        tried = np.stack([earlier(wanted[-1], float(at)) for at in lags])
        tried[:, ~np.isfinite(tried).all(0)] = np.nan  # compare all lags on the same frames
        lag = float(lags[np.argmin([fitted(wanted[-1], force).axis.rmse for force in tried])])
    fits = {name: fitted(name, earlier(name, lag)) for name in wanted}
    for name in wanted:
        if (share := fits[name].axis.r2) < _LEAST_R2:
            notes.append(
                f"force {name} is left out: its fit explains {100 * max(share, 0):.0f} % of "
                "presses that it did not see; record more of them, or larger forces"
            )
            del fits[name]
    if not fits:
        raise DataError(f"forces do not follow from {kind}: {'; '.join(notes)}")
    axes = {name: fit_of_axis.axis for name, fit_of_axis in fits.items()}
    of = model.fingerprint if kind == "head" and model is not None else ""
    return ForceModel(kind, noise, round(lag, 4), axes, of), fits


def _choices(kind: str, axis: str, columns: Mapping[str, Any]) -> list[Sequence[str]]:
    """Candidate features of an axis; arrays and tracks get only scale and offset."""
    if kind == "head":
        hidden = [column for column in columns if column not in AXES]
        return [[axis], list(AXES), *([[*AXES, *hidden]] if hidden else [])]
    return [features.NORMAL, list(columns)] if kind == "pictures" else [[axis]]


def _lagged(recording: Recording, column: int, lag: float) -> NDArray[np.float64]:
    """One axis of the force, ``lag`` seconds before each frame; NaN for unknown values."""
    assert recording.force is not None
    force = recording.force[:, column].astype(np.float64)
    if lag == 0:
        return force
    known, before = np.isfinite(force), recording.times - lag
    out = np.interp(before, recording.times, np.where(known, force, 0.0))
    share = np.interp(before, recording.times, known.astype(float), left=0.0)
    return np.where(share < 1 - 1e-9, np.nan, out)
