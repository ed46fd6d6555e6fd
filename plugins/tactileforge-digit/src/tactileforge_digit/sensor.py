"""DIGIT: a camera on USB, upright, with three lights controlled by the host."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2

from tactileforge.errors import ConfigError, SensorError
from tactileforge.sensors import Camera
from tactileforge.specs import SPECS
from tactileforge_digit.attached import USB, attached

#: Width and height of a frame before it is turned upright, and rates, by mode.
MODES = {"qvga": (320, 240, (60, 30)), "vga": (640, 480, (30, 15))}
#: Full intensity, and the first firmware with this scale of intensities, times 100.
FULL, LIGHTS_SINCE = 15, 200


class Digit(Camera):
    """A DIGIT. Its frames are turned upright: in mode ``qvga`` 320 rows of 240 columns.

    Args:
        serial: Serial number, for example ``D20001``; "" takes the one that is attached.
        resolution: ``qvga`` (60 or 30 frames a second) or ``vga`` (30 or 15).
        fps: Frames a second.
        lights: Intensity of the red, green and blue light, 0 to 15 each. None is full light with
            firmware 2.00 or later, and leaves them alone with an older one, whose scale is unknown.
        device: Path of the camera, or of a video file in its place; "" finds it by ``serial``.
        warmup: Frames to throw away when it is opened: the first ones may be green.

    Raises:
        ConfigError: An unknown mode or rate, or lights out of range.
    """

    spec = SPECS["digit"]

    def __init__(
        self,
        serial: str = "",
        resolution: str = "qvga",
        fps: int = 30,
        lights: Sequence[int] | None = None,
        device: str = "",
        warmup: int = 10,
    ) -> None:
        if resolution not in MODES:
            raise ConfigError(f"resolution={resolution}: a DIGIT has {', '.join(MODES)}")
        width, height, rates = MODES[resolution]
        if fps not in rates:
            modes = " or ".join(map(str, rates))
            raise ConfigError(f"fps={fps}: with resolution={resolution} a DIGIT has {modes}")
        self.lights = lights
        self.zoom = packed((FULL,) * 3 if lights is None else lights)
        super().__init__(
            device=device or (f"serial:{serial}" if serial else f"usb:{USB}"),
            type="digit",
            width=width,
            height=height,
            fps=fps,
            fourcc="YUYV",
            rotation=90,
            warmup=warmup,
        )

    def adjust(self, capture: Any) -> None:
        """Sets the lights. Their control is the one for the zoom in other cameras.

        Raises:
            SensorError: Its firmware is too old for this scale of ``lights``, or refuses them.
        """
        super().adjust(capture)
        revision = self.revision()
        if revision is not None and revision < LIGHTS_SINCE:
            if self.lights is None:
                return
            raise SensorError(
                f"{self.device}: firmware {revision / 100:.2f} has another scale of lights than "
                "2.00 and later; leave lights= out, or update it"
            )
        self.control(capture, "lights", cv2.CAP_PROP_ZOOM, self.zoom)

    def revision(self) -> int | None:
        """Version of the firmware of the chosen device, times 100; None where unknown."""
        there = self.discover()
        return next((unit.revision for unit in attached() if unit.path in there), None)


def packed(lights: Sequence[int]) -> int:
    """Packs intensities for the device, four bits each: red, green, blue.

    Args:
        lights: Three intensities, 0 to 15.

    Raises:
        ConfigError: There are not three, or one is out of range.

    Example:
        >>> hex(packed([15, 0, 3]))
        '0xf03'
    """
    if len(lights) != 3 or not all(0 <= light <= FULL for light in lights):
        raise ConfigError(f"lights={list(lights)}: give three numbers from 0 to {FULL}")
    value = 0
    for light in lights:
        value = value << 4 | int(light)
    return value
