"""Memory while features are computed: the same clips again and again, few and ten times as many.

What counts is anonymous memory of the process at its highest, sampled ten times a second; the
features themselves lie in a mapped file. Processes that read clips hold two batches each, whatever
the number of clips, and are not counted.

    python features_memory.py [clips]
"""

from __future__ import annotations

import sys
import tempfile
import threading
from pathlib import Path

import numpy as np
import torch
from common import save
from probe import NODE, task

from tactileforge.bench import targets
from tactileforge.bench.features import Store, features
from tactileforge.bench.models import Subject
from tactileforge.bench.source import Source, open_source
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.hub.files import describe

SIZE = 64


def anonymous() -> float:
    """Anonymous memory of this process, MB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("RssAnon")).split()[1]) / 1000


class Peak:
    """The most that was seen meanwhile."""

    def __init__(self) -> None:
        self.before = self.highest = anonymous()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch)

    def _watch(self) -> None:
        while not self._stop.wait(0.1):
            self.highest = max(self.highest, anonymous())

    def __enter__(self) -> Peak:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join()


def main(count: int = 500) -> None:
    torch.manual_seed(0)
    encoder = TactileViT("tiny", depth=4, image_size=SIZE)
    header = describe(encoder, NODE, licence="", spacing=1 / 15, recipe={"encoder": NODE})
    subject = Subject("tiny", encoder, header)
    one = task(8)
    source: Source = open_source(one.data, one.sides, one.clip)
    clips = targets.build(one, source).clips
    found = {}
    with tempfile.TemporaryDirectory() as place:
        store = Store(Path(place), workers=2, batch=16)
        features(store, subject, source, np.resize(clips, 100), ["tokens"])  # what is kept for good
        for many in (count, 10 * count):
            with Peak() as peak:
                arrays = features(store, subject, source, np.resize(clips, many), ["tokens"])
            size = next(iter(arrays.values())).nbytes / 1e6
            found[f"{many} clips"] = {
                "before_mb": round(peak.before, 1),
                "highest_mb": round(peak.highest, 1),
                "features_mb": round(size, 1),
            }
    few, all_ = (row["highest_mb"] for row in found.values())
    result = {"what": "anonymous memory", "memory": found, "growth_mb": round(all_ - few, 1)}
    save("features_memory", result)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
