"""Emulated devices: they speak a protocol over a pseudo-terminal or a loopback socket.

Authors of plugins test their drivers with them, including faults of real lines::

    with PtyDevice() as device, MySensor(port=device.port) as sensor:
        device.play(packets, fps=100, faults=Faults(split=3, garbage=0.1))
        frame = sensor.read()
"""

from __future__ import annotations

import os
import random
import select
import socket
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from tactileforge.contracts import Frame, Sensor


@dataclass(frozen=True, kw_only=True)
class Faults:
    """Faults of a line; the same seed gives the same faults.

    Attributes:
        split: Bytes written at once; 0 writes whole packets.
        merge: Number of packets written together.
        lose: Share of lost bytes, 0 to 1.
        garbage: Share of packets preceded by random bytes, 0 to 1.
        seed: Seed of the random faults.
    """

    split: int = 0
    merge: int = 1
    lose: float = 0.0
    garbage: float = 0.0
    seed: int = 0


def read_until_silent(
    sensor: Sensor, silence: float = 0.4, device: PtyDevice | None = None
) -> list[Frame]:
    """Reads frames until none has come for a while.

    Args:
        sensor: Open sensor.
        silence: Wait for a frame, s.
        device: Device whose packets are waited for, however slow; None for none.
    """
    frames = []
    while True:
        is_over = device is None or not device.is_playing
        try:
            frames.append(sensor.read(silence))
        except TimeoutError:
            if is_over:
                return frames


def chunks(packets: Iterable[bytes], faults: Faults) -> Iterator[list[bytes]]:
    """Yields a list of writes for every ``faults.merge`` packets."""
    rng = random.Random(faults.seed)
    pending = bytearray()
    for count, packet in enumerate(packets, 1):
        if rng.random() < faults.garbage:
            pending += rng.randbytes(rng.randint(1, 32))
        pending += bytes(byte for byte in packet if rng.random() >= faults.lose)
        if count % faults.merge == 0:
            yield _split(bytes(pending), faults.split)
            pending.clear()
    if pending:
        yield _split(bytes(pending), faults.split)


def _split(data: bytes, size: int) -> list[bytes]:
    step = size or max(1, len(data))
    return [data[i : i + step] for i in range(0, len(data), step)]


class _Device:
    """Plays packets in a thread and stores the bytes sent by the driver.

    Attributes:
        received: All bytes sent by the driver.
        sent: Number of packets played so far.
    """

    def __init__(self) -> None:
        self.received = bytearray()
        self.sent = 0
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []

    def write(self, data: bytes) -> None:
        """Sends bytes to the driver now."""
        raise NotImplementedError

    def play(
        self, packets: Iterable[bytes], *, fps: float = 0.0, faults: Faults | None = None
    ) -> None:
        """Sends packets from a thread of its own.

        Args:
            packets: Packets in order; may be endless.
            fps: Packets per second; 0 sends them as fast as the driver reads them.
            faults: Faults of the line; None for none.
        """
        line_faults = faults or Faults()
        step = line_faults.merge / fps if fps else 0.0
        thread = threading.Thread(target=self._play, args=(packets, line_faults, step), daemon=True)
        self._threads.append(thread)
        thread.start()

    def _play(self, packets: Iterable[bytes], faults: Faults, step: float) -> None:
        due: float | None = None
        for writes in chunks(packets, faults):
            due = time.monotonic() if due is None else due  # the first packet starts the clock
            for data in writes:
                if self._stop.is_set():
                    return
                try:
                    self.write(data)
                except OSError:
                    return
            self.sent += faults.merge
            due += step
            if self._stop.wait(max(0.0, due - time.monotonic())):
                return

    @property
    def is_playing(self) -> bool:
        """Whether packets given to `play` are still to be sent."""
        return any(thread.is_alive() for thread in self._threads)

    def wait(self, timeout: float = 10.0) -> None:
        """Waits until all packets given to `play` are sent."""
        for thread in self._threads:
            thread.join(timeout)

    def halt(self) -> None:
        """Ends playing."""
        self._stop.set()
        for thread in self._threads:
            thread.join(5.0)
        self._threads.clear()
        self._stop.clear()  # it may play again

    def close(self) -> None:
        """Ends everything."""
        self.halt()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class PtyDevice(_Device):
    """A device on a serial port.

    Attributes:
        port: Path of the port; it stays the same when the device is plugged in again.
    """

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory()
        self.port = str(Path(self._folder.name) / "ttyTEST")
        self._ours = -1
        self.connect()

    def connect(self) -> None:
        """Plugs the device in."""
        import tty

        self._ours, theirs = os.openpty()
        tty.setraw(theirs)
        os.set_blocking(self._ours, False)
        self._theirs = theirs  # kept open: a pseudo-terminal hangs up when its last user closes it
        Path(self.port).unlink(missing_ok=True)
        os.symlink(os.ttyname(theirs), self.port)

    def disconnect(self) -> None:
        """Unplugs the device: the port disappears, and a driver using it gets an error."""
        self.halt()
        if self._ours >= 0:
            Path(self.port).unlink(missing_ok=True)
            os.close(self._ours)
            os.close(self._theirs)
            self._ours = -1

    def write(self, data: bytes) -> None:
        """Sends bytes, waiting while the driver does not read, and stores the driver's bytes."""
        left = memoryview(data)
        while left and not self._stop.is_set():
            # not for ever: `halt` ends a write to a driver that does not read
            readable, writable, _ = select.select([self._ours], [self._ours], [], 0.05)
            if readable:
                self.received += os.read(self._ours, 65536)
            if writable:
                left = left[os.write(self._ours, left) :]

    def poll(self) -> bytes:
        """All bytes sent by the driver."""
        while select.select([self._ours], [], [], 0.0)[0]:
            self.received += os.read(self._ours, 65536)
        return bytes(self.received)

    def close(self) -> None:
        """Unplugs the device for good."""
        self.disconnect()
        self._folder.cleanup()


class UdpDevice(_Device):
    """A UDP device. It sends to the address of the last datagram it received.

    Attributes:
        host: Address of the device.
        port: Port of the device.
    """

    def __init__(self) -> None:
        super().__init__()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.host, self.port = self._socket.getsockname()
        self._peer: Any = None

    def wait_for_driver(self, timeout: float = 5.0) -> bytes:
        """The next datagram of the driver."""
        self._socket.settimeout(timeout)
        data, self._peer = self._socket.recvfrom(65536)
        self.received += data
        return data

    def write(self, data: bytes) -> None:
        """Sends one datagram; waits for a datagram of a driver first."""
        if self._peer is None:
            self.wait_for_driver()
        self._socket.sendto(data, self._peer)

    def close(self) -> None:
        """Switches it off."""
        super().close()
        self._socket.close()


class TcpDevice(_Device):
    """A TCP device for one driver at a time.

    Attributes:
        host: Address of the device.
        port: Port of the device.
    """

    def __init__(self) -> None:
        super().__init__()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.host, self.port = self._server.getsockname()
        self._peer: socket.socket | None = None

    def write(self, data: bytes) -> None:
        """Sends bytes; waits for a driver to connect first."""
        if self._peer is None:
            self._server.settimeout(5.0)
            self._peer, _ = self._server.accept()
        self._peer.sendall(data)

    def read(self, size: int, timeout: float = 5.0) -> bytes:
        """Reads the next bytes of the driver, at most ``size``."""
        if self._peer is None:
            self.write(b"")
        assert self._peer is not None
        self._peer.settimeout(timeout)
        data = self._peer.recv(size)
        self.received += data
        return data

    def disconnect(self) -> None:
        """Ends the connection; another may follow."""
        self.halt()
        if self._peer is not None:
            self._peer.close()
            self._peer = None

    def close(self) -> None:
        """Switches it off."""
        self.disconnect()
        self._server.close()
