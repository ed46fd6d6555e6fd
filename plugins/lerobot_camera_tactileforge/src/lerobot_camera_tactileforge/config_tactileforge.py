"""Configuration of a touch sensor as a camera."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from lerobot.cameras.configs import CameraConfig

from tactileforge.contracts import Sensor
from tactileforge.plugins import build


@CameraConfig.register_subclass("tactileforge")
@dataclass(kw_only=True)
class TactileForgeCameraConfig(CameraConfig):
    """A sensor plugin of tactileforge, and its options.

    Attributes:
        sensor: Name of the plugin, as listed by ``tactileforge plugins list``.
        options: Options of the plugin, for example ``{serial: D20001}``.
        width: Columns of a frame, resized; None for those of the sensor.
        height: Rows of a frame, resized; None for those of the sensor. All images of a policy must
            have the same shape.
        fps: Frames per second stated in the data set; None for the rate of the sensor.
        reconnect: Time for which a lost sensor is opened again and again, s.

    Raises:
        PluginError: There is no such plugin.
        ValueError: The sensor gives no pictures, or a size is below 1.
    """

    fps: int | None = None
    width: int | None = None
    height: int | None = None
    sensor: str
    options: dict[str, Any] = field(default_factory=dict)
    reconnect: float = 10.0

    def __post_init__(self) -> None:
        spec = self.build().spec
        if spec.kind not in ("image", "array"):
            raise ValueError(f"sensor={self.sensor} ({spec.kind}) gives no pictures")
        self.width = spec.width if self.width is None else self.width
        self.height = spec.height if self.height is None else self.height
        self.fps = round(spec.fps) if self.fps is None else self.fps
        if min(self.width, self.height) < 1:
            raise ValueError(f"width={self.width}, height={self.height}: give 1 or more")

    def build(self) -> Sensor:
        """Builds the sensor, unopened."""
        sensor: Sensor = build("sensors", {**self.options, "name": self.sensor})
        return sensor
