"""Reading: how much is decoded, how much memory recordings cost, how fast clips come.

- Frames decoded against frames that clips asked for, on a video that is made here.
- Resident memory with 1,000 and with 20,000 recordings of noise, after reading
  the same number of clips from each, in a process of its own.
- Clips a second from one process, cold and from the cache.

Run: python benchmarks/data.py
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from common import save
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data.clips import Clips
from tactileforge.data.frames import VideoFrames

CUT: dict[str, Any] = {"frames": 4, "spacing": 1 / 15, "hop": 0.2, "size": (224, 224)}


class Noise:
    """Frames that are made when they are read."""

    shape = (64, 64)

    def __len__(self) -> int:
        return 90

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Makes; see `contracts.Frames.read`."""
        return np.random.default_rng(0).integers(0, 256, (len(indices), 64, 64, 3), np.uint8)


def noise(number: int) -> Recording:
    """A recording of three seconds, with the labels of a force trial."""
    return Recording(
        key=f"noise/{number}",
        sensor="digit",
        frames=Noise(),
        times=np.arange(90) / 30,
        no_contact=None,
        force=np.zeros((90, 3), np.float32),
        action=np.zeros(90, np.int64),
        object=f"object {number % 50}",
        text="{action} it",
    )


def memory(recordings: int) -> dict[str, float]:
    """Megabytes after indexing, and after reading 2,000 clips with a cache of 64 MB."""
    clips = Clips(map(noise, range(recordings)), **CUT, cache_mb=64)
    indexed = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    for clip in np.random.default_rng(0).integers(len(clips), size=2000):
        clips[int(clip)]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"indexed_mb": round(indexed, 1), "peak_mb": round(peak, 1), "clips": len(clips)}


def in_own_process(recordings: int) -> dict[str, float]:
    """`memory` in a fresh interpreter."""
    command = [sys.executable, __file__, str(recordings)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    result: dict[str, float] = json.loads(done.stdout)
    return result


class Counting(VideoFrames):
    """A video that counts the frames it is asked for."""

    asked = 0

    def read(self, indices: Any) -> Any:
        """Counts, then decodes."""
        Counting.asked += len(indices)
        return super().read(indices)


def video(path: Path, frames: int) -> None:
    """Writes a video of moving noise, 320 x 240."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30, (320, 240))
    noise = np.random.default_rng(0).integers(0, 255, (240, 320 + frames, 3), np.uint8)
    for i in range(frames):
        writer.write(np.ascontiguousarray(noise[:, i : i + 320]))
    writer.release()


def decoding() -> dict[str, float]:
    """Clips a second from one video, and what was decoded for them."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "touch.mp4"
        video(path, 300)
        frames = Counting(path)
        recording = Recording(
            key="touch",
            sensor="digit",
            frames=frames,
            times=np.arange(300) / 30,
            no_contact=None,
        )
        clips = Clips([recording], **CUT)
        order = np.random.default_rng(0).permutation(len(clips))[:20]
        wanted = {int(row) for clip in order for row in clips.rows(int(clip))}
        rates = []
        for _ in range(2):
            start = time.perf_counter()
            for clip in order:
                clips[int(clip)]
            rates.append(len(order) / (time.perf_counter() - start))
        return {
            "frames of the video": 300,
            "different frames in the clips": len(wanted),
            "frames decoded": Counting.asked,
            "clips a second, cold": round(rates[0], 1),
            "clips a second, cached": round(rates[1], 1),
        }


def main() -> None:
    if len(sys.argv) > 1:
        print(json.dumps(memory(int(sys.argv[1]))))
        return
    few, many = in_own_process(1_000), in_own_process(20_000)
    growth = (many["indexed_mb"] - few["indexed_mb"]) * 2**20 / 19_000
    save(
        "data",
        {
            "what": "reading clips of 4 frames at 224 x 224",
            "decoding": decoding(),
            "memory, 1000 recordings": few,
            "memory, 20000 recordings": many,
            "bytes a recording costs (its labels; no frames)": round(growth),
        },
    )


if __name__ == "__main__":
    main()
