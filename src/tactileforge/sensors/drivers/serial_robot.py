"""State and actions of a robot, as packets over a serial port or the network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import SensorSpec
from tactileforge.errors import ConfigError
from tactileforge.sensors.drivers.packet_sensor import NO_PICTURE, Line, Marks, PacketSensor

#: Largest change of a state from packet to packet, as a share of the range of the limits.
_CHANGE = 0.1


class SerialRobot(PacketSensor):
    """A robot, or its controller: sends its state and its present command.

    Each packet carries the state (joint angles, opening of the gripper) before a step, and then the
    command of that step. Angles must not jump by a turn, as they are interpolated.

    Args:
        port: Path of the serial port, or ``HOST:PORT``; see `Line`.
        link: Kind of connection: ``serial``, ``udp`` or ``tcp``.
        payload: Format of the payload, as for `struct`.
        states: Number of values of the state; the others are the action.
        scale: Factors of the values; one number for all, or one each.
        header: First bytes of a packet, hexadecimal.
        footer: Last bytes of a packet, hexadecimal.
        checksum: Name of the checksum, one of `checksums.CHECKSUMS`.
        covers: Bytes covered by the checksum: ``packet`` (header and payload) or ``payload``.
        request: Bytes to make the device send, hexadecimal; "" for none.
        farewell: Bytes to make the device stop, hexadecimal; "" for none.
        limits: Smallest and largest possible value, after scaling. Without a checksum, a change of
            the state by more than a tenth of their range must be confirmed by the next packet.
        fps: Packets a second.
        baudrate: Bits a second.
        usb: Vendor and product of the USB device of the serial port; "" for any.

    Raises:
        ConfigError: Invalid option.
    """

    spec = SensorSpec(
        name="serial_robot",
        height=0,
        width=0,
        fps=50.0,
        area_mm=None,
        force_scale=(1.0, 1.0, 1.0),
        kind="robot",
        states=7,
        actions=7,
    )

    def __init__(
        self,
        port: str = "",
        link: str = "serial",
        payload: str = "<14f",
        states: int = 7,
        scale: Sequence[float] = (1.0,),
        header: str = "aa55",
        footer: str = "",
        checksum: str = "none",
        covers: str = "packet",
        request: str = "",
        farewell: str = "",
        limits: Sequence[float] = (-1e4, 1e4),
        fps: float = 50.0,
        baudrate: int = 115200,
        usb: str = "",
    ) -> None:
        line = Line(port, link, baudrate, usb)
        marks = Marks(header, footer, checksum, covers, request, farewell)
        super().__init__(line, payload, max(1, states), marks, fps)
        if states < 1:
            raise ConfigError(f"states={states}: a robot has a state; give 1 or more")
        if len(scale) not in (1, self.count):
            raise ConfigError(f"scale has {len(scale)} numbers: give one, or {self.count}")
        if len(limits) != 2 or not limits[0] < limits[1]:
            raise ConfigError(f"limits={list(limits)}: give the least and the largest value")
        self.scale = np.array(scale, np.float64)
        self.limits = (float(limits[0]), float(limits[1]))
        self.spec = replace(self.spec, states=states, actions=self.count - states)
        self.most_change = np.full(self.count, np.inf)  # commands may jump
        self.most_change[:states] = _CHANGE * (self.limits[1] - self.limits[0])

    def decode(self, payload: bytes) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Decode a packet to an empty image, and state and action.

        Raises:
            ValueError: A value is outside the limits.
        """
        values = self.numbers(payload) * self.scale
        least, most = self.limits
        if not ((values >= least) & (values <= most)).all():  # also true for NaN
            raise ValueError("a value outside the limits")
        return NO_PICTURE, values.astype(np.float32)
