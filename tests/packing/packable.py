"""Recordings for the tests of packing, importable by other processes.

``python packable.py OUT JSON`` packs them; JSON has the arguments of `Touches` and
of `PackOptions`.
"""

import json
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.errors import DataError, TactileForgeError
from tactileforge.packing import PackOptions, pack
from tactileforge.util.strict import build

SHAPE = (24, 32)


class Noise:
    """Frames of noise, different by seed; some cannot be read, or kill their reader."""

    shape = SHAPE

    def __init__(self, seed, count, unreadable=(), delay=0.0, deadly=None, deaths=1):
        self.seed, self.count, self.unreadable = seed, count, unreadable
        self.delay, self.deadly, self.deaths = delay, deadly, deaths

    def __len__(self):
        return self.count

    def read(self, indices):
        time.sleep(self.delay * len(indices))
        if self.deadly is not None and len(list(Path(self.deadly).iterdir())) < self.deaths:
            (Path(self.deadly) / str(os.getpid())).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        for i in indices:
            if i in self.unreadable:
                raise DataError(f"frame {i} of noise {self.seed} is broken")
        frames = [
            np.random.default_rng([self.seed, i]).integers(0, 256, (*SHAPE, 3)) for i in indices
        ]
        return np.stack(frames).astype(np.uint8)


class Touches:
    """A data set: every object is felt by two sensors, in train; two more recordings in val.

    Args:
        objects: How many, in train.
        frames: Frames of a recording.
        deadly: Folder that counts deaths; a frame of the third object kills who reads it.
        deaths: How often.
        delay: Seconds that a frame takes.
    """

    provides = frozenset({"force", "action", "object", "image"})

    def __init__(self, objects=4, frames=12, delay=0.0, deadly=None, deaths=1):
        self.objects, self.frames, self.delay = objects, frames, delay
        self.deadly, self.deaths = deadly, deaths
        self.skipped = []

    def recordings(self, split):
        for number in range(self.objects if split == "train" else 1):
            for sensor in ("digit", "gelsight"):
                yield self.touch(split, number, sensor)

    def touch(self, split, number, sensor):
        seed = 1000 * (split == "val") + 2 * number + (sensor == "digit")
        rng = np.random.default_rng(seed)
        n = self.frames
        force = rng.normal(0, 5, (n, 3)).astype(np.float32)
        force[1] = np.nan
        deadly = self.deadly if (split, number, sensor) == ("train", 2, "digit") else None
        return Recording(
            key=f"{split}/{number}/{sensor}",
            sensor=sensor,
            frames=Noise(seed, n, delay=self.delay, deadly=deadly, deaths=self.deaths),
            times=np.cumsum(rng.uniform(0.02, 0.05, n)),
            no_contact=Noise(seed + 5000, 2),
            force=force,
            action=rng.integers(-1, 8, n),
            object=f"{split} object {number}",
            text="{action} a thing",
            image=Noise(seed + 7000, 3),
            image_times=np.array([0.0, 0.1, 0.2]),
            labels={"depth": 0.5, "who": "me"},
            source="noise",
            tier=2,
            licence="CC0-1.0",
        )

    def plot(self, recording):
        raise NotImplementedError


class Given:
    """A data set of recordings at hand; some of train could not be opened."""

    provides = frozenset()

    def __init__(self, *train, val=(), missing=()):
        self.splits = {"train": train, "val": val}
        self.missing = {"train": list(missing), "val": []}
        self.skipped = []

    def recordings(self, split):
        self.skipped += self.missing[split]
        yield from self.splits[split]

    def plot(self, recording):
        raise NotImplementedError


def main(out, given):
    signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background ignore it
    arguments = json.loads(given)
    if limit := arguments.pop("file_limit", None):
        import resource

        # a compiled file that is cut would break later imports
        sys.dont_write_bytecode = True
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    options = build(PackOptions, "pack", arguments.pop("options"))
    try:
        pack(Touches(**arguments), "touches", Path(out), options)
    except TactileForgeError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main(*sys.argv[1:])
