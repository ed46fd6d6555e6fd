"""From a frame to its prediction: the time of `TouchStream.push`, p50 and p99.

Frames of 320 x 240 of a moving spot with noise are pushed as fast as predictions return, with the
times of a 30 Hz camera. The model is ``anytouch2.tiny``; ``--model NAME`` takes others. ``--busy``
measures beside a program that burns each core, with the threads that are chosen by themselves (one)
and with a thread a core.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from common import save
from live import SyntheticCamera

import tactileforge
from tactileforge.hub import Model
from tactileforge.util import threads
from tactileforge.util.threads import use_threads


def run(model: Model, count: int, threads: Sequence[int | None]) -> dict[str, dict[str, float]]:
    """Milliseconds of a push by number of threads, None for our choice; in turns."""
    images = SyntheticCamera().pictures
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # forces are an estimate
        streams = [model.stream("digit", background=images[0]) for _ in threads]
    milli: list[list[float]] = [[] for _ in threads]
    for number in range(count + 20):
        for stream, times, asked in zip(streams, milli, threads, strict=True):
            with chosen_threads(asked):
                start = time.perf_counter()
                found = stream.push(images[number % len(images)], number / 30)
            if number >= 20:  # warm-up: by now a clip is complete
                assert found is not None
                times.append(1000 * (time.perf_counter() - start))
    return {
        "chosen" if asked is None else f"{asked} threads": {
            "p50_ms": round(float(np.percentile(times, 50)), 2),
            "p99_ms": round(float(np.percentile(times, 99)), 2),
            "pushes": count,
        }
        for times, asked in zip(milli, threads, strict=True)
    }


@contextmanager
def chosen_threads(count: int | None) -> Iterator[None]:
    """As with ``threads=count``; None as without."""
    before, threads._chosen = threads._chosen, count is not None
    try:
        use_threads(count)
        yield
    finally:
        threads._chosen = before


@contextmanager
def burning(count: int) -> Iterator[None]:
    """One busy process a core."""
    burn = "while True: pass"
    burners = [subprocess.Popen([sys.executable, "-c", burn]) for _ in range(count)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


def busy(model: Model, count: int) -> dict[str, dict[str, dict[str, float]]]:
    """Milliseconds of a push by load of the machine and threads; one thread and more take turns."""
    cores = os.cpu_count() or 1
    found = {}
    for load, burners in (("idle", 0), ("a burner on each core", cores)):
        with burning(burners):
            found[load] = run(model, count, (None, cores))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", nargs="*", default=["anytouch2.tiny"], help="NAME.TAG")
    parser.add_argument("--dtype", default="float32", help="see tactileforge.load")
    parser.add_argument("--count", type=int, default=1000, help="pushes")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--busy", action="store_true", help="beside a burner on each core")
    parser.add_argument("--name", default="stream", help="of the result")
    words = parser.parse_args()
    if words.busy:
        loads = {
            name: busy(tactileforge.load(name, dtype=words.dtype), words.count)
            for name in words.model
        }
        save(words.name, {"frame": "320 x 240", "dtype": words.dtype, "models": loads})
        return
    found = {
        name: run(tactileforge.load(name, dtype=words.dtype), words.count, (words.threads,))
        for name in words.model
    }
    save(words.name, {"frame": "320 x 240", "dtype": words.dtype, "models": found})


if __name__ == "__main__":
    main()
