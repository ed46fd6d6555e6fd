"""An optical calibration of one unit, for depth, from presses of a ball."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from tactileforge_depth.fit import fit_optics, save_optics
from tactileforge_depth.inverse import SurfaceReader
from tactileforge_depth.lighting import OpticalCalibration, load_optics
from tactileforge_depth.presses import Presses, find_circle
from torch import Tensor

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError, DataError
from tactileforge.sensors import frame_chunks, median_background
from tactileforge.specs import simulation, spec
from tactileforge_live.calibrate.depth_options import DepthOptions
from tactileforge_live.calibrate.unit import recordings_of_unit

#: Labels of a circle: its centre and radius, pixels of the recording's frames.
CIRCLE = ("center_x_px", "center_y_px", "radius_px")
#: Fewest presses. Four parts are held out in turn, and the rest has to cover the gel.
FEWEST = 8
#: Parts held out in turn.
_PARTS = 4
#: Penalties of the fit, of which the best on held-out presses is taken: of five public units, two
#: are read best with the first, two with the second and one with the third.
_RIDGES = (1e-4, 1e-5, 1e-6)
#: Rows of the pictures of a fit, and of the surfaces that are compared. Half the rows of a DIGIT's
#: pictures gave no worse depths (31 presses) in a quarter of the time.
_FIT_ROWS, _ROWS = 160, 120
#: Change of a pixel that counts as contact, grey levels; as in `light`.
_LEAST = 3.0


@dataclass(frozen=True)
class DepthFit:
    """Depths of held-out presses, as one calibration reads them.

    Attributes:
        depth: float32 (N, h, w), mm, in the order of the presses.
        correlation: float64 (N,), correlation of each press with the surface around the ball.
        error: float64 (N,), root mean square error of each press, mm.
    """

    depth: Tensor
    correlation: NDArray[np.float64]
    error: NDArray[np.float64]


@dataclass(frozen=True)
class DepthCalibration:
    """An optical calibration of a unit, and the evidence for it.

    Attributes:
        optics: Calibration fitted to all presses.
        sensor: Name of the sensor type.
        presses: Presses behind it.
        truth: float32 (N, h, w), depth around the ball by contact mechanics, mm.
        after: Depths by calibrations without the part of the press that is read.
        before: Depths by the shipped calibration of the type; None without one.
        notes: Warnings for the user, one line each.
    """

    optics: OpticalCalibration
    sensor: str
    presses: Presses
    truth: Tensor
    after: DepthFit
    before: DepthFit | None
    notes: list[str]

    def save(self, path: Path) -> None:
        """Writes the calibration, for `depth.DepthReader`."""
        ball = f"{2 * self.presses.ball:g} mm ball"
        save_optics(self.optics, path, f"{len(self.presses)} presses of a {ball} on {self.sensor}")


def calibrate_depth(recordings: Iterable[Recording], options: DepthOptions) -> DepthCalibration:
    """Fits the optical calibration of one unit to presses of a ball.

    Each recording is one press, of which the frame with the largest change is taken. Its circle of
    contact is in the labels ``center_x_px``, ``center_y_px`` and ``radius_px``, or is found in the
    picture where a recording has none. The calibration is judged on presses left out of its fit,
    a quarter of them at a time; they also choose the penalty of the fit, of three.

    Args:
        recordings: Recordings of presses of one unit, with backgrounds.
        options: Options of the fit.

    Raises:
        ConfigError: The recordings are of several units, or the sensor's sensing area or gel is
            unknown and not given.
        DataError: There are too few presses, pictures of several sizes, a press without contact or
            background, or a circle outside the picture.
    """
    chosen = recordings_of_unit(recordings, options.device, options.unit)
    if len(chosen) < FEWEST:
        raise DataError(
            f"{len(chosen)} presses: press the ball at least {FEWEST} times, all over the gel; "
            "each recording is one press"
        )
    sizes = {one.frames.shape for one in chosen}
    if len(sizes) > 1:
        told = " and ".join(f"{height} x {width}" for height, width in sorted(sizes))
        raise DataError(f"pictures of {told} pixels: calibrate presses of one size")
    notes: list[str] = []
    presses = _presses(chosen, options, notes)
    truth = _shrunk(torch.stack([presses.dent(number) for number in range(len(presses))]))[:, 0]
    fits = {ridge: _judged(_held_out(presses, ridge), truth) for ridge in _RIDGES}
    # by presses that a fit has not seen
    ridge = min(fits, key=lambda each: float(fits[each].error.mean()))
    after = fits[ridge]
    before = None
    if shipped := _shipped(chosen[0].sensor):
        before = _judged(_depths(load_optics(shipped), presses), truth)
        if before.error.mean() <= after.error.mean():
            notes.append(
                f"the shipped calibration {shipped} reads these presses no worse: mark the circles "
                "more exactly, or press more places"
            )
    sensor = chosen[0].sensor
    optics = fit_optics(presses, ridge)
    return DepthCalibration(optics, sensor, presses, truth, after, before, notes)


def _held_out(presses: Presses, ridge: float) -> Tensor:
    """Depths of all presses, each by a calibration without its part."""
    parts = torch.arange(len(presses)) % _PARTS
    found = torch.empty(len(presses), *_small(presses.size))
    for part in range(_PARTS):
        rest = fit_optics(_some(presses, parts != part), ridge)
        found[parts == part] = _depths(rest, _some(presses, parts == part))
    return found


def _presses(chosen: Sequence[Recording], options: DepthOptions, notes: list[str]) -> Presses:
    stills = [median_background(one) for one in chosen]
    still = np.median(np.stack(stills), axis=0)
    # each press keeps its own change from its own background
    shown = [_deepest(one, rest) + still - rest for one, rest in zip(chosen, stills, strict=True)]
    pictures = torch.from_numpy(np.stack(shown).round().clip(0, 255).astype(np.uint8))
    pictures = pictures.movedim(-1, 1).contiguous()
    background = torch.from_numpy(still.astype(np.float32)).movedim(-1, 0).contiguous()
    circles, guessed = [], 0
    for one, picture in zip(chosen, pictures, strict=True):
        given = [one.labels.get(name) for name in CIRCLE]
        guessed += None in given
        circles.append(find_circle(picture, background) if None in given else _circle(one, given))
    if guessed:
        notes.append(
            f"the circles of {guessed} presses are found in the pictures, which is an estimate: "
            f"mark them, as labels {', '.join(CIRCLE)}"
        )
    factor = min(1.0, _FIT_ROWS / len(still))
    return Presses(
        background=_shrunk(background[None], _FIT_ROWS)[0],
        pictures=_shrunk(pictures, _FIT_ROWS).round().byte(),
        # circles are in pixels of the recordings
        circles=factor * torch.tensor(circles),
        spacing=(options.mm_per_pixel or _spacing(chosen[0])) / factor,
        ball=options.ball_mm / 2,
        thickness=options.gel_mm or _thickness(chosen[0].sensor),
        share=options.circle_share,
        steepest=options.steepest,
        shadows=options.shadows,
    )


def _deepest(recording: Recording, rest: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The frame with the largest change from the background."""
    frames = (frame for part in frame_chunks(recording.frames) for frame in part)
    deepest: NDArray[np.uint8] = max(frames, key=lambda frame: float(np.abs(frame - rest).mean()))
    if float(np.abs(deepest - rest).max()) < _LEAST:
        raise DataError(f"{recording.key}: no frame shows contact; leave the recording out")
    return deepest


def _circle(recording: Recording, given: Sequence[object]) -> tuple[float, float, float]:
    height, width = recording.frames.shape
    try:
        x, y, radius = (float(str(value)) for value in given)
    except ValueError as error:
        raise DataError(f"{recording.key}: {', '.join(CIRCLE)}: {error}") from error
    if not (0 <= x < width and 0 <= y < height and 0 < radius < max(height, width)):
        raise DataError(
            f"{recording.key}: a circle of radius {radius:g} around {x:g}, {y:g} is not in a "
            f"picture of {width} x {height} pixels"
        )
    return x, y, radius


def _spacing(recording: Recording) -> float:
    area = spec(recording.sensor).area_mm
    if area is None:
        raise ConfigError(f"sensing area of {recording.sensor} unknown: give mm_per_pixel=")
    return area[0] / recording.frames.shape[0]


def _thickness(sensor: str) -> float:
    try:
        return simulation(sensor).thickness
    except ConfigError as error:
        raise ConfigError(f"gel of {sensor} unknown: give gel_mm=") from error


def _shipped(sensor: str) -> str | None:
    try:
        names = simulation(sensor).calibrations
    except ConfigError:
        return None
    return names[0] if names else None


def _some(presses: Presses, chosen: Tensor) -> Presses:
    return replace(presses, pictures=presses.pictures[chosen], circles=presses.circles[chosen])


def _small(size: tuple[int, int], rows: int = _ROWS) -> tuple[int, int]:
    height, width = size
    rows = min(rows, height)
    return rows, round(width * rows / height)


def _shrunk(pictures: Tensor, rows: int = _ROWS) -> Tensor:
    size = _small((pictures.shape[-2], pictures.shape[-1]), rows)
    return F.interpolate(pictures.float(), size, mode="area")


def _depths(optics: OpticalCalibration, presses: Presses) -> Tensor:
    pictures = _shrunk(presses.pictures)
    size = pictures.shape[-2], pictures.shape[-1]
    reader = SurfaceReader(optics, size, presses.spacing * presses.size[0] / size[0])
    return reader.read(pictures, _shrunk(presses.background[None])[0]).depth


def _judged(found: Tensor, truth: Tensor) -> DepthFit:
    pairs = torch.stack([found.flatten(1), truth.flatten(1)], 1)
    correlation = np.array([float(torch.corrcoef(pair)[0, 1]) for pair in pairs])
    error = (found - truth).square().mean((1, 2)).sqrt().double().numpy()
    return DepthFit(found, correlation, error)
