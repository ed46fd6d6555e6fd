"""Two starts over many pictures in folders: the first reads their headers.

Seconds of CPU time, in this process, to list and open all recordings of both splits: of folders of
200 JPEGs of 160 x 120, as sequences and as single touches; medians of three. Pillow's headers
alone, read one by one, are the peer.

Run: python pictures.py [NUMBER OF PICTURES]
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from common import save
from PIL import Image

from tactileforge.datasets import Recordings
from tactileforge.util.files import cache_folder

PICTURES, FOLDER, ROUNDS = 20_000, 200, 3
LAYOUT = {"images": "*/*.jpg", "sensor": "digit", "background": "none"}
LAYOUTS: dict[str, dict[str, Any]] = {
    "sequences": {**LAYOUT, "each": "sequence", "fps": 30},
    "single touches": {**LAYOUT, "each": "touch"},
}


def write(root: Path, count: int) -> None:
    """Folders of pictures, of a few that are repeated."""
    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 255, (120, 160, 3), np.uint8) for _ in range(10)]
    coded = [cv2.imencode(".jpg", picture)[1].tobytes() for picture in pictures]
    for number in range(count):
        path = root / f"trial_{number // FOLDER:04d}" / f"{number % FOLDER:05d}.jpg"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(coded[number % len(coded)])


def opened(root: Path, layout: dict[str, Any]) -> None:
    """Lists and opens all recordings."""
    data = Recordings(str(root), {"pictures": layout})
    for split in ("train", "val"):
        for touch in data.recordings(split):
            len(touch.frames)


def headers(root: Path) -> None:
    """The size of each picture, by Pillow alone."""
    for path in root.glob("*/*.jpg"):
        with Image.open(path) as image:
            image.size  # noqa: B018


def cpu_s(work: Callable[[], object]) -> float:
    """CPU time, s."""
    start = time.process_time()
    work()
    return time.process_time() - start


def measured(root: Path, layout: dict[str, Any]) -> dict[str, float]:
    """Medians of the first start and the next ones, in turn, and their ratios."""
    times: dict[str, list[float]] = {"first start": [], "next start": [], "headers by Pillow": []}
    for _ in range(ROUNDS):
        for path in (cache_folder() / "pictures").glob("*"):
            path.unlink()
        times["first start"].append(cpu_s(lambda: opened(root, layout)))
        times["next start"].append(cpu_s(lambda: opened(root, layout)))
        times["headers by Pillow"].append(cpu_s(lambda: headers(root)))
    seconds = {name: statistics.median(each) for name, each in times.items()}
    return {
        **{f"{name}, s": round(value, 3) for name, value in seconds.items()},
        "first / next": round(seconds["first start"] / seconds["next start"], 2),
        "headers by Pillow / next": round(seconds["headers by Pillow"] / seconds["next start"], 2),
    }


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else PICTURES
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TACTILEFORGE_CACHE"] = f"{folder}/cache"
        root = Path(folder, "touches")
        root.mkdir()
        write(root, count)
        time.sleep(3)  # pictures that have just been written are not kept
        found = {name: measured(root, layout) for name, layout in LAYOUTS.items()}
    save("pictures", {"what": "a start over pictures in folders", "pictures": count, **found})


if __name__ == "__main__":
    main()
