"""Checks of the inputs of a stream: images, name of the sensor, background."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.pixel_contract import checked_pixels
from tactileforge.errors import ConfigError, unknown
from tactileforge.sensors.background import Background

if TYPE_CHECKING:
    from torch import Tensor

    from tactileforge.sensors.calibration.file import Calibration

Image: TypeAlias = NDArray[np.uint8]
#: What the numbers of a force are: newtons that were measured on this unit or fitted to it, shares
#: of the model's force scale (-1 to 1), or newtons by that scale, which are an estimate.
ForceUnit: TypeAlias = Literal["N", "relative", "uncalibrated"]


class ClipReading(Protocol):
    """Vectors and forces of clips; see `hub.forces.ModelReadings`."""

    @property
    def vector(self) -> Tensor:
        """float32 (n,)."""
        ...

    @property
    def force(self) -> Tensor | None:
        """float32 (T - 1, 3), in the requested `ForceUnit`; None without forces."""
        ...

    @property
    def newton(self) -> Tensor | None:
        """The same, N; without a calibration an estimate."""
        ...


class ClipModel(Protocol):
    """What a stream needs of a model; see `hub.model.Model`."""

    encoder: Any
    frames: int

    @property
    def spacing(self) -> float:
        """Seconds between the frames of a clip."""
        ...

    @property
    def any_sensor(self) -> bool:
        """Whether it ignores the sensor type."""
        ...

    @property
    def sensors(self) -> list[str]:
        """Sensors in its training."""
        ...

    def squash(self, images: Image) -> Image:
        """Images as training showed them to the encoder."""
        ...

    def axes_of(self, calibration: Calibration, names: Sequence[str]) -> object:
        """The fits of a calibration; an error if it was made for another model."""
        ...

    def force_unit(self, calibration: Calibration | None, unit: str | None) -> ForceUnit:
        """Unit of its forces; an error where it cannot give the wanted one."""
        ...

    def readings(
        self,
        frames: Image,
        background: Image | None,
        sensor: str | None,
        *,
        calibration: Calibration | None,
        force_unit: str | None,
        check: bool,
    ) -> ClipReading:
        """Vectors and forces of a clip."""
        ...


def median_image(images: Sequence[Image]) -> Image:
    """Median of images, uint8 (H, W, 3)."""
    return np.asarray(np.median(images, axis=0), np.uint8)


def known_as(name: str, model: ClipModel | None, unknown_sensor: str) -> str:
    """Name of a type of sensor in the model's table.

    Raises:
        ConfigError: The model does not know the sensor, and ``unknown_sensor`` is ``error`` or the
            model has no universal tokens.
    """
    if unknown_sensor not in ("error", "universal"):
        raise ConfigError(f"unknown_sensor={unknown_sensor}: give error or universal")
    if model is None or model.any_sensor or name in model.sensors:
        return name
    # encoders of other packages need not have such tokens
    has_universal = getattr(model.encoder, "universal", None) is not None
    if has_universal and "universal" in (name, unknown_sensor):
        return "universal"
    fix = "unknown_sensor=universal takes the tokens that fit no sensor, and gives no force."
    raise ConfigError(unknown("sensor of the model", name, model.sensors, fix * has_universal))


def background_options(background: Image | str | Background | None) -> Background:
    """Options for taking a background, if it is not an image.

    Raises:
        ConfigError: The word is not ``first``, or it is something else.
    """
    if isinstance(background, str) and background == "first":
        return Background(seconds=0.0)
    if not (background is None or isinstance(background, np.ndarray | Background)):
        raise ConfigError(
            f"background={background!r}: give an image (uint8 array), 'first', or a Background"
        )
    return background if isinstance(background, Background) else Background()


def checked_image(what: str, image: Image) -> Image:
    """Checks and copies an image, since the caller may reuse its memory for the next frame.

    Args:
        what: Name of the image, for errors.
        image: uint8 (H, W, 3).

    Raises:
        DataError: The type or shape is wrong; says what was found.
    """
    return np.array(checked_pixels(image, what, 3))  # np.array copies, np.asarray would not
