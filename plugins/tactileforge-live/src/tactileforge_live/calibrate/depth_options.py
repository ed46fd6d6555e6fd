"""Options of an optical calibration, light to import."""

from __future__ import annotations

from dataclasses import dataclass

from tactileforge.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class DepthOptions:
    """Keys of ``tactileforge calibrate depth``, except those of data and files.

    Attributes:
        ball_mm: Diameter of the ball, mm.
        device: Sensor, for data of several: the label ``device``, or the type; None for any.
        unit: Unit of the sensor, by the label ``unit``; None for any.
        gel_mm: Thickness of the gel, mm; None for that of the sensor's type.
        mm_per_pixel: Scale of the images, mm per pixel; None computes it from the sensing area of
            the type.
        circle_share: Radius of the contact over that of the circle, 0 to 1: below 1 for circles
            around all that changes in the picture.
        shadows: Whether the fit uses shadows of the lights.
        steepest: Limit of the lateral length of normals, 0 to 1.
    """

    ball_mm: float
    device: str | None = None
    unit: str | None = None
    gel_mm: float | None = None
    mm_per_pixel: float | None = None
    circle_share: float = 1.0
    shadows: bool = True
    steepest: float = 0.7

    def __post_init__(self) -> None:
        for name in ("ball_mm", "gel_mm", "mm_per_pixel"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ConfigError(f"{name}={value}: give millimetres above 0")
        for name in ("circle_share", "steepest"):
            if not 0 < getattr(self, name) <= 1:
                raise ConfigError(f"{name}={getattr(self, name)}: give a number above 0, at most 1")
