"""Checksums of packets, by name."""

from __future__ import annotations

import binascii
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from operator import xor


@dataclass(frozen=True)
class Checksum:
    """Checksum at the end of a packet.

    Attributes:
        size: Size of the checksum, bytes.
        of: Function from the covered bytes to the bytes of the checksum.
    """

    size: int
    of: Callable[[bytes], bytes]


def _crc8_table() -> list[int]:
    table = []
    for value in range(256):
        for _ in range(8):
            # the polynomial x^8 + x^2 + x + 1 of CRC-8 (SMBus), high bit first
            value = (value << 1) ^ (0x07 if value & 0x80 else 0)
        table.append(value & 0xFF)
    return table


def _modbus_table() -> list[int]:
    table = []
    for value in range(256):
        for _ in range(8):
            # 0x8005 with its bits reversed, low bit first (MODBUS over Serial Line, 6.2.2)
            value = (value >> 1) ^ (0xA001 if value & 1 else 0)
        table.append(value)
    return table


# a step a byte in place of eight: packets come up to a thousand times a second
_CRC8 = _crc8_table()
_MODBUS = _modbus_table()


def _modbus(data: bytes) -> bytes:
    # a register of ones, so that leading zero bytes count too
    crc = reduce(lambda crc, byte: (crc >> 8) ^ _MODBUS[(crc ^ byte) & 0xFF], data, 0xFFFF)
    return crc.to_bytes(2, "little")


#: Checksums by name. ``sum8`` and ``lrc8`` are the sum of the bytes and its two's complement;
#: ``crc8`` has the polynomial 0x07, ``crc16_modbus`` goes low byte first, and ``crc16_ccitt``
#: (0x1021, starts with 0xFFFF) high byte first.
CHECKSUMS = {
    "none": Checksum(0, lambda data: b""),
    "sum8": Checksum(1, lambda data: bytes([sum(data) & 0xFF])),
    "lrc8": Checksum(1, lambda data: bytes([-sum(data) & 0xFF])),
    "xor8": Checksum(1, lambda data: bytes([reduce(xor, data, 0)])),
    "crc8": Checksum(1, lambda data: bytes([reduce(lambda crc, b: _CRC8[crc ^ b], data, 0)])),
    "crc16_modbus": Checksum(2, _modbus),
    "crc16_ccitt": Checksum(2, lambda data: binascii.crc_hqx(data, 0xFFFF).to_bytes(2, "big")),
}
