"""Packing: frames per second and core, and the share of the time outside both codecs.

Simulated presses on a DIGIT, 320 x 240, are stored as JPEG files, like published data. They are
packed by us, and in a plain way: Pillow decodes and encodes, `webdataset.TarWriter` writes. Both
run in this process, on one thread, at JPEG quality 95. CPU time counts, so other programs matter
little; the files are in the page cache.

Run: python benchmarks/packing.py
"""

from __future__ import annotations

import io
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import webdataset
from common import ratio, save
from numpy.typing import NDArray
from PIL import Image
from tactileforge_sim.dataset import Sim

from tactileforge.contracts import Recording
from tactileforge.data import ImageFrames
from tactileforge.data.shards import shards
from tactileforge.packing import Filter, PackOptions, work
from tactileforge.packing.plan import plan_pack

ROUNDS = 9


class Presses:
    """Simulated presses, as JPEG files.

    Args:
        folder: Folder of the files.
    """

    provides = frozenset({"force", "object"})

    def __init__(self, folder: Path) -> None:
        self.skipped: list[str] = []
        self.found: list[Recording] = []
        sim = Sim(scenes=6, val=0, sensors=["digit"], size=240, motions="force_trial")
        for number, one in enumerate(sim.recordings("train")):
            paths = []
            for i, frame in enumerate(one.frames.read(range(len(one.frames)))):
                paths.append(folder / f"{number:03d}_{i:04d}.jpg")
                paths[-1].write_bytes(shards.encode_image(frame))
            frames = ImageFrames(paths)
            self.found.append(
                Recording(
                    key=one.key,
                    sensor=one.sensor,
                    frames=frames,
                    times=one.times,
                    no_contact=ImageFrames(paths[:1]),
                    force=one.force,
                    object=one.object,
                )
            )

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields all presses for ``train``."""
        yield from self.found if split == "train" else []

    def plot(self, recording: Recording) -> Any:
        """Does nothing: packing makes no figures."""


class Clock:
    """Wrapper of a function with a sum of its CPU seconds."""

    def __init__(self, function: Any) -> None:
        self.function = function
        self.seconds = 0.0

    def __call__(self, *given: Any) -> Any:
        """Calls the function."""
        start = time.process_time()
        try:
            return self.function(*given)
        finally:
            self.seconds += time.process_time() - start


def ours(presses: Presses, out: Path, options: PackOptions) -> None:
    """Writes one shard, with checksums and index entry."""
    (job,) = plan_pack(presses, out, options).jobs
    work.make_shard(job)


def plain(presses: Presses, out: Path) -> None:
    """Writes the same files and labels in the plain way, without checksums."""
    with webdataset.TarWriter(str(out / "plain.tar")) as tar:
        for number, one in enumerate(presses.found):
            assert isinstance(one.frames, ImageFrames)
            sample: dict[str, Any] = {
                "__key__": f"{number:06d}",
                "json": json.dumps(shards.describe_recording(one)).encode(),
                "background.jpg": encoded(one.frames.paths[0]),
            }
            for i, path in enumerate(one.frames.paths):
                sample[f"{i:04d}.jpg"] = encoded(path)
            tar.write(sample)


def encoded(path: str) -> bytes:
    """A picture, decoded and encoded again by Pillow."""
    file = io.BytesIO()
    with Image.open(path) as image:
        image.convert("RGB").save(file, "JPEG", quality=95)
    return file.getvalue()


def shares(presses: Presses, out: Path, options: PackOptions) -> dict[str, float]:
    """Shares of decoding, encoding and the rest in the time; the median of `ROUNDS` rounds."""
    found = []
    for _ in range(ROUNDS):
        decode, encode = Clock(ImageFrames.read), Clock(shards.encode_image)
        read: Any = lambda frames, rows, decode=decode: decode(frames, rows)  # noqa: E731
        before = ImageFrames.read, shards.encode_image
        ImageFrames.read, shards.encode_image = read, encode  # type: ignore[method-assign,assignment]
        start = time.process_time()
        ours(presses, out, options)
        total = time.process_time() - start
        ImageFrames.read, shards.encode_image = before  # type: ignore[method-assign]
        found.append((1 - (decode.seconds + encode.seconds) / total, decode.seconds / total))
    rest, decoding = sorted(found)[len(found) // 2]
    return {
        "decoding": round(decoding, 3),
        "encoding": round(1 - rest - decoding, 3),
        "neither": round(rest, 3),
    }


def frames_of(presses: Presses) -> int:
    """Number of frames."""
    return sum(len(one.frames) for one in presses.found)


def bare(presses: Presses, shown: NDArray[np.uint8]) -> dict[str, float]:
    """Milliseconds per frame of the codecs alone."""
    paths = [path for one in presses.found for path in one.frames.paths]  # type: ignore[attr-defined]

    def decode() -> None:
        for path in paths[:200]:
            with Image.open(path) as image:
                image.convert("RGB")

    def encode() -> None:
        for picture in shown:
            cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])

    times = core_seconds({"decode": decode, "encode": encode})
    return {
        "Pillow decodes, ms": round(times["decode"]["median_s"] / 200 * 1e3, 3),
        "OpenCV encodes, ms": round(times["encode"]["median_s"] / len(shown) * 1e3, 3),
    }


def core_seconds(subjects: dict[str, Callable[[], None]]) -> dict[str, dict[str, float]]:
    """CPU seconds of each subject; all run in turn, once a round."""
    found: dict[str, list[float]] = {name: [] for name in subjects}
    for number in range(1 + ROUNDS):
        for name, subject in subjects.items():
            start = time.process_time()
            subject()
            if number:  # the first round warms up
                found[name].append(time.process_time() - start)
    return {
        name: {"min_s": min(own), "median_s": statistics.median(own), "max_s": max(own)}
        for name, own in found.items()
    }


def main() -> None:
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        presses = Presses(folder)
        count = frames_of(presses)
        every, moving = PackOptions(), PackOptions(filter=Filter(laplacian=1e-3))
        times = core_seconds(
            {
                "ours": lambda: ours(presses, folder / "a", every),
                "ours, scored, all kept": lambda: ours(presses, folder / "b", moving),
                "plain": lambda: plain(presses, folder),
            }
        )
        shown = presses.found[0].frames.read(range(50))
        save(
            "packing",
            {
                "what": "packing JPEG files of 320 x 240 to shards, one process, one thread",
                "frames": count,
                "times": times,
                "frames a second of a core": {
                    name: round(count / row["median_s"]) for name, row in times.items()
                },
                "times as fast as the plain way": ratio(times, "ours", "plain"),
                "shares of the time": shares(presses, folder / "c", every),
                "shares of the time, scored": shares(presses, folder / "d", moving),
                "codecs alone": bare(presses, shown),
            },
        )


if __name__ == "__main__":
    main()
