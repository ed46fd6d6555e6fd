"""Attached cameras, as listed by Linux, without opening them."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

#: Where Linux lists them, and where they have names that tell their sockets.
SYSTEM, BY_PATH = Path("/sys/class/video4linux"), Path("/dev/v4l/by-path")


@dataclass(frozen=True)
class VideoDevice:
    """An attached camera.

    Attributes:
        path: For example ``/dev/video0``.
        name: What it calls itself.
        usb: Vendor and product, for example ``2833:0209``; "" where it is not on USB.
        serial: Its serial number; "" where it has none.
    """

    path: str
    name: str
    usb: str
    serial: str


def video_devices(system: Path | None = None) -> list[VideoDevice]:
    """Attached cameras by number, without metadata-only nodes.

    Args:
        system: Folder that lists them; None for that of this machine.
    """
    folder = system or SYSTEM
    nodes = sorted(folder.glob("video*"), key=lambda node: int(re.sub(r"\D", "", node.name) or 0))
    return [_device(node) for node in nodes if _text(node / "index") in ("", "0")]


def _device(node: Path) -> VideoDevice:
    interface = node / "device"
    owner = interface.resolve().parent
    vendor, product = _text(owner / "idVendor"), _text(owner / "idProduct")
    usb = f"{vendor}:{product}" if vendor else ""
    return VideoDevice(f"/dev/{node.name}", _text(node / "name"), usb, _text(owner / "serial"))


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def matching(words: str, devices: list[VideoDevice]) -> list[VideoDevice]:
    """Cameras that match ``usb:VENDOR:PRODUCT``, ``serial:NUMBER`` or ``name:PART``.

    Args:
        words: The description; what it does not begin with is matched with nothing.
        devices: Those to choose from.
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
    """Lists cameras with their serial numbers, for an error.

    Args:
        devices: The attached ones, see `video_devices`.
    """
    told = [f"{c.path} {c.name} {c.serial}".strip() for c in devices]
    return f" (attached: {', '.join(told) or 'none'})"


def choices(paths: Sequence[str], by_path: Path | None = None) -> str:
    """Lists cameras with their serial numbers, and says how one is chosen, for an error.

    Args:
        paths: Of the cameras, more than one.
        by_path: Folder of links that are named by socket; None for that of this machine.
    """
    serials = {camera.path: camera.serial for camera in video_devices()}
    told = ", ".join(f"{path} {serials.get(path, '')}".strip() for path in paths)
    numbers = [serials.get(path, "") for path in paths]
    if all(numbers) and len(set(numbers)) == len(numbers):
        return f"{told}; choose with device=serial:{numbers[0]}"
    folder = by_path or BY_PATH
    links = sorted(link for link in folder.glob("*") if os.path.realpath(link) in paths)
    names = " or ".join(f"device={link}" for link in links) or f"device={folder}/..."
    return f"{told}; serial numbers do not tell them apart: choose by socket, with {names}"


def why_not(source: str) -> str:
    """Explains why OpenCV cannot open a device, file or URL, with the fix."""
    path = Path(source)
    if path.is_file():
        return f"{source}: not a video that can be read"
    if "://" in source:
        return f"{source}: no video comes from there; is it on, and is the address right?"
    if not path.exists():
        others = attached_cameras(video_devices())
        return f"{source}: no such camera{others}; plug it in, or set device="
    try:
        os.close(os.open(source, os.O_RDWR | os.O_NONBLOCK))
    except OSError as error:
        if error.errno == errno.EACCES:
            return f"{source}: not yours to open; add yourself to the group video"
        return f"{source}: cannot be opened ({error.strerror}); is another program using it?"
    return f"{source}: busy, or no camera; close the other program that uses it (fuser {source})"
