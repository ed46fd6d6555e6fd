"""Base of wrench sensor drivers: six numbers over a serial port or the network."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import SensorSpec
from tactileforge.errors import ConfigError
from tactileforge.sensors.drivers.packet_sensor import NO_PICTURE, Line, Marks, PacketSensor

#: The least size that is told from 0, and the largest change from packet to packet, of ``most``.
_LEAST, _CHANGE = 1e-14, 0.1


class ForceTorque(PacketSensor):
    """A wrench sensor: forces and torques.

    A driver of a known device subclasses it, gives what is known to ``super().__init__``, and
    overrides `start`, `wrench` or `new_parser` where its protocol asks for more.

    Args:
        port: Path of the serial port, or ``HOST:PORT``; see `Line`.
        link: ``serial``, ``udp`` or ``tcp``.
        payload: What a packet carries, as `struct` writes it; its last six values are forces x, y,
            z and torques x, y, z.
        scale: What each of the six is multiplied by to be in N and N m.
        header: What a packet begins with, hexadecimal.
        footer: What it ends with, hexadecimal.
        checksum: See `checksums.CHECKSUMS`.
        covers: What the checksum is of: ``packet`` (header and payload) or ``payload``.
        request: What makes the device send, hexadecimal; "" for one that sends by itself.
        farewell: What makes it stop, hexadecimal.
        most: Largest force (N) and torque (N m) that can be true. Where there is no checksum, a
            packet that changes by more than a tenth of it must be borne out by the next.
        fps: Samples a second.
        baudrate: Bits a second.
        usb: Vendor and product of the USB device that the serial port belongs to.
    """

    spec = SensorSpec(
        name="force_torque",
        height=0,
        width=0,
        fps=100.0,
        area_mm=None,
        force_scale=(10.0, 10.0, 10.0),
        kind="wrench",
    )

    def __init__(
        self,
        port: str = "",
        link: str = "serial",
        payload: str = "<6f",
        scale: Sequence[float] = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
        header: str = "aa55",
        footer: str = "",
        checksum: str = "none",
        covers: str = "packet",
        request: str = "",
        farewell: str = "",
        most: Sequence[float] = (10_000.0, 1_000.0),
        fps: float = 100.0,
        baudrate: int = 115200,
        usb: str = "",
    ) -> None:
        if len(scale) != 6:
            raise ConfigError(f"scale has {len(scale)} numbers: give six, for N and N m")
        if len(most) != 2 or not min(most) > 0:
            raise ConfigError(f"most={list(most)}: give a force (N) and a torque (N m) above 0")
        line = Line(port, link, baudrate, usb)
        marks = Marks(header, footer, checksum, covers, request, farewell)
        super().__init__(line, payload, 6, marks, fps)
        self.most = np.repeat(np.array(most, np.float64), 3)
        self.most_change = _CHANGE * self.most
        self.scale = np.array(scale, np.float64)

    def wrench(self, payload: bytes) -> NDArray[np.float64]:
        """Forces and torques of a packet.

        Args:
            payload: Without header, checksum and footer.

        Returns:
            float64 (6,), N and N m.

        Raises:
            ValueError: The packet says that it does not count; it is counted as bad.
        """
        return self.numbers(payload)[-6:] * self.scale

    def decode(self, payload: bytes) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """An empty image, and the wrench."""
        wrench = self.wrench(payload)
        sizes = np.abs(wrench)
        if not (sizes <= self.most).all():  # nor where it is no number
            raise ValueError("a wrench that cannot be")
        if ((sizes > 0) & (sizes < _LEAST * self.most)).any():
            raise ValueError("a wrench of parts that are too small to be measured")
        return NO_PICTURE, wrench.astype(np.float32)
