"""Records distinct sensors, in a process for killing."""

import json
import sys
import time

import numpy as np
from tactileforge_live.record.options import RecordOptions
from tactileforge_live.record.record import record

from tactileforge.contracts import Frame, SensorSpec
from tactileforge.errors import TactileForgeError
from tactileforge.sensors.background import Background


class Numbered:
    """Thirty frames a second, each of noise seeded by its number: no two are alike."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.spec = SensorSpec(
            name="digit", height=64, width=48, fps=30.0, area_mm=None, force_scale=(1.0, 1.0, 1.0)
        )

    def discover(self):
        return []

    def open(self):
        self.start, self.number = time.monotonic(), 0

    def read(self, timeout=1.0):
        due = self.start + self.number / self.spec.fps
        time.sleep(max(0.0, due - time.monotonic()))
        self.number += 1
        return Frame(array=picture(self.seed, self.number - 1), time=due)

    def close(self):
        pass

    def __enter__(self):
        self.open()
        return self

    def __exit__(self, *error):
        pass


def picture(seed, number):
    rng = np.random.default_rng([seed, number])
    return rng.integers(0, 256, (64, 48, 3), np.uint8)


def main(out, given):
    arguments = json.loads(given)
    if limit := arguments.pop("file_limit", None):
        import resource

        # a compiled file that is cut would break later imports
        sys.dont_write_bytecode = True
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    options = RecordOptions(out=out, codec="png", background=Background(seconds=0.0), **arguments)
    try:
        found = record(options, {"left": Numbered(1), "right": Numbered(2)}, say=_say)
    except TactileForgeError as error:
        sys.exit(f"error: {error}")
    print(found.frames)


def _say(line):
    print(line, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
