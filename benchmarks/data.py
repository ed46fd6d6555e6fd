"""Reading: clips from shards against a plain loader; memory and first batch of a large stream.

- Clips per second on one core, from shards of simulated DIGIT frames (320 x 240, JPEG of quality
  95), beside a published loader: PIL decodes four frames and the background of each clip; they are
  converted to float, the background is subtracted, and the result is clamped, resized with
  antialiasing and normalised. Ours are timed to uint8 leaving the worker; the remaining steps run
  once a batch, on the device.
- Seconds to read the index and to the first batch, and resident memory after 300 batches, of
  1,000 to 1,000,000 recordings of 20 s: 100 clips each. The index is real; its shards are one file
  under many names, so checksums are not compared. Each size is measured in a process of its own.
- Frames decoded for the frames requested by the clips of a video.

Run: python data.py
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

# Before the imports: OpenMP reads it when it is loaded.
os.environ["OMP_NUM_THREADS"] = "1"

import cv2
import numpy as np
import torch
from common import memory_mb, save, side_by_side
from numpy.typing import NDArray
from PIL import Image
from tactileforge_sim.dataset import Sim
from torch.nn import functional as F

from tactileforge.contracts import Recording
from tactileforge.data import Clips, Index, IndexEntry, ShardFolder, TouchData, VideoFrames, collate
from tactileforge.data.shards import shards
from tactileforge.datasets import Shards
from tactileforge.encoders import CLIP_MEAN, CLIP_STD

#: Frames of a recording of a large stream: 20 s.
FRAMES = 600
CUT: dict[str, Any] = {"frames": 4, "spacing": 1 / 15, "hop": 0.2}
ROUNDS = 5


def plain_way(clips: Clips) -> Callable[[int], torch.Tensor]:
    """A function from a clip's number to float (4, 3, 224, 224), with decoding on request."""
    mean, std = (torch.tensor(each).view(3, 1, 1) for each in (CLIP_MEAN, CLIP_STD))

    def tensor(raw: bytes) -> torch.Tensor:
        with Image.open(io.BytesIO(raw)) as opened:
            array = np.array(opened.convert("RGB"))
        return torch.from_numpy(array).permute(2, 0, 1).float() / 255

    def clip(number: int) -> torch.Tensor:
        recording = clips.recordings[clips.index[number, 0]]
        assert isinstance(recording.frames, shards.PackedFrames)
        assert isinstance(recording.no_contact, shards.PackedFrames)
        background = tensor(recording.no_contact.encoded(0))
        frames = []
        for row in clips.rows(number):
            frame = tensor(recording.frames.encoded(int(row)))
            frame = (frame - background + 130 / 255).clamp(0, 1)[None]
            frame = F.interpolate(frame, (224, 224), mode="bilinear", antialias=True)[0]
            frames.append((frame - mean) / std)
        return torch.stack(frames)

    return clip


def loaders() -> dict[str, Any]:
    """Milliseconds per clip on one core, ours beside the plain loader, on the same clips."""
    data = Sim(scenes=24, val=0, sensors=["digit"], size=240)
    recordings = [replace(one, image=None) for one in data.recordings("train")]
    every = {**CUT, "hop": 1 / 30}
    few = len(Clips(recordings, **CUT, size=(224, 224)))
    many = len(Clips(recordings, **every, size=(224, 224)))

    def ours(size: tuple[int, int], cut: dict[str, Any], cache_mb: float) -> Callable[[], object]:
        order = np.random.default_rng(0).permutation(many if cut is every else few)

        def read() -> object:
            clips = Clips(recordings, **cut, size=size, cache_mb=cache_mb)
            batches = range(0, len(order), 50)
            return [len(collate([clips[int(n)] for n in order[i : i + 50]])) for i in batches]

        return read

    plain = plain_way(Clips(recordings, **CUT, size=(224, 224)))
    backgrounds = 8  # MB: enough for all backgrounds, and hardly any frame
    subjects = {
        "plain way": (
            lambda: [plain(number) for number in range(0, few, 2)],
            len(range(0, few, 2)),
        ),
        "320 x 240": (ours((240, 320), CUT, backgrounds), few),
        "resized to 224 x 224": (ours((224, 224), CUT, backgrounds), few),
        "320 x 240, frames kept": (ours((240, 320), CUT, 1024), few),
        "resized, frames kept": (ours((224, 224), CUT, 1024), few),
        "320 x 240, a clip at every frame, frames kept": (ours((240, 320), every, 1024), many),
        "resized, a clip at every frame, frames kept": (ours((224, 224), every, 1024), many),
    }
    times = side_by_side({name: read for name, (read, _) in subjects.items()}, ROUNDS)
    each = {name: times[name]["median_s"] / count for name, (_, count) in subjects.items()}
    return {
        "frames": "simulated DIGIT, 320 x 240, JPEG of quality 95; clips 0.2 s apart unless said",
        "clips": {name: count for name, (_, count) in subjects.items()},
        "milliseconds a clip": {name: round(1000 * value, 3) for name, value in each.items()},
        "times as fast as the plain way": {
            name: round(each["plain way"] / value, 2)
            for name, value in each.items()
            if name != "plain way"
        },
        "times": times,
    }


def fake(folder: Path, recordings: int, each: int = 100) -> None:
    """Shards of ``each`` recordings of 20 s: one file under many names."""
    first = folder / "train-000000.tar"
    write(first, range(each))
    entry = IndexEntry.of(first)
    entries = []
    for number in range(recordings // each):
        path = folder / f"train-{number:06d}.tar"
        if number:
            path.symlink_to(first)
        entries.append(replace(entry, file=path.name, sha256=f"{number:064x}"))
    Index("fake", {"train": entries, "val": []}).save(folder)


def write(path: Path, numbers: range, size: int = 32) -> None:
    """A shard of recordings of 600 frames, all of one picture."""
    picture = np.random.default_rng(0).integers(0, 256, (size, size, 3), np.uint8)
    raw = shards.encode_image(picture)
    frames = Still((size, size))

    def packed(number: int) -> shards.Packed:
        touch = Recording(
            key=f"r{number}",
            sensor=("digit", "gelsight")[number % 2],
            frames=frames,
            times=np.arange(FRAMES) / 30,
            no_contact=None,
            force=np.zeros((FRAMES, 3), np.float32),
            action=np.full(FRAMES, number % 8),
            object=f"o{number // 2}",
        )
        head = shards.describe_recording(touch)
        return shards.Packed(head, "jpg", [raw] * FRAMES, [raw], [])

    shards.write_shard(path, map(packed, numbers))


class Still:
    """Stub of frames, with a number and a size only."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.shape = shape

    def __len__(self) -> int:
        return FRAMES

    def read(self, indices: object) -> NDArray[np.uint8]:
        """Raises: the shard takes encoded frames, and never calls this."""
        raise NotImplementedError


def touch_data(root: str, cache: str | None = None, size: int = 32) -> TouchData:
    """Batches of 32 clips of 4 frames, read by this process."""
    data = TouchData(
        Shards(root, cache),
        frames=4,
        size=(size, size),
        workers=0,
        batch_size=32,
        cache_mb=16,
        hop=0.2,
    )
    data.setup()
    return data


def streamed(folder: str) -> dict[str, float]:
    """Seconds to the first batch, and megabytes after 300."""
    ShardFolder._has_checksum = lambda *_: True  # type: ignore[method-assign]  # see `fake`
    before = memory_mb()
    start = time.perf_counter()
    index = Shards(folder).index
    assert index is not None
    read = time.perf_counter() - start
    start = time.perf_counter()
    stream = touch_data(folder).stream()
    stream[0]
    first = time.perf_counter() - start
    peak = memory_mb()
    for number in range(1, 300):
        stream[number * 7]
        peak = max(peak, memory_mb())
    return {
        "index, MB": round((Path(folder) / "index.json").stat().st_size / 2**20, 2),
        "index, s": round(read, 2),
        "first batch with the index, s": round(first, 2),
        "clips, estimated": sum(track.size for track in stream.tracks),
        "before, MB": round(before, 1),
        "peak, MB": round(peak, 1),
    }


def large() -> dict[str, Any]:
    """Results of `streamed` for few and many recordings, each in a fresh interpreter."""
    found: dict[str, Any] = {}
    for recordings in (1_000, 10_000, 1_000_000):
        with tempfile.TemporaryDirectory() as folder:
            fake(Path(folder), recordings)
            command = [sys.executable, __file__, folder]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            found[f"{recordings} recordings"] = json.loads(done.stdout)
    return found


class Counting(VideoFrames):
    """A video with a counter of requested frames."""

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
    """Clips per second from one video, and frames decoded for them."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "touch.mp4"
        video(path, 300)
        touch = Recording(
            key="touch",
            sensor="digit",
            frames=Counting(path),
            times=np.arange(300) / 30,
            no_contact=None,
        )
        clips = Clips([touch], **CUT, size=(224, 224))
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
    torch.set_num_threads(1)
    cv2.setNumThreads(0)
    if len(sys.argv) > 1:
        print(json.dumps(streamed(sys.argv[1])))
        return
    save(
        "data",
        {
            "what": "reading clips of 4 frames",
            "one core, from shards": loaders(),
            "a large stream": large(),
            "decoding a video": decoding(),
        },
    )


if __name__ == "__main__":
    main()
