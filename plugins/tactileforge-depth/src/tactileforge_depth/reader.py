"""Depth from touch: normals and height maps of a gel, from pictures of a calibrated sensor."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.contracts import Sensor, SensorSpec
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, home_path, unknown
from tactileforge.sensors import (
    TROUBLES,
    LightCheck,
    colour_agreement,
    colour_grid,
    has_colours,
    warn_of_swapped,
)
from tactileforge.specs import SIMULATED, pixel_spacing, simulation, spec
from tactileforge_depth.features import BLURS, POWERS, exponents
from tactileforge_depth.inverse import Surface, SurfaceReader
from tactileforge_depth.lighting import (
    DEGREE,
    OpticalCalibration,
    load_optics,
    optics_names,
    parse_optics,
    polynomial_background,
)

#: Least agreement of a background's colours with those of a calibration; numbers below it do not
#: rank calibrations (docs/depth.md has the measurement).
_AGREES = 0.6
#: Largest depth, micrometres, within the range of int16.
_FAR = 32_000
#: Smallest depth of the brightest colour in an image of depth, mm, so that noise stays dark.
_SHALLOW = 0.2
#: Largest size of a calibration file, bytes.
_LARGEST = 1 << 20


class DepthReader:
    """Reads normals and depth of the gel from pictures of one sensor.

    A calibration maps normals to colours; it is inverted in each pixel, and the slopes are
    integrated. The shipped calibrations are of one unit of each type. Another unit has other
    lights, so its depths have the right shape but not the right scale; `depth.fit` fits a
    calibration of your unit.

    Args:
        sensor: Name of the sensor type, or the spec of a type that is not installed by name.
        calibration: Name of a shipped calibration, or a file of `depth.fit.save_optics`; None
            takes the shipped one of the type.
        rows: Rows of the height map; larger pictures are shrunk to as many first.
        mm_per_pixel: Size of a pixel of the sensor's own picture, mm; None computes it from the
            sensing area of the type.

    Raises:
        ConfigError: No calibration of the type ships, its sensing area is not known, or ``rows`` or
            ``mm_per_pixel`` is not above 0.
        DataNotFoundError: The calibration file does not exist.
        DataError: The file is not a calibration.

    Example:
        >>> import numpy as np
        >>> reader = DepthReader("digit", rows=60)
        >>> still = np.full((320, 240, 3), 100, np.uint8)
        >>> reader.read(still, still).depth.shape
        torch.Size([60, 45])
    """

    def __init__(
        self,
        sensor: str | SensorSpec,
        calibration: str | Path | None = None,
        rows: int = 120,
        mm_per_pixel: float | None = None,
    ) -> None:
        if rows < 1 or (mm_per_pixel is not None and not mm_per_pixel > 0):
            raise ConfigError(f"rows={rows}, mm_per_pixel={mm_per_pixel}: give them above 0")
        self.sensor = sensor if isinstance(sensor, str) else sensor.name
        self.rows, self.mm_per_pixel = rows, mm_per_pixel
        self.calibration = _calibration(self.sensor, calibration)
        self._height_mm = _height_mm(sensor) if mm_per_pixel is None else None
        self._readers: dict[tuple[int, int], SurfaceReader] = {}
        self._warns = calibration is None or str(calibration) in optics_names()
        self._checked: NDArray[np.uint8] | None = None  # last background with known colours

    def read(self, pictures: NDArray[np.uint8], background: NDArray[np.uint8]) -> Surface:
        """Reads the surface in one picture, or in each of several.

        Args:
            pictures: uint8 (H, W, 3) or (B, H, W, 3), RGB.
            background: uint8 (H, W, 3), RGB, picture without contact.

        Warns of pictures with another light than the background (`sensors.light`), and reads them
        as flat. Also warns of pictures with red and blue swapped against the background, and of a
        background with other colours than the calibration's: its lights are elsewhere; and, once,
        of a shipped calibration: what it gives is an estimate.

        Returns:
            Slopes (2, h, w) and depth (h, w) in mm, with B in front for several pictures; ``rows``
            are h.

        Raises:
            DataError: Pictures or background are not uint8, or differ in size.
        """
        for what in (pictures, background):
            if not isinstance(what, np.ndarray) or what.dtype != np.uint8:
                found = getattr(what, "dtype", type(what).__name__)
                raise DataError(f"pictures and background are numpy arrays of uint8, not {found}")
        if pictures.ndim not in (3, 4) or pictures.shape[-3:] != background.shape:
            raise DataError(
                f"pictures {pictures.shape} and background {background.shape}: give (H, W, 3) or "
                "(B, H, W, 3), and one (H, W, 3) of the same sensor"
            )
        self._check_colours(background)
        if self._warns:
            self._warns = False
            warnings.warn(
                "depth: an estimate, not a measurement: the calibrations that ship are of other "
                "units, and lights differ: fit one to yours (tactileforge calibrate depth)",
                stacklevel=2,
            )
        height, width = background.shape[:2]
        several = pictures if pictures.ndim == 4 else pictures[None]
        warn_of_swapped("pictures", several, background)
        lit = list(map(LightCheck(background), several))
        if any(lit):
            warnings.warn(
                f"depth: in {sum(lit)} of {len(several)} pictures the light has changed since the "
                f"background was taken, and their depth is 0: {TROUBLES['light']}",
                stacklevel=2,
            )
            # a change of light would be read as depth; the background itself is read as flat
            several = np.where(np.array(lit)[:, None, None, None], background, several)
        reader = self._reader(height, width)
        shown = torch.stack([_shrunk(picture, reader.size) for picture in several])
        surface = reader.read(shown, _shrunk(background, reader.size))
        return surface if pictures.ndim == 4 else Surface(surface.slope[0], surface.depth[0])

    def micrometres(
        self, picture: NDArray[np.uint8], background: NDArray[np.uint8]
    ) -> NDArray[np.int16]:
        """Depth in one picture, int16 (h, w), micrometres."""
        depth = self.read(picture, background).depth
        out: NDArray[np.int16] = (1000 * depth).round().clamp(-_FAR, _FAR).short().numpy()
        return out

    def _check_colours(self, background: NDArray[np.uint8]) -> None:
        """Warns of a background with the lights of another sensor; once for each background."""
        if self._checked is background:
            return
        self._checked = background
        seen = colour_grid(background)
        size = background.shape[:2]
        # a grey background, as of a sensor with white light, has no colours to compare
        if has_colours(seen) and not _has_its_lights(seen, self.calibration, size):
            # named only where one fits: below the limit agreement does not rank them
            fits = [one for one in optics_names() if _has_its_lights(seen, load_optics(one), size)]
            others = "".join(f"take calibration={one!r}, which fits, or " for one in fits[:1])
            warnings.warn(
                "depth: the colors of the background do not fit the calibration: the lights are "
                f"elsewhere, so depths may be wrong in place and size: {others}fit one to this "
                "unit (tactileforge calibrate depth)",
                stacklevel=3,
            )

    def _reader(self, height: int, width: int) -> SurfaceReader:
        rows = min(self.rows, height)
        size = rows, max(1, round(width * rows / height))
        if size not in self._readers:
            tall = self._height_mm
            if tall is None:
                assert self.mm_per_pixel is not None
                tall = self.mm_per_pixel * height
            self._readers[size] = SurfaceReader(self.calibration, size, tall / rows)
        return self._readers[size]


def _has_its_lights(
    seen: NDArray[np.float64], calibration: OpticalCalibration, size: tuple[int, ...]
) -> bool:
    """Whether a colour grid agrees with a background of a calibration, drawn at a size."""
    rests = (polynomial_background(one, *size).movedim(0, -1) for one in calibration.backgrounds)
    fits = [colour_agreement(seen, colour_grid(rest.numpy())) for rest in rests]
    return not fits or max(fits) >= _AGREES


def depth_image(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Depth as colours, uint8 (h, w, 3), RGB: dark for 0 mm, bright for the deepest place."""
    shares = (depth / max(_SHALLOW, float(depth.max()))).clip(0, 1)
    colours = cv2.applyColorMap((255 * shares).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    return np.asarray(cv2.cvtColor(colours, cv2.COLOR_BGR2RGB), np.uint8)


def depth_readers(
    given: Mapping[str, str], sensors: Mapping[str, Sensor], rows: int
) -> dict[str, DepthReader]:
    """Builds the depth reader of each calibrated sensor.

    Args:
        given: Calibration by name of the sensor, see `DepthReader`.
        sensors: Sensors by name; they need not be open yet.
        rows: Rows of the height maps.

    Raises:
        ConfigError: A sensor is unknown, or one of the errors of `DepthReader`.
        DataNotFoundError: A calibration file does not exist.
        DataError: A file is not a calibration.
    """
    if strange := sorted(set(given) - set(sensors)):
        raise ConfigError(unknown("sensor of depth", strange[0], sensors))
    return {name: DepthReader(sensors[name].spec, how, rows) for name, how in given.items()}


def _shrunk(picture: NDArray[np.uint8], size: tuple[int, int]) -> Tensor:
    """Resizes a picture to float32 (3, h, w)."""
    fits = picture.shape[:2] == size
    # averaged, which divides the noise of single pixels
    small = picture if fits else cv2.resize(picture, size[::-1], interpolation=cv2.INTER_AREA)
    return torch.from_numpy(np.moveaxis(np.asarray(small, np.float32), -1, 0).copy())


def _calibration(sensor: str, calibration: str | Path | None) -> OpticalCalibration:
    names: tuple[str, ...] = ()
    with suppress(ConfigError):
        names = simulation(sensor).calibrations
    if calibration is None and not names:
        have = ", ".join(name for name in SIMULATED if simulation(name).calibrations)
        raise ConfigError(
            f"no optical calibration of {sensor} comes with the package (there are those of {have})"
            ": fit one to presses of a ball, docs/depth.md"
        )
    if calibration is None or str(calibration) in optics_names():
        return load_optics(str(calibration or names[0]))
    return read_optics(calibration)


def _height_mm(sensor: str | SensorSpec) -> float:
    """Height of the area shown in the pictures of a sensor, mm."""
    name = sensor if isinstance(sensor, str) else sensor.name
    with suppress(ConfigError):
        return pixel_spacing(name, 1)
    area = None if isinstance(sensor, str) else sensor.area_mm
    with suppress(ConfigError):
        area = area or spec(name).area_mm
    if area is None:
        raise ConfigError(
            f"the sensing area of {name} is not known: give mm_per_pixel=, or area_mm in its "
            "SensorSpec"
        )
    return area[0]


def read_optics(path: str | Path) -> OpticalCalibration:
    """Reads a calibration from a file of `depth.fit.save_optics`.

    Raises:
        DataNotFoundError: The file does not exist.
        DataError: The file is not a valid calibration.
    """
    path = home_path(path)
    if not path.is_file():
        names = ", ".join(optics_names())
        raise DataNotFoundError(f"{path}: no such file, and no calibration that ships ({names})")
    try:
        if path.stat().st_size > _LARGEST:
            raise ValueError(f"more than {_LARGEST} bytes")
        optics = parse_optics(path.read_text("utf-8"))
        # sizes follow from the number of lights and the degree over the picture
        lights, places = len(optics.lights), len(exponents(DEGREE))
        tables = {
            "fine": (optics.fine, (len(POWERS), places, 3)),
            "coarse": (optics.coarse, (3 * len(BLURS) + lights, places, 3)),
            "limits": (optics.limits, (3 * len(BLURS) + lights,)),
        }
        for name, (table, shape) in tables.items():
            if tuple(table.shape) != shape or not table.isfinite().all():
                raise ValueError(f"{name} is {tuple(table.shape)}, not {shape}, or not finite")
        if not 0 < float(optics.steepest) <= 1:
            raise ValueError(f"steepest is {optics.steepest}")
    except (ValueError, KeyError, TypeError, RuntimeError, RecursionError) as error:
        raise DataError(f"{path}: not an optical calibration ({error}); fit it again") from error
    return optics
