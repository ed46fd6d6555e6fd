"""AnySkin and ReSkin: magnetometers under a magnetic skin, read over a serial port.

A packet consists of four little-endian floats for each magnetometer (temperature in degrees
Celsius; x, y and z of the field in microtesla), then carriage return and line feed. There is no
header, no checksum and no counter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from tactileforge_arrays import SerialArray

from tactileforge.contracts import SensorSpec
from tactileforge.sensors import Link, SerialLink

#: Range of plausible temperatures, degrees Celsius.
COLDEST, HOTTEST = -20.0, 100.0
#: Range of plausible magnitudes, other than 0. A packet that is read from the wrong offset has
#: floats composed of parts of two values, and some of these lie far outside.
LEAST, MOST = 1e-3, 1e5
#: Bytes received at once from which on they are thrown away: they have waited too long to be shown
#: as the present touch.
STALE = 4000
#: Where the five magnetometers are drawn, row and column: the middle, and its four sides.
PLACES = ((1, 1), (0, 1), (1, 0), (1, 2), (2, 1))


class FreshLink(SerialLink):
    """A serial port without its stale bytes: a backlog of `STALE` or more is thrown away.

    Attributes:
        stale: Bytes thrown away.
    """

    stale = 0

    def receive(self, timeout: float) -> bytes:
        """Receives bytes, as `Link.receive` does; b"" after a backlog was thrown away."""
        data = super().receive(timeout)
        if len(data) < STALE:
            return data
        self.stale += len(data)
        return b""


class AnySkin(SerialArray):
    """An AnySkin: magnetometers, drawn as the change of their field.

    Args:
        port: Path of the serial port, for example ``/dev/ttyACM0``.
        positions: Row and column of each magnetometer in the picture, in the order of the packet.
        shape: Rows and columns of the picture.
        span: Change of the field drawn as full colour, microtesla.
        rate: Largest change of the field, microtesla a second; see `SerialArray`.
        baseline: Packets for the field without contact (their median), taken at opening.
        usb: Vendor and product of the board, for example ``2341:8057``, to find the port by.
        serial_number: Serial number of the board, to find the port by.

    Attributes:
        spec: Specification. Its rate is measured while the baseline is taken, as the board sends
            as fast as it can.
    """

    spec = SensorSpec(
        name="anyskin",
        height=3,
        width=3,
        fps=100.0,
        area_mm=None,
        force_scale=(5.0, 5.0, 10.0),
        kind="array",
    )
    free_running = True

    def __init__(
        self,
        port: str = "",
        positions: Sequence[Sequence[float]] = PLACES,
        shape: Sequence[int] = (3, 3),
        span: float = 500.0,
        rate: float | None = None,
        baseline: int = 30,
        usb: str = "",
        serial_number: str = "",
    ) -> None:
        super().__init__(
            port=port,
            type=self.spec.name,
            shape=shape,
            payload=f"<{4 * len(positions)}f",
            header="",
            footer="0d0a",
            values=4,
            channels=(1, 2, 3),
            positions=positions,
            span=span,
            rate=rate,
            baseline=baseline,
            fps=self.spec.fps,
            baudrate=115200,
            usb=usb,
            serial_number=serial_number,
        )

    def plausible(self, payload: bytes) -> bool:
        """Whether all values are plausible for a thermometer and a magnetometer."""
        values = self.unpack(payload)
        sizes, heat = np.abs(values), values[:, 0]
        possible = (sizes == 0) | ((sizes >= LEAST) & (sizes <= MOST))
        return bool(possible.all() and (heat >= COLDEST).all() and (heat <= HOTTEST).all())

    def connect(self) -> Link:
        """Opens the port."""
        return FreshLink(self.port or self.find_port(), self.baudrate)


class ReSkin(AnySkin):
    """A ReSkin, with the packets and options of an `AnySkin`."""

    spec = replace(AnySkin.spec, name="reskin")
