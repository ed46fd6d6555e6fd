"""The calibration of one unit: a small YAML file, and a label of the unit's recordings."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError, DataNotFoundError, unknown
from tactileforge.sensors.borders import (
    BORDER_FEATURES,
    OTHER_LIGHT,
    amid_other_light,
    has_other_light,
)
from tactileforge.util import strict
from tactileforge.util.files import sealed_yaml, unsealed_yaml, write_text
from tactileforge.util.regular import regular_text

if TYPE_CHECKING:
    from tactileforge.sensors.calibration.features import ForceReader

#: Version of the file; other versions are refused.
VERSION = 2
#: Label of a recording with the text of its unit's calibration.
LABEL = "calibration"
FORCE_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class BackgroundLight:
    """Background of the unit: its mean colour and white balance.

    Attributes:
        colour: Mean red, green and blue, grey levels.
        balance: Factors from each colour to the level of the reference; without a reference, to
            the common mean of the three.
        grid: Mean colours of 3 x 4 parts of the image, grey levels.
    """

    colour: list[float]
    balance: list[float]
    grid: list[list[list[float]]]


@dataclass(frozen=True)
class ForceAxis:
    """One axis of the force: an offset, and the weight of each feature.

    Attributes:
        offset: Offset, N.
        weights: Weight of each feature, N per unit of the feature.
        rmse: Root mean square error on held-out presses, N.
        r2: Share of explained variance on held-out presses, at most 1.
        span: Lowest and highest fitted force, N.
        before: Root mean square error of the uncalibrated model on the same frames, N; None without
            a model.
        chosen: Name of the candidate, see `fit.Candidate`.
        errors: Root mean square error of each candidate on held-out presses, N; see
            `fit.AxisFit`.
    """

    offset: float
    weights: dict[str, float]
    rmse: float
    r2: float
    span: list[float]
    before: float | None = None
    chosen: str = ""
    errors: dict[str, float] = field(default_factory=dict)

    def __call__(self, features: Mapping[str, NDArray[np.floating]]) -> NDArray[np.float64]:
        """Computes the force, float64 (T,), N.

        Args:
            features: Features by name, float (T,) each.
        """
        total = sum(weight * np.asarray(features[name]) for name, weight in self.weights.items())
        return np.asarray(self.offset + total, np.float64)


@dataclass(frozen=True)
class ForceModel:
    """Linear model of the force from the unit's features.

    Attributes:
        of: Kind of features: ``pictures``, ``taxels``, ``head``, ``both``, or the name of a track,
            see `features.force_features`.
        lag: Delay of images behind forces, s.
        axes: Fitted axes, by name: ``x``, ``y`` or ``z``.
        model: Fingerprint of the fitted model (`hub.model.Model.fingerprint`); "" for none.
        left_out: Errors of the candidates of each axis without a fit, as in `Axis.errors`.
        borders: Least and largest change at the borders of the fitted pictures, grey levels, see
            `borders.border_range`; empty if it is not known.
    """

    of: str
    lag: float
    axes: dict[str, ForceAxis]
    model: str = ""
    left_out: dict[str, dict[str, float]] = field(default_factory=dict)
    borders: list[list[float]] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The calibration of one unit.

    Attributes:
        sensor: Type of the sensor.
        unit: Address or serial number of the unit, as in its recordings; "" for any.
        made: Date and source, in words.
        light: Light of the images without contact; None if it was not calibrated.
        mm_per_pixel: Scale of an image of ``size``, mm per pixel; None if it is not known.
        size: Height and width of the images, pixels.
        force: Model of the force; None if no force was fitted.

    Example:
        >>> one = Calibration(sensor="digit", unit="D20123", mm_per_pixel=0.05, size=[320, 240])
        >>> parse_calibration(one.text(), "here") == one
        True
    """

    sensor: str
    unit: str = ""
    made: str = ""
    light: BackgroundLight | None = None
    mm_per_pixel: float | None = None
    size: list[int] = field(default_factory=list)
    force: ForceModel | None = None

    @property
    def title(self) -> str:
        """Type and unit of the sensor."""
        return f"{self.sensor} {self.unit}".rstrip()

    def text(self) -> str:
        """Text of the file, with its checksum in the first line."""
        plain = {"version": VERSION} | asdict(self)
        return sealed_yaml(plain, width=100, default_flow_style=None)

    def save(self, path: Path) -> None:
        """Writes the file whole or not at all."""
        write_text(path, self.text())

    def balanced(self, frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Balances frames to the colours of the reference.

        Args:
            frames: Frames, uint8 (..., 3), RGB.

        Raises:
            ConfigError: The light was not calibrated.
        """
        if self.light is None:
            raise ConfigError(f"the calibration of {self.title} has no light")
        scaled = frames * np.asarray(self.light.balance, np.float32)
        return np.rint(scaled).clip(0, 255).astype(np.uint8)

    def forces(self, recording: Recording, model: ForceReader | None = None) -> NDArray[np.float32]:
        """Forces of a recording of this unit, float32 (T, 3), N; NaN on axes without a fit.

        NaN, with a warning, in frames with another light than in the fitted presses, see
        `borders.has_other_light` and `borders.amid_other_light`. With a fitted lag, a frame shows
        the force at ``force.lag`` seconds before its time.

        Args:
            recording: Recording of this unit.
            model: Model used in the fit, if any.

        Raises:
            ConfigError: The recording is of a different sensor, no force was calibrated, or the
                model is missing or a different one.
            DataError: The recording lacks the background or the track.
        """
        from tactileforge.sensors.calibration.features import force_features

        if self.force is None:
            raise ConfigError(f"the calibration of {self.title} has no force")
        self.check(recording.sensor, str(recording.labels.get("unit", "")))
        if self.force.model and (model is None or model.fingerprint != self.force.model):
            raise ConfigError(f"the forces of {self.title} were fitted to a model: give that model")
        features = force_features(recording, self.force.of, model)
        out = np.full((len(recording.frames), 3), np.nan, np.float32)
        for column, name in enumerate(FORCE_AXES):
            if name in self.force.axes:
                out[:, column] = self.force.axes[name](features)
        if self.force.borders:
            lit = has_other_light(features, self.force.borders)
            lit = amid_other_light(lit, recording.times)
            out[lit] = np.nan
            if lit.any():
                warnings.warn(
                    f"{recording.key}: {lit.sum()} of {len(lit)} frames have no force (NaN): "
                    f"{OTHER_LIGHT}. Keep other light away, or calibrate with such presses too",
                    stacklevel=2,
                )
        return out

    def check(self, sensor: str, unit: str = "") -> None:
        """Refuses a different sensor.

        Raises:
            ConfigError: The sensor is of a different type or unit.
        """
        if sensor != self.sensor or (unit and self.unit and unit != self.unit):
            raise ConfigError(
                f"the calibration is that of {self.sensor} {self.unit or '(any)'}, and this is "
                f"{sensor} {unit}: give the file of this unit, or calibrate it"
            )


def load_calibration(path: str | Path) -> Calibration:
    """Reads the file of a calibration.

    Raises:
        DataNotFoundError: There is no such file.
        ConfigError: The file is not a valid calibration; says where.
    """
    try:
        text = regular_text(Path(path))
    except OSError as error:
        raise DataNotFoundError(
            f"{path}: no calibration there ({error.strerror}); make it with: tactileforge "
            f"calibrate data=shards data.root=DIR out={path}"
        ) from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not a text file ({error.reason})") from error
    return parse_calibration(text, str(path))


def calibration_of(recording: Recording) -> Calibration | None:
    """Calibration in the labels of a recording; None without one.

    Raises:
        ConfigError: The label holds something else.
    """
    text = recording.labels.get(LABEL)
    return None if text is None else parse_calibration(str(text), f"{recording.key}, label {LABEL}")


def calibration_labels(path: str | Path, sensor: str, unit: str = "") -> dict[str, str]:
    """Labels with the calibration of a unit, to keep it together with the unit's recordings.

    Args:
        path: File of the calibration.
        sensor: Type of the recorded sensor.
        unit: Address or serial number of the sensor; "" without one.

    Raises:
        DataNotFoundError: There is no such file.
        ConfigError: The file is invalid, or of a different sensor.
    """
    calibration = load_calibration(path)
    calibration.check(sensor, unit)
    return {LABEL: calibration.text()}


def parse_calibration(text: str, where: str) -> Calibration:
    """Parses the text of a calibration.

    Args:
        text: Text in YAML, with its checksum.
        where: Place of the text, for messages.

    Raises:
        ConfigError: The checksum does not match, a key is unknown, missing or of the wrong type, or
            a number is not finite.
    """
    try:
        content = strict.mapping(where, unsealed_yaml(text))
    except ValueError as error:
        raise ConfigError(f"{where}: {error}; correct it, or calibrate again") from error
    # before the types: another version may have other keys
    if (version := content.pop("version", None)) != VERSION:
        raise ConfigError(
            f"{where}: version {version}, but this tactileforge reads {VERSION}; calibrate again"
        )
    calibration = strict.build(Calibration, where, content)
    _check(calibration, where)
    return calibration


def _check(calibration: Calibration, where: str) -> None:
    """Validates sizes, ranges and finite numbers, beyond the check of types."""
    size, scale = calibration.size, calibration.mm_per_pixel
    if size and (len(size) != 2 or min(size) <= 0):
        raise ConfigError(f"{where}: size is {size!r}, but must be a height and a width")
    if scale is not None and not 0 < scale < math.inf:
        raise ConfigError(f"{where}: mm_per_pixel is {scale}, but must be above 0")
    if calibration.light is not None:
        _check_light(calibration.light, f"{where}: light")
    if calibration.force is not None:
        _check_force(calibration.force, f"{where}: force")


def _check_light(light: BackgroundLight, where: str) -> None:
    colour, balance = light.colour, light.balance
    for key, values in (("colour", colour), ("balance", balance)):
        if len(values) != 3:
            raise ConfigError(f"{where}.{key} is {values!r}, but must be 3 numbers")
    rows = {len(row) for row in light.grid}
    cells = {len(cell) for row in light.grid for cell in row}
    if (len(light.grid), rows, cells) != (3, {4}, {3}) or not np.isfinite(light.grid).all():
        raise ConfigError(f"{where}.grid must be 3 rows of 4 colours")
    if min(balance) <= 0 or not np.isfinite(colour + balance).all():
        raise ConfigError(f"{where}.balance is {balance}, but must be above 0")


def _check_force(force: ForceModel, where: str) -> None:
    if not force.axes:
        raise ConfigError(f"{where}.axes is empty; give x, y or z")
    numbers = {"lag": force.lag}
    if force.borders and [len(row) for row in force.borders] != [len(BORDER_FEATURES)] * 2:
        raise ConfigError(f"{where}.borders must be 2 rows of {len(BORDER_FEATURES)} numbers")
    numbers |= {f"borders[{i}]": sum(row) for i, row in enumerate(force.borders)}
    for name, errors in force.left_out.items():
        numbers |= {f"left_out.{name}.{key}": error for key, error in errors.items()}
    for name, axis in force.axes.items():
        place = f"axes.{name}"
        if name not in FORCE_AXES:
            raise ConfigError(unknown(f"key of {where}.axes", name, FORCE_AXES))
        if len(axis.span) != 2:
            raise ConfigError(f"{where}.{place}.span is {axis.span!r}, but must be 2 numbers")
        numbers |= {f"{place}.{key}": getattr(axis, key) for key in ("offset", "rmse", "r2")}
        numbers |= {f"{place}.before": 0.0 if axis.before is None else axis.before}
        numbers |= {f"{place}.errors.{key}": error for key, error in axis.errors.items()}
        numbers |= {f"{place}.weights.{key}": weight for key, weight in axis.weights.items()}
    for key, value in numbers.items():
        if not math.isfinite(value):
            raise ConfigError(f"{where}.{key} is {value}, but must be a finite number")
