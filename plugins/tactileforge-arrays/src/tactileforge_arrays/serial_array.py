"""Taxel arrays on a serial port, described by options; base of specific drivers."""

from __future__ import annotations

import struct
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import SensorSpec
from tactileforge.errors import ConfigError, SensorError
from tactileforge.sensors import (
    Arrival,
    Framing,
    Link,
    PacketParser,
    Parser,
    SerialLink,
    StreamSensor,
    TaxelLayout,
    attached_ports,
    changes_by_at_most,
    hex_bytes,
    payload_size,
)
from tactileforge.specs import spec

#: Longest time for the frames of a baseline, s.
_PATIENCE = 5.0
#: Range of plausible magnitudes of a drawn value, in spans, other than 0, where ``limits`` is None.
_LEAST, _MOST = 1e-9, 1e6


class SerialArray(StreamSensor):
    """Taxels over a serial port.

    A driver of a known device subclasses it, and passes the known options to ``super().__init__``.

    Args:
        port: Path of the port; "" takes the one port that ``usb`` and ``serial_number`` name.
        type: Name of the type of sensor, in recordings; see `tactileforge.specs.published`.
        shape: Rows and columns of the picture.
        payload: Format of the payload of a packet, as of `struct`, for example ``<15f``.
        header: First bytes of a packet, hexadecimal, for example ``aa55``.
        footer: Last bytes of a packet, hexadecimal.
        checksum: Name of the checksum, one of `checksums.CHECKSUMS`.
        covers: Bytes covered by the checksum: ``packet`` (header and payload) or ``payload``.
        values: Values of each taxel in the payload.
        channels: Indices of x, y and z among these values; a single index is z. All values are
            stored in ``raw``.
        positions: Row and column of each taxel; None for a grid, row by row.
        span: Change of a value drawn as full colour, one number for all axes or one for each.
        limits: Lowest and highest plausible value; None for a wide range around ``span``.
        rate: Largest change of a drawn value per second, where there is no checksum. A packet with
            a larger change must be confirmed by the next; None for ``span`` a packet, 0 for no
            limit.
        baseline: Frames for the value without contact (their median), taken at opening.
        fps: Packets a second.
        baudrate: Bits a second.
        usb: Vendor and product of the USB device, for example ``2833:4001``.
        serial_number: Serial number of the USB device.

    Attributes:
        free_running: Whether the device sends as fast as it can; its rate is then measured while
            the baseline is taken.
        layout: Layout of the taxels in the picture.
        rest: float32 (taxels, values), the baseline of the open device.
    """

    spec = SensorSpec(
        name="serial_array",
        height=4,
        width=4,
        fps=100.0,
        area_mm=None,
        force_scale=(5.0, 5.0, 10.0),
        kind="array",
    )
    free_running = False

    def __init__(
        self,
        port: str = "",
        type: str = "serial_array",
        shape: Sequence[int] = (4, 4),
        payload: str = "<16H",
        header: str = "aa55",
        footer: str = "",
        checksum: str = "none",
        covers: str = "packet",
        values: int = 1,
        channels: Sequence[int] = (0,),
        positions: Sequence[Sequence[float]] | None = None,
        span: float | Sequence[float] = 100.0,
        limits: Sequence[float] | None = None,
        rate: float | None = None,
        baseline: int = 30,
        fps: float = 100.0,
        baudrate: int = 115200,
        usb: str = "",
        serial_number: str = "",
    ) -> None:
        super().__init__()
        self.port, self.baudrate = port, baudrate
        self.usb, self.serial_number = usb, serial_number
        self.baseline = baseline
        self.layout = TaxelLayout(shape, positions, channels, span)
        self.payload, self.values = payload, values
        self.limits, self.rate = _ordered(limits), rate
        self._span = np.broadcast_to(np.asarray(span, np.float64), (len(channels),))
        size = _checked(payload, self.layout.taxels, values, channels)
        self.framing = Framing(
            payload=size,
            header=hex_bytes("header", header),
            footer=hex_bytes("footer", footer),
            checksum=checksum,
            covers=covers,
            valid=self.plausible,
        )
        height, width = self.layout.shape
        # A driver's own type is the one of its class; any other name is looked up.
        known = self.spec if type == self.spec.name else spec(type)
        self.spec = replace(known, height=height, width=width, fps=fps, kind="array")
        self.rest: NDArray[np.float32] = np.zeros((self.layout.taxels, values), np.float32)

    def plausible(self, payload: bytes) -> bool:
        """Whether all values are finite and within ``limits``. A driver may check more."""
        values = self.unpack(payload)
        if not np.isfinite(values).all():
            return False
        if self.limits is not None:
            low, high = self.limits
            return bool(((values >= low) & (values <= high)).all())
        sizes = np.abs(values[:, self.layout.channels]) / self._span
        return bool(((sizes == 0) | ((sizes >= _LEAST) & (sizes <= _MOST))).all())

    def follows(self, before: Arrival | None, after: Arrival) -> bool:
        """Whether values have changed by no more than ``rate``; always true with a checksum."""
        if self.framing.checksum != "none" or self.rate == 0:
            return True
        if before is None:
            return False
        most = self._span if self.rate is None else self.rate / self.spec.fps
        return changes_by_at_most(most, before, after, self.spec.fps, self.layout.channels)

    def unpack(self, payload: bytes) -> NDArray[np.float32]:
        """Unpacks the values of a payload, float32 (taxels, values)."""
        values = np.array(struct.unpack(self.payload, payload), np.float64).astype(np.float32)
        return values.reshape(self.layout.taxels, self.values)

    def discover(self) -> list[str]:
        """Lists the ports of the USB device, if one is named; else the port, if it exists."""
        return attached_ports(self.port, self.usb, self.serial_number)

    def connect(self) -> Link:
        """Opens the port."""
        return SerialLink(self.port or self.find_port(), self.baudrate)

    def find_port(self) -> str:
        """Finds the port of the one attached device; "" where no device is named.

        Raises:
            SensorError: No such device is attached, or several are.
        """
        ports = self.discover()
        if not ports and (self.usb or self.serial_number):
            name = self.usb or self.serial_number
            raise SensorError(f"no {self.spec.name} ({name}) is attached: plug it in")
        if len(ports) > 1:
            raise SensorError(f"several {self.spec.name}: {', '.join(ports)}; choose with port=")
        return ports[0] if ports else ""

    def new_parser(self) -> Parser:
        """Builds a parser of its framing."""
        return PacketParser(self.framing)

    def ready(self) -> None:
        """Takes the baseline, and measures the rate of a ``free_running`` device.

        After a loss the old baseline stays, as something may press on the sensor by now.

        Raises:
            SensorError: Too few packets come.
        """
        end = time.monotonic() + _PATIENCE
        seen: list[NDArray[np.float32]] = []
        times: list[float] = []
        while len(seen) < self.baseline:
            try:
                frame = self.read(max(0.0, end - time.monotonic()))
            except TimeoutError as error:
                raise SensorError(
                    f"{error} Its baseline needs {self.baseline} packets, {len(seen)} came"
                ) from error
            assert frame.raw is not None
            seen.append(frame.raw)
            times.append(frame.time)
        if seen and not self.keeps_zero:
            self.rest = np.median(seen, axis=0).astype(np.float32)
        # Measured from the first packet, not from opening: a board has to boot.
        if self.free_running and len(times) > 1:
            self.set_rate((len(times) - 1) / (times[-1] - times[0]))
        self._frames.clear()  # the frames so far were drawn without the baseline

    def decode(self, payload: bytes) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Decodes the image and the raw values of a packet."""
        values = self.unpack(payload)
        return self.layout.draw(values, self.rest), values


def _ordered(limits: Sequence[float] | None) -> tuple[float, float] | None:
    if limits is None:
        return None
    if len(limits) != 2 or not limits[0] < limits[1]:
        raise ConfigError(f"limits={list(limits)}: give the lowest and the highest value")
    return float(limits[0]), float(limits[1])


def _checked(payload: str, taxels: int, values: int, channels: Sequence[int]) -> int:
    """Checks the payload against the number of taxels, and returns its size in bytes."""
    size, count = payload_size(payload)
    if count != taxels * values:
        raise ConfigError(
            f"payload={payload!r} carries {count} values, but {taxels} taxels of {values} are "
            f"{taxels * values}: correct payload, shape, positions or values"
        )
    if any(not 0 <= channel < values for channel in channels):
        raise ConfigError(
            f"channels={list(channels)}, but a taxel has {values} values: 0 to {values - 1}"
        )
    return size
