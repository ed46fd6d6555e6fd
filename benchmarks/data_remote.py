"""Reading from a URL: a first pass over shards behind a local server.

It is compared with the same pass over the folder, and with the bare download of the files; each
pass starts with an empty cache.

Run: python data_remote.py
"""

from __future__ import annotations

import itertools
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import cv2
import torch
from common import ratio, save, side_by_side
from data import ROUNDS, touch_data, write

from tactileforge.data import Index, IndexEntry, ShardFolder
from tactileforge.datasets import Shards


def remote() -> dict[str, Any]:
    """Rates of a first pass over shards behind a local server, and over the folder itself."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "shards"
        paths = [folder / f"train-{number:06d}.tar" for number in range(8)]
        for number, path in enumerate(paths):
            write(path, range(10 * number, 10 * number + 10), size=64)
        entries = [IndexEntry.of(path) for path in paths]
        Index("served", {"train": entries, "val": []}).save(folder)
        mb = sum(path.stat().st_size for path in paths) / 2**20
        port = socket.create_server(("127.0.0.1", 0)).getsockname()[1]
        server = [sys.executable, "-m", "http.server", str(port), "--bind", "127.0.0.1"]
        url = f"http://127.0.0.1:{port}"
        with subprocess.Popen([*server, "-d", str(folder)], stderr=subprocess.DEVNULL) as process:
            try:
                # The server has no signal of being ready: connect until it answers.
                while True:
                    with suppress(OSError):
                        socket.create_connection(("127.0.0.1", port)).close()
                        break
                    time.sleep(0.1)
                return {"MB": round(mb, 1)} | rates(url, folder, paths, Path(place), mb)
            finally:
                process.terminate()


def rates(url: str, folder: Path, paths: list[Path], place: Path, mb: float) -> dict[str, Any]:
    """Megabytes per second of download and fetch, and times of passes from URL and folder."""
    passes = itertools.count()

    def download() -> object:
        return [len(urlopen(f"{url}/{path.name}").read()) for path in paths]

    def fetch() -> object:
        there = ShardFolder(url, place / f"fetched{next(passes)}")
        index = Shards(str(folder)).index
        assert index is not None
        return [there.get(e.file, e.bytes, e.sha256) for e in index.splits["train"]]

    def read(root: str) -> object:
        cache = place / f"cache{next(passes)}"
        stream = touch_data(root, str(cache), 64).stream()
        return [stream[number] for number in range(len(stream))]

    subjects: dict[str, Callable[[], object]] = {
        "download": download,
        "fetched and checked": fetch,
        "a pass from the URL": lambda: read(url),
        "a pass from the folder": lambda: read(str(folder)),
    }
    times = side_by_side(subjects, ROUNDS)
    return {
        "MB a second": {
            name: round(mb / times[name]["median_s"], 1)
            for name in ("download", "fetched and checked")
        },
        "fetched and checked, as fast as the download": ratio(
            times, "fetched and checked", "download"
        ),
        "from the URL, as fast as from the folder": ratio(
            times, "a pass from the URL", "a pass from the folder"
        ),
        "times": times,
    }


if __name__ == "__main__":
    torch.set_num_threads(1)
    cv2.setNumThreads(0)
    save("data_remote", {"what": "shards behind a server of this machine"} | remote())
