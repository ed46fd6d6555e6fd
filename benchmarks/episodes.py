"""Episodes in zarr: clips of a set of 10 GB, beside zarr's own loop; the index of 10^6 frames.

- Clips a second of CPU and bytes read. The set has 70,000 pictures of 224 x 224 in chunks of
  ten, coded by Blosc; its chunks are one file under many names, so that it takes no room. Ours
  reads the rows of a clip by `Frames.read`; zarr's loops read them one by one, and as one
  selection (``oindex``). Clips of 4 frames, every second one, are drawn at random or follow one
  another.
- Seconds (of CPU, and on the clock) to list the recordings of 10^6 frames (2,500 episodes of two
  pads) with times, forces and captions, and to read their tracks, and the memory that this takes.

Run: python episodes.py
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Before the imports: OpenMP reads it when it is loaded.
os.environ["OMP_NUM_THREADS"] = "1"

import numcodecs
import numpy as np
import zarr
from common import memory_mb, ratio, save, side_by_side
from tactileforge_episodes.dataset import Episodes
from tactileforge_episodes.kept import KEPT

from tactileforge.contracts import Recording

#: Pictures of the large set, their size, those of a chunk, and those of an episode.
FRAMES, SIZE, CHUNK, EPISODE = 70_000, 224, 10, 70
#: Frames of a clip, and the steps between them.
CLIP, STEP = 4, 2
#: Frames and episodes of the set that is listed.
LISTED, LISTED_EPISODES = 1_000_000, 2_500
ROUNDS = 3


def array(folder: Path, values: np.ndarray[Any, Any], rows: int | None = None) -> None:
    """An array of zarr 2 with chunks of the given values, all one file; ``rows`` in all."""
    folder.mkdir(parents=True)
    codec = numcodecs.Blosc(cname="zstd", clevel=5)
    shape = [rows or len(values), *values.shape[1:]]
    about = {
        "zarr_format": 2,
        "shape": shape,
        "chunks": list(values.shape),
        "dtype": values.dtype.str,
        "compressor": codec.get_config(),
        "fill_value": "" if values.dtype.kind == "U" else 0,
        "order": "C",
        "filters": None,
    }
    (folder / ".zarray").write_text(json.dumps(about))
    tail = ".0" * (values.ndim - 1)
    first = folder / f"0{tail}"
    first.write_bytes(codec.encode(np.ascontiguousarray(values)))
    for number in range(1, -(-shape[0] // len(values))):
        os.link(first, folder / f"{number}{tail}")


def groups(root: Path) -> None:
    """Marks a folder and its groups as those of zarr 2."""
    for name in ("", "data", "meta"):
        (root / name).mkdir(parents=True, exist_ok=True)
        (root / name / ".zgroup").write_text('{"zarr_format": 2}')


def large_set(root: Path) -> None:
    """A replay buffer of 10 GB in the room of one chunk."""
    groups(root)
    rng = np.random.default_rng(0)
    smooth = np.cumsum(rng.integers(-2, 3, (CHUNK, SIZE, SIZE, 3)), axis=2)
    array(root / "data/left_gripper1_img", (128 + smooth).clip(0, 255).astype("u1"), FRAMES)
    array(root / "data/action", rng.normal(0, 1, (FRAMES, 4)).astype("f4"))
    array(root / "meta/episode_ends", np.arange(EPISODE, FRAMES + 1, EPISODE))


def bytes_read() -> int:
    """Bytes read from files by this process."""
    lines = Path("/proc/self/io").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("rchar")).split()[1])


def clips(root: Path) -> dict[str, Any]:
    """Clips a second and bytes a clip, ours beside zarr's loops."""
    data = Episodes(str(root.parent), preset="reactive_diffusion", val=0)
    recordings = list(data.recordings("train"))
    stored: Any = zarr.open_group(root, mode="r")["data/left_gripper1_img"]
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, len(recordings), 30), rng.integers(0, EPISODE - CLIP * STEP, 30)
    spots = {
        "at random": list(zip(*(numbers.tolist() for numbers in drawn), strict=True)),
        "one after another": [(0, row) for row in range(0, 60, 2)],
    }

    def rows(start: int) -> range:
        return range(start, start + CLIP * STEP, STEP)

    def ours(where: list[tuple[int, int]]) -> Callable[[], object]:
        def read() -> object:
            KEPT.__init__()  # type: ignore[misc]  # forgets
            return [recordings[i].frames.read(rows(start)) for i, start in where]

        return read

    def by_row(where: list[tuple[int, int]]) -> Callable[[], object]:
        return lambda: [
            np.stack([stored[i * EPISODE + row] for row in rows(start)]) for i, start in where
        ]

    def selected(where: list[tuple[int, int]]) -> Callable[[], object]:
        return lambda: [
            stored.oindex[[i * EPISODE + row for row in rows(start)]] for i, start in where
        ]

    out: dict[str, Any] = {}
    for name, where in spots.items():
        subjects = {
            "ours": ours(where),
            "zarr, row by row": by_row(where),
            "zarr, one selection": selected(where),
        }
        same = [np.stack(read()) for read in subjects.values()]  # type: ignore[call-overload]
        assert all(np.array_equal(same[0], other) for other in same[1:])
        used = {}
        for way, read in subjects.items():
            before = bytes_read()
            read()
            used[way] = round((bytes_read() - before) / len(where))
        times = side_by_side(subjects, ROUNDS, clock=time.process_time)
        out[name] = {
            "clips": len(where),
            "clips a second of CPU": {
                way: round(len(where) / times[way]["median_s"], 1) for way in subjects
            },
            "bytes read a clip": used,
            "times as fast as row by row": ratio(times, "ours", "zarr, row by row"),
            "times as fast as one selection": ratio(times, "ours", "zarr, one selection"),
            "times": times,
        }
    chunk = (root / "data/left_gripper1_img/0.0.0.0").stat().st_size
    return {"bytes of a chunk": chunk, "bytes of the set": FRAMES * SIZE * SIZE * 3, **out}


def listed(root: Path) -> dict[str, float]:
    """Seconds to list and to check a set of 10^6 frames."""
    groups(root)
    rng = np.random.default_rng(0)
    side = "data/right_"
    rows = 10_000
    # every chunk is there: a set with missing ones is refused
    array(root / f"{side}tactile_data_gripper", np.ones((rows, 2, 32, 32, 3), "u1"), LISTED)
    for key, values in {
        "data/timestamps": np.arange(LISTED) / 30,
        f"{side}arm_joints": rng.normal(0, 1, (rows, 7)).astype("f4"),
        f"{side}wrist_pose": rng.normal(0, 1, (rows, 6)).astype("f4"),
        f"{side}tactile_data_force": rng.normal(1, 1, (rows, 2, 3)).astype("f4"),
        f"{side}tactile_area_gripper": np.tile([0, 1], (rows, 1)),
        f"{side}tactile_sensor_gripper": np.full(rows, "GelSightMini", "<U12"),
        f"{side}tactile_type_gripper": np.full(rows, "image", "<U5"),
        "data/sub_task_instruction": np.full(rows, "press the cup", "<U100"),
    }.items():
        array(root / key, values, LISTED)
    each = LISTED // LISTED_EPISODES
    array(root / "meta/episode_ends", np.arange(each, LISTED + 1, each))
    before = memory_mb()
    start, cpu = time.perf_counter(), time.process_time()
    found: list[Recording] = list(
        Episodes(str(root.parent), preset="open_x_tactile", val=0).recordings("train")
    )
    recordings_s, recordings_cpu = time.perf_counter() - start, time.process_time() - cpu
    start, cpu = time.perf_counter(), time.process_time()
    for one in found:
        assert all(len(values) == each for values in one.tracks.values())
    return {
        "frames": LISTED,
        "recordings": len(found),
        "recordings, s of CPU": round(recordings_cpu, 2),
        "recordings, s": round(recordings_s, 2),
        "their tracks, s of CPU": round(time.process_time() - cpu, 2),
        "their tracks, s": round(time.perf_counter() - start, 2),
        "memory, MB": round(memory_mb() - before, 1),
    }


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        large_set(Path(folder) / "large/toy.zarr")
        found = {
            "what": "clips of 4 frames of a zarr of 10 GB, 224 x 224, chunks of 10, Blosc",
            "clips": clips(Path(folder) / "large/toy.zarr"),
            "10^6 frames": listed(Path(folder) / "listed/toy.zarr"),
        }
    save("episodes", found)


if __name__ == "__main__":
    main()
