"""Memory during the extraction of features: the same clips repeatedly, few and ten times as many.

The result is the highest anonymous memory of the process, sampled ten times a second; the features
themselves are in a mapped file. Workers hold two batches each, independent of the number of clips,
and are not counted.

    python features_memory.py [clips]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import torch
from common import Memory, save
from probe import NODE, task
from tactileforge_bench.fit.features import FeatureStore, extract_features
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.tasks import targets
from tactileforge_bench.tasks.source import TaskSource, open_source

from tactileforge.encoders import TactileViT
from tactileforge.hub import make_header

SIZE = 64


def main(count: int = 500) -> None:
    torch.manual_seed(0)
    encoder = TactileViT("tiny", depth=4, image_size=SIZE)
    header = make_header(encoder, NODE, licence="", spacing=1 / 15, recipe={"encoder": NODE})
    subject = FrozenEncoder("tiny", encoder, header)
    one = task(8)
    source: TaskSource = open_source(one.data, one.sides, one.clip)
    clips = targets.build_target(one, source).clips
    found = {}
    with tempfile.TemporaryDirectory() as place:
        store = FeatureStore(Path(place), workers=2, batch=16)
        extract_features(
            store, subject, source, np.resize(clips, 100), ["tokens"]
        )  # warm-up: allocations kept for good
        for many in (count, 10 * count):
            with Memory(0.1, "RssAnon") as memory:
                arrays = extract_features(
                    store, subject, source, np.resize(clips, many), ["tokens"]
                )
            size = next(iter(arrays.values())).nbytes / 2**20
            found[f"{many} clips"] = {
                "before_mb": round(memory.mb[0], 1),
                "highest_mb": round(max(memory.mb), 1),
                "features_mb": round(size, 1),
            }
    few, all_ = (row["highest_mb"] for row in found.values())
    result = {"what": "anonymous memory", "memory": found, "growth_mb": round(all_ - few, 1)}
    save("features_memory", result)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
