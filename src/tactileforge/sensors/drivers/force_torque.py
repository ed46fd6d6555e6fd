"""Base of wrench sensor drivers: six numbers over a serial port or the network."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import SensorSpec
from tactileforge.errors import ConfigError
from tactileforge.sensors.drivers.packet_sensor import NO_PICTURE, Line, Marks, PacketSensor

#: Smallest value distinct from 0, and largest change from packet to packet, as shares of ``most``.
#: Bytes of a misread packet often decode to floats far below any resolution of a sensor.
_LEAST, _CHANGE = 1e-14, 0.1


class ForceTorque(PacketSensor):
    """A wrench sensor: forces and torques.

    A driver of a known device subclasses it, gives the known options to ``super().__init__``, and
    overrides `start`, `wrench` or `new_parser` if its protocol needs more.

    Args:
        port: Path of the serial port, or ``HOST:PORT``; see `Line`.
        link: Kind of connection: ``serial``, ``udp`` or ``tcp``.
        payload: Format of the payload, as for `struct`; its last six values are forces x, y, z and
            torques x, y, z.
        scale: Factors of the six values to N and N m.
        header: First bytes of a packet, hexadecimal.
        footer: Last bytes of a packet, hexadecimal.
        checksum: Name of the checksum, one of `checksums.CHECKSUMS`.
        covers: Bytes covered by the checksum: ``packet`` (header and payload) or ``payload``.
        request: Bytes to make the device send, hexadecimal; "" for none.
        farewell: Bytes to make the device stop, hexadecimal; "" for none.
        most: Largest possible force (N) and torque (N m). Without a checksum, a change by more than
            a tenth of it must be confirmed by the next packet.
        fps: Samples a second.
        baudrate: Bits a second.
        usb: Vendor and product of the USB device of the serial port; "" for any.
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
        """Decode forces and torques of a packet.

        Args:
            payload: Payload, without header, checksum and footer.

        Returns:
            float64 (6,), N and N m.

        Raises:
            ValueError: The packet declares itself invalid; it is counted as bad.
        """
        return self.numbers(payload)[-6:] * self.scale

    def decode(self, payload: bytes) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Decode a packet to an empty image and the wrench, float32 (6,)."""
        wrench = self.wrench(payload)
        sizes = np.abs(wrench)
        if not (sizes <= self.most).all():  # also true for NaN
            raise ValueError("a wrench that cannot be")
        if ((sizes > 0) & (sizes < _LEAST * self.most)).any():
            raise ValueError("a wrench of parts that are too small to be measured")
        return NO_PICTURE, wrench.astype(np.float32)
