"""Robotiq FT 300: forces and torques, streamed over a serial port at 100 Hz.

The stream is switched on by writing 0x0200 to register 410 over Modbus RTU, and off by sending 0xFF
fifty times. A packet is ``20 4E``, six little-endian 16-bit integers (forces in N / 100, torques in
N m / 1000), and the checksum of Modbus over all bytes before it.
"""

from __future__ import annotations

import time
from dataclasses import replace

from tactileforge.sensors import ForceTorque, Link
from tactileforge_ft import modbus

#: Number of the device on the line; register and value to switch the stream on.
SLAVE, REGISTER, STREAM = 9, 410, 0x0200
#: Byte to switch the stream off, its repetitions, and the pause between them, s: 0.5 s in all.
INTERRUPT, TIMES, PAUSE = b"\xff", 50, 0.01
#: Longest wait for an answer, and silence at the end of a stream, s.
TIMEOUT, SILENCE = 1.0, 0.05


class Robotiq(ForceTorque):
    """A Robotiq FT 300 (or FT 150), with forces and torques unchanged, in N and N m.

    Args:
        port: Path of the serial port, for example ``/dev/ttyUSB0``.
        baudrate: Bits a second.
        usb: Vendor and product of the USB adapter, for example ``0403:6015``, to find the port by.
    """

    spec = replace(ForceTorque.spec, name="robotiq")

    def __init__(self, port: str = "", baudrate: int = 19200, usb: str = "") -> None:
        super().__init__(
            port=port,
            payload="<6h",
            scale=(0.01, 0.01, 0.01, 0.001, 0.001, 0.001),
            header="204e",
            checksum="crc16_modbus",
            fps=self.spec.fps,
            baudrate=baudrate,
            usb=usb,
        )

    def start(self, link: Link) -> None:
        """Ends a stream left on by another program, and begins a new one.

        Raises:
            SensorError: The device refuses, or does not answer.
        """
        self.stop(link)
        end = time.monotonic() + TIMEOUT
        while link.receive(SILENCE) and time.monotonic() < end:
            pass
        first = modbus.write(link, SLAVE, REGISTER, STREAM, TIMEOUT)
        assert self.parser is not None
        self.take(self.parser, first)

    def stop(self, link: Link) -> None:
        """Ends the stream."""
        for _ in range(TIMES):
            link.send(INTERRUPT)
            time.sleep(PAUSE)
