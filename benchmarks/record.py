"""Recording of four cameras at 30 Hz and a wrench sensor at 1 kHz: drops, times, memory.

The cameras are synthetic: each picture carries its number and is due at a known time, and is
stamped when it is read, as from a driver without a clock. A reader more than four frames late
loses the oldest, as with the buffers of a driver. The wrench sensor is a process on a
pseudo-terminal; each packet carries its number and its time of sending.
"""

from __future__ import annotations

import argparse
import multiprocessing as mp
import struct
import tempfile
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Self

import numpy as np
from common import Memory, save
from numpy.typing import NDArray
from tactileforge_live.record.options import RecordOptions
from tactileforge_live.record.raw import read_raw
from tactileforge_live.record.record import record

from tactileforge.contracts import Frame, Recording, SensorSpec
from tactileforge.data.shards import shards
from tactileforge.sensors import CHECKSUMS, Background, ForceTorque
from tactileforge.testing.emulators import PtyDevice

#: Buffers of a driver; side of a bit of the frame's number, pixels; and number of bits.
BUFFERS, BIT, BITS = 4, 8, 16
HEADER, CHECKSUM = b"\x20\x4e", "crc16_modbus"
FPS = 30.0
#: Numbers of wrenches that are told apart: a force of their size has to be plausible, N.
MODULUS = 1000


class SyntheticCamera:
    """A camera with the number of a frame in its picture.

    Args:
        seed: Seed of its pictures.
        size: Height and width, pixels.
    """

    def __init__(self, seed: int, size: tuple[int, int]) -> None:
        height, width = size
        self.spec = SensorSpec(
            name="digit",
            height=height,
            width=width,
            fps=FPS,
            area_mm=None,
            force_scale=(1.0, 1.0, 1.0),
        )
        rng = np.random.default_rng(seed)
        shade = np.linspace(90, 160, width)[None, :, None] + rng.normal(0, 3, (9, height, width, 3))
        self._bank = shade.clip(0, 255).astype(np.uint8)
        self.start, self.number, self.lost = 0.0, 0, 0

    def discover(self) -> list[str]:
        """Returns an empty list: there is no device."""
        return []

    def open(self) -> None:
        """Starts the clock."""
        self.start, self.number = time.monotonic(), 0

    def read(self, timeout: float = 1.0) -> Frame:
        """The next frame, or the oldest one left in the buffers."""
        due = self.start + self.number / FPS
        late = int((time.monotonic() - due) * FPS) - BUFFERS
        if late > 0:
            self.number += late
            self.lost += late
            due += late / FPS
        time.sleep(max(0.0, due - time.monotonic()))
        taken = time.monotonic()
        array = self._bank[self.number % len(self._bank)].copy()
        bits = self.number >> np.arange(BITS) & 1
        array[:BIT, : BITS * BIT] = np.repeat(bits * 255, BIT)[None, :, None]
        self.number += 1
        return Frame(array=array, time=taken)

    def close(self) -> None:
        """Does nothing."""

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def number_of(picture: NDArray[np.uint8]) -> int:
    """The number in a picture."""
    bits = picture[: BIT - 1, : BITS * BIT].mean(axis=(0, 2)).reshape(BITS, BIT).mean(1) > 127
    return int((bits << np.arange(BITS)).sum())


def packets(rate: float, start: float) -> Iterator[bytes]:
    """Yields packets of wrenches with their number (Fx, modulo) and their delay in ms (Fy)."""
    number = 0
    while True:
        late = time.monotonic() - start - number / rate
        body = HEADER + struct.pack("<6f", number % MODULUS, late * 1e3, 0, 0, 0, 0)
        yield body + CHECKSUMS[CHECKSUM].of(body)
        number += 1


def emulate(rate: float, pipe: Connection) -> None:
    """Entry point of the wrench sensor's process."""
    with PtyDevice() as device:
        start = time.monotonic()
        pipe.send((device.port, start))
        device.play(packets(rate, start), fps=rate)
        pipe.recv()


def errors_ms(seen: NDArray[np.float64], true: NDArray[np.float64]) -> dict[str, float]:
    late = np.abs(seen - true) * 1e3
    at = {"p50": 50, "p99": 99, "max": 100}
    return {name: round(float(np.percentile(late, share)), 3) for name, share in at.items()}


def of_camera(recording: Recording, camera: SyntheticCamera) -> dict[str, Any]:
    numbers = np.array(
        [number_of(recording.frames.read([i])[0]) for i in range(len(recording.frames))]
    )
    seen = recording.times + float(recording.labels["clock"])
    return {
        "frames": len(numbers),
        "missing": int(numbers[-1] - numbers[0] + 1 - len(numbers)),
        "lost_before_read": camera.lost,
        "error_ms": errors_ms(seen, camera.start + numbers / FPS),
    }


def of_force(path: Path, clock: float, start: float, rate: float) -> dict[str, Any]:
    times, wrenches = read_raw(path)["force"]
    numbers = np.unwrap(wrenches[:, 0].astype(np.float64), period=MODULUS)
    sent = start + numbers / rate + wrenches[:, 1].astype(np.float64) / 1e3
    return {
        "samples": len(times),
        "missing": int(numbers[-1] - numbers[0] + 1 - len(numbers)),
        "error_ms": errors_ms(times + clock, sent),
    }


def measure(seconds: float, cameras: int, size: tuple[int, int], rate: float) -> dict[str, Any]:
    ours, theirs = mp.get_context("spawn").Pipe()
    source = mp.get_context("spawn").Process(target=emulate, args=(rate, theirs), daemon=True)
    source.start()
    port, start = ours.recv()
    force = ForceTorque(
        port, payload="<6f", header=HEADER.hex(), checksum=CHECKSUM, fps=rate, baudrate=460800
    )
    eyes = {f"camera{i}": SyntheticCamera(i, size) for i in range(cameras)}
    with tempfile.TemporaryDirectory() as folder:
        options = RecordOptions(out=folder, seconds=seconds, background=Background(seconds=0.0))
        used = time.process_time()
        with Memory(max(0.2, seconds / 100)) as memory:
            found = record(options, eyes, force)
        used = time.process_time() - used
        ours.send("end")
        path = next(Path(folder).glob("train-*.tar"))
        recordings = {str(one.labels["device"]): one for one in shards.read_shard(path)}
        clock = float(next(iter(recordings.values())).labels["clock"])
        tenths = np.linspace(0.1, 1, 10) * (len(memory.mb) - 1)
        return {
            "seconds": found.seconds,
            "size": list(size),
            "dropped": found.dropped,
            "cameras": {key: of_camera(recordings[key], eye) for key, eye in eyes.items()},
            "force": of_force(path, clock, start, rate),
            "written_mb": round(found.bytes / 2**20, 1),
            "cpu_share": round(used / seconds, 3),
            "rss_mb": {
                "each_tenth": [round(memory.mb[int(i)], 1) for i in tenths],  # the last one joins
                "max": round(max(memory.mb), 1),
            },
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--cameras", type=int, default=4)
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240), help="height and width")
    parser.add_argument("--rate", type=float, default=1000.0, help="of the wrench sensor, Hz")
    given = parser.parse_args()
    height, width = given.size
    save("record", measure(given.seconds, given.cameras, (height, width), given.rate))


if __name__ == "__main__":
    main()
