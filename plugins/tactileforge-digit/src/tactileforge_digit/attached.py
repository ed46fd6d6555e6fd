"""Attached DIGITs and their firmware, as listed by Linux."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tactileforge.sensors import v4l2

#: Vendor and product on USB.
USB = "2833:0209"


@dataclass(frozen=True)
class Unit:
    """An attached DIGIT.

    Attributes:
        path: Path of the device, for example ``/dev/video2``.
        serial: Serial number, for example ``D20001``.
        revision: Version of its firmware, times 100; None where Linux does not list it.
    """

    path: str
    serial: str
    revision: int | None


def attached(system: Path | None = None) -> list[Unit]:
    """Lists the attached DIGITs, by number of the device.

    Args:
        system: Linux's folder of video devices; None for that of this machine.
    """
    folder = system or v4l2.SYSTEM
    cameras = v4l2.matching(f"usb:{USB}", v4l2.video_devices(folder))
    return [
        Unit(camera.path, camera.serial, _revision(folder / Path(camera.path).name))
        for camera in cameras
    ]


def _revision(node: Path) -> int | None:
    """Reads the release number of the USB device, four decimal digits: ``0200`` is 2.00."""
    try:
        text = ((node / "device").resolve().parent / "bcdDevice").read_text().strip()
    except OSError:
        return None
    return int(text) if text.isdecimal() else None
