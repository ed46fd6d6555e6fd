"""The part of Modbus RTU needed to write a register."""

from __future__ import annotations

import struct
import time
from collections.abc import Sequence

from tactileforge.errors import SensorError
from tactileforge.sensors import CHECKSUMS, Link

#: The function "write registers", and the bit of a refusing reply.
WRITE, REFUSED = 0x10, 0x80
_CRC = CHECKSUMS["crc16_modbus"]


def packet(body: bytes) -> bytes:
    """Appends the checksum to a message."""
    return body + _CRC.of(body)


def write_request(slave: int, register: int, values: Sequence[int]) -> bytes:
    """Packs a request to write 16-bit values to consecutive registers."""
    head = struct.pack(">BBHHB", slave, WRITE, register, len(values), 2 * len(values))
    return packet(head + struct.pack(f">{len(values)}H", *values))


def write_reply(slave: int, register: int, count: int) -> bytes:
    """Expected reply to a write of ``count`` values."""
    return packet(struct.pack(">BBHH", slave, WRITE, register, count))


def write(link: Link, slave: int, register: int, value: int, timeout: float) -> bytes:
    """Writes one register.

    Args:
        link: Open link to the device.
        slave: Number of the device on the line.
        register: Number of the register.
        value: Value to write, 16 bits.
        timeout: Longest wait for the answer, s.

    Returns:
        Bytes received after the answer.

    Raises:
        SensorError: The device refuses, or does not answer in time.
    """
    link.send(write_request(slave, register, [value]))
    accepted = write_reply(slave, register, 1)
    refused = bytes([slave, WRITE | REFUSED])
    end, seen = time.monotonic() + timeout, b""
    while (left := end - time.monotonic()) > 0:
        seen += link.receive(left)
        # The answer is searched, as bytes of an older stream may stand before it.
        _, answer, rest = seen.partition(accepted)
        if answer:
            return rest
        place = seen.find(refused)
        if place >= 0 and seen[place : place + 5] == packet(seen[place : place + 3]):
            raise SensorError(
                f"{link.address}: refuses to write register {register} (Modbus exception "
                f"{seen[place + 2]}); is it the sensor that was asked for?"
            )
    raise SensorError(
        f"{link.address}: no answer within {timeout:g} s ({len(seen)} bytes came); has the sensor "
        "power, and is it this port?"
    )
