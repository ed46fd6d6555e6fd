"""Byte links: serial ports and sockets behind one small interface with named errors."""

from __future__ import annotations

import os
import socket
from pathlib import Path
from typing import Any, Protocol

from tactileforge.errors import ConfigError, SensorError


class Link(Protocol):
    """An open connection to a device."""

    address: str

    def receive(self, timeout: float) -> bytes:
        """Receive bytes, at least one; b"" if none arrives within ``timeout`` seconds.

        Raises:
            SensorError: The device is gone.
        """
        ...

    def send(self, data: bytes) -> None:
        """Send bytes.

        Raises:
            SensorError: The device is gone.
        """
        ...

    def close(self) -> None:
        """Close the connection; a second call does nothing."""
        ...


class SerialLink:
    """A serial port.

    Args:
        port: Path of the port, for example ``/dev/ttyUSB0``.
        baudrate: Bits a second.

    Raises:
        ConfigError: No port is given.
        SensorError: The port is absent, busy, or not ours to open.
    """

    def __init__(self, port: str, baudrate: int = 115200) -> None:
        if not port:
            raise ConfigError("a serial sensor has no port: set its port=, e.g. port=/dev/ttyUSB0")
        import serial

        self.address = os.path.realpath(port)
        # TypeError: pyserial reads from a descriptor that is None once the port is closed meanwhile
        self._failed = (serial.SerialException, OSError, TypeError)
        try:
            # exclusive: two readers of one port would each get a part of the bytes
            self._port: Any = serial.Serial(port, baudrate, timeout=0, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as error:
            raise SensorError(_explain_failure(port, error)) from error
        # bytes from before the opening have no time
        self._port.reset_input_buffer()
        self.unit = serial_number_of(self.address)

    def receive(self, timeout: float) -> bytes:
        """Receive bytes; see `Link.receive`."""
        try:
            self._port.timeout = timeout
            # one byte to wait for, then all that came with it: read(n) would wait for n bytes
            first: bytes = self._port.read(1)
            waiting = self._port.in_waiting if first else 0
            return first + self._port.read(waiting) if waiting else first
        except self._failed as error:
            raise SensorError(f"{self.address}: unplugged ({error}); plug it in again") from error

    def send(self, data: bytes) -> None:
        """Send bytes; see `Link.send`."""
        try:
            self._port.write(data)
        except self._failed as error:
            raise SensorError(f"{self.address}: unplugged ({error}); plug it in again") from error

    def close(self) -> None:
        """Release the port."""
        self._port.close()


def _explain_failure(port: str, error: Exception) -> str:
    if not os.path.exists(port):
        there = ", ".join(serial_ports()) or "none"
        return f"{port}: no such serial port; plug the sensor in, or set port= (found: {there})"
    if not os.access(port, os.R_OK | os.W_OK):
        return f"{port}: not yours to open; add yourself to its group (ls -l {port})"
    return f"{port}: cannot be opened ({error}); is another program using it?"


def serial_ports(usb: str = "", serial_number: str = "") -> list[str]:
    """Attached serial ports, sorted.

    Args:
        usb: Vendor and product of the device, for example ``2833:4001``; "" for any.
        serial_number: Serial number of the device; "" for any.
    """
    from serial.tools.list_ports import comports

    ports = []
    for port in comports():
        ids = "" if port.vid is None else f"{port.vid:04x}:{port.pid:04x}"
        if usb.lower() in ("", ids) and serial_number in ("", port.serial_number):
            ports.append(port.device)
    return sorted(ports)


def serial_number_of(path: str) -> str:
    """Serial number of the device at a serial port; "" for none."""
    from serial.tools.list_ports import comports

    known = (port.serial_number for port in comports() if os.path.realpath(port.device) == path)
    return next(known, None) or ""


def attached_ports(port: str, usb: str = "", serial_number: str = "") -> list[str]:
    """Ports of the USB device if one is named; else the port if it exists.

    Args:
        port: Path of the port.
        usb: Vendor and product of the device, for example ``2833:4001``; "" for any.
        serial_number: Serial number of the device; "" for any.

    Example:
        >>> attached_ports("/dev/no-such-port")
        []
    """
    if usb or serial_number:
        return serial_ports(usb, serial_number)
    return [port] if port and Path(port).exists() else []


class UdpLink:
    """Datagrams to and from one device; `receive` returns them one by one.

    Args:
        host: Name or address of the device; "" takes datagrams to ``listen`` from anybody.
        port: Port of the device.
        listen: Port of this machine; 0 takes a free one.

    Raises:
        SensorError: There is no such host, or the port of this machine is taken.
    """

    def __init__(self, host: str, port: int = 0, listen: int = 0) -> None:
        self.address = f"udp:{host}:{port}" if host else f"udp:{listen}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("", listen))
            if host:
                self._socket.connect((host, port))
        except OSError as error:
            self._socket.close()
            raise SensorError(f"{self.address}: {error}; correct its host= and port=") from error

    def receive(self, timeout: float) -> bytes:
        """Receive bytes; see `Link.receive`."""
        return _received(self._socket, self.address, timeout) or b""

    def send(self, data: bytes) -> None:
        """Send bytes; see `Link.send`."""
        _send(self._socket, self.address, data)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class TcpLink:
    """A stream of bytes from a server.

    Args:
        host: Name or address of the device.
        port: Port of the device.
        timeout: Longest wait for the connection, s.

    Raises:
        SensorError: The device does not answer.
    """

    def __init__(self, host: str, port: int, timeout: float = 3.0) -> None:
        self.address = f"tcp:{host}:{port}"
        try:
            self._socket = socket.create_connection((host, port), timeout)
        except OSError as error:
            raise SensorError(
                f"{self.address}: does not answer ({error}); is it on, and are host= and port= "
                "right?"
            ) from error

    def receive(self, timeout: float) -> bytes:
        """Receive bytes; see `Link.receive`."""
        data = _received(self._socket, self.address, timeout)
        if data == b"":
            raise SensorError(f"{self.address}: has ended the connection; is it still on?")
        return data or b""

    def send(self, data: bytes) -> None:
        """Send bytes; see `Link.send`."""
        _send(self._socket, self.address, data)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _received(link: socket.socket, address: str, timeout: float) -> bytes | None:
    """Receive bytes; None if none arrives, b"" at the end of a stream."""
    try:
        link.settimeout(max(timeout, 1e-4))  # 0 would make the socket non-blocking
        return link.recv(65536)
    except TimeoutError:
        return None
    except OSError as error:
        raise SensorError(f"{address}: gone ({error}); is it on, and connected?") from error


def _send(link: socket.socket, address: str, data: bytes) -> None:
    try:
        link.sendall(data)
    except OSError as error:
        raise SensorError(f"{address}: gone ({error}); is it on, and connected?") from error
