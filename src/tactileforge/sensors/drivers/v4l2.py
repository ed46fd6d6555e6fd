"""Cameras attached to a Linux machine, listed without opening them."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

#: Folder of the list of cameras, and folder of links named by their sockets.
SYSTEM = Path("/sys/class/video4linux")
BY_PATH = Path("/dev/v4l/by-path")


@dataclass(frozen=True)
class VideoDevice:
    """An attached camera.

    Attributes:
        path: Path of the device, for example ``/dev/video0``.
        name: Name of the device.
        usb: Vendor and product, for example ``2833:0209``; "" for a device not on USB.
        serial: Serial number; "" for none.
    """

    path: str
    name: str
    usb: str
    serial: str


def video_devices(system: Path | None = None) -> list[VideoDevice]:
    """Attached cameras by number.

    Args:
        system: Folder of the list; None for that of this machine.
    """
    folder = system or SYSTEM
    nodes = sorted(folder.glob("video*"), key=lambda node: int(re.sub(r"\D", "", node.name) or 0))
    devices = []
    for node in nodes:
        # index 0 alone: uvcvideo makes a second node a camera, for metadata without pictures
        if _text(node / "index") not in ("", "0"):
            continue
        # the link leads to an interface of the USB device; the device itself is its parent
        owner = (node / "device").resolve().parent
        vendor, product = _text(owner / "idVendor"), _text(owner / "idProduct")
        usb = f"{vendor}:{product}" if vendor else ""
        name, serial = _text(node / "name"), _text(owner / "serial")
        devices.append(VideoDevice(f"/dev/{node.name}", name, usb, serial))
    return devices


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def matching(words: str, devices: list[VideoDevice]) -> list[VideoDevice]:
    """Select cameras by ``usb:VENDOR:PRODUCT``, ``serial:NUMBER`` or ``name:PART``.

    Args:
        words: Description in one of these forms; others match nothing.
        devices: Cameras to choose from.
    """
    what, _, value = words.partition(":")
    match what:
        case "usb":
            return [device for device in devices if device.usb == value.lower()]
        case "serial":
            return [device for device in devices if device.serial == value]
        case "name":
            return [device for device in devices if value.lower() in device.name.lower()]
    return []


def attached_cameras(devices: list[VideoDevice]) -> str:
    """List cameras with their serial numbers, for an error.

    Args:
        devices: Attached cameras, see `video_devices`.
    """
    listed = [f"{c.path} {c.name} {c.serial}".strip() for c in devices]
    return f" (attached: {', '.join(listed) or 'none'})"


def describe_choices(paths: Sequence[str], by_path: Path | None = None) -> str:
    """List cameras with their serial numbers and ways to choose one, for an error.

    Args:
        paths: Paths of more than one camera.
        by_path: Folder of links named by socket; None for that of this machine.
    """
    serials = {camera.path: camera.serial for camera in video_devices()}
    listed = ", ".join(f"{path} {serials.get(path, '')}".strip() for path in paths)
    numbers = [serials.get(path, "") for path in paths]
    if all(numbers) and len(set(numbers)) == len(numbers):
        return f"{listed}; choose with device=serial:{numbers[0]}"
    folder = by_path or BY_PATH
    links = sorted(link for link in folder.glob("*") if os.path.realpath(link) in paths)
    names = " or ".join(f"device={link}" for link in links) or f"device={folder}/..."
    return f"{listed}; serial numbers do not tell them apart: choose by socket, with {names}"


def explain_failure(source: str) -> str:
    """Explain a failure of OpenCV to open a device, file or URL, with the fix."""
    path = Path(source)
    if path.is_file():
        return f"{source}: not a video that can be read"
    if "://" in source:
        return f"{source}: no video comes from there; is it on, and is the address right?"
    if not path.exists():
        others = attached_cameras(video_devices())
        return f"{source}: no such camera{others}; plug it in, or set device="
    try:
        # OpenCV only says that it failed: opening the node once more gives the reason of the system
        os.close(os.open(source, os.O_RDWR | os.O_NONBLOCK))
    except OSError as error:
        if error.errno == errno.EACCES:
            return f"{source}: not yours to open; add yourself to the group video"
        return f"{source}: cannot be opened ({error.strerror}); is another program using it?"
    return f"{source}: busy, or no camera; close the other program that uses it (fuser {source})"
