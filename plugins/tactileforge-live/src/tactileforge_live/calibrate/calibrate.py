"""A calibration from recordings of one unit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError, DataError, check_names
from tactileforge.sensors import (
    FORCE_AXES,
    WITH_MODEL,
    BackgroundLight,
    Calibration,
    ForceModel,
    ForceReader,
    frame_chunks,
    median_background,
)
from tactileforge.specs import spec
from tactileforge_live.calibrate.fit import AxisFit
from tactileforge_live.calibrate.force import fit_forces
from tactileforge_live.calibrate.light import estimate_light, light_drift, punch_mm_per_pixel
from tactileforge_live.calibrate.unit import recordings_of_unit


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions:
    """Keys of ``tactileforge calibrate``, except those of data and files.

    Attributes:
        device: Sensor, for data of several: the label ``device``, or the type; None for any.
        unit: Unit of the sensor, by the label ``unit``; None for any.
        fit: Features for the forces: ``auto``, ``none``, ``pictures``, ``taxels``, ``head``,
            ``both`` (pictures and head), or the name of a track.
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
    axes: Sequence[str] = FORCE_AXES
    max_lag: float = 0.0
    punch_mm: float | None = None
    mm_per_pixel: float | None = None
    frames: int = 5000

    def __post_init__(self) -> None:
        check_names("axis", self.axes, FORCE_AXES)
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
        fits: Fit of each kept axis, by name.
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
    model: ForceReader | None = None,
) -> CalibrationResult:
    """Calibrates one unit.

    Args:
        recordings: Recordings of the unit; those of others are left out by ``device`` and ``unit``.
        options: Options of the calibration.
        reference: Calibration of another unit, with the colours to balance to; see
            `light.estimate_light`.
        model: Model for the fits ``head`` and ``both``; see `force.candidates`.

    Raises:
        ConfigError: The recordings are of several units, or the options do not fit them.
        DataError: The recordings lack needed data; says which.
    """
    chosen = recordings_of_unit(recordings, options.device, options.unit, options.frames)
    first = chosen[0]
    notes: list[str] = []
    sizes = {recording.frames.shape for recording in chosen}
    # the scale is in mm per pixel, so pictures of two sizes have two
    if len(sizes) > 1:
        shapes = " and ".join(f"{h} x {w}" for h, w in sorted(sizes))
        raise DataError(f"frames of {shapes} pixels: calibrate recordings of one size")
    # light, scale and force are fitted independently: a recording may tell only one of them
    kind = _kind(first, chosen, options, model)
    shines, still = _light(chosen, reference, notes)
    scale, source = _scale(chosen, options)
    force: ForceModel | None = None
    fits: dict[str, AxisFit] = {}
    if kind != "none":
        wanted = [name for name in FORCE_AXES if name in options.axes]
        force, fits = fit_forces(chosen, kind, wanted, options.max_lag, notes, model)
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


def _kind(
    first: Recording,
    chosen: Sequence[Recording],
    options: CalibrateOptions,
    model: ForceReader | None,
) -> str:
    if (options.fit in WITH_MODEL) > (model is not None):
        raise ConfigError(f"fit={options.fit} needs a model: give model=NAME")
    if options.fit != "auto":
        return options.fit
    if all(recording.force is None for recording in chosen):
        return "none"
    if model is not None:
        return "both"
    return "taxels" if spec(first.sensor).kind == "array" else "pictures"


def _light(
    chosen: Sequence[Recording], reference: Calibration | None, notes: list[str]
) -> tuple[BackgroundLight | None, NDArray[np.uint8] | None]:
    if spec(chosen[0].sensor).kind == "array":
        return None, None
    stills = [
        median_background(recording) for recording in chosen if recording.no_contact is not None
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
    # a background with a touch in it does not count
    still = np.median(np.stack(stills), axis=0)
    return unit_light, np.rint(still).clip(0, 255).astype(np.uint8)


def _scale(chosen: Sequence[Recording], options: CalibrateOptions) -> tuple[float | None, str]:
    if options.mm_per_pixel is not None:
        return options.mm_per_pixel, "given"
    if options.punch_mm is not None:
        # presses of a series that are not named so are all taken for the punch's
        punched = [recording for recording in chosen if recording.object == "punch"] or chosen
        scales = [
            punch_mm_per_pixel(
                (frame for part in frame_chunks(press.frames) for frame in part),
                median_background(press),
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
