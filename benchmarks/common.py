"""Side-by-side timing in one process, and writing of results as JSON."""

from __future__ import annotations

import json
import platform
import statistics
import threading
import time
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Self

import torch

RESULTS = Path(__file__).parent / "results"


def memory_mb(kind: str = "VmRSS") -> float:
    """Memory of this process now, MB (2**20).

    Args:
        kind: ``VmRSS`` for all resident memory, ``RssAnon`` for the part not mapped from files.
    """
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(kind)).split()[1]) / 1024


class Memory(threading.Thread):
    """Samples the memory of this process while its block runs.

    Args:
        every: Interval between samples, s.
        kind: ``VmRSS`` or ``RssAnon``, see `memory_mb`.

    Attributes:
        mb: Samples, MB (2**20).
    """

    def __init__(self, every: float, kind: str = "VmRSS") -> None:
        super().__init__(daemon=True)
        self.every, self.kind, self.ended = every, kind, threading.Event()
        self.mb = [memory_mb(kind)]

    def run(self) -> None:
        """Samples until the block ends."""
        while not self.ended.wait(self.every):
            self.mb.append(memory_mb(self.kind))

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.ended.set()
        self.join()


def side_by_side(
    subjects: Mapping[str, Callable[[], object]],
    rounds: int,
    warmup: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, dict[str, float]]:
    """Times each subject once a round, in turn: all meet the same disturbances.

    Args:
        subjects: Functions to time, by name.
        rounds: Number of timed rounds.
        warmup: Number of rounds before them.
        clock: Clock, s; ``time.process_time`` counts CPU time, excluding other programs.

    Returns:
        Minimum, median and maximum of each, s.
    """
    times: dict[str, list[float]] = {name: [] for name in subjects}
    for number in range(warmup + rounds):
        for name, subject in subjects.items():
            start = clock()
            subject()
            if number >= warmup:
                times[name].append(clock() - start)
    return {
        name: {
            "min_s": min(values),
            "median_s": statistics.median(values),
            "max_s": max(values),
        }
        for name, values in times.items()
    }


def ratio(times: dict[str, dict[str, float]], ours: str, theirs: str) -> float:
    """Speed-up over ``theirs``, by medians; above 1 is faster."""
    return round(times[theirs]["median_s"] / times[ours]["median_s"], 3)


def save(name: str, result: dict[str, Any]) -> None:
    """Writes a result, with the machine and versions, to `RESULTS`, and prints it."""
    write(RESULTS / f"{name}.json", result)
    print(json.dumps(result, indent=2))


def write(path: Path, result: dict[str, Any]) -> None:
    """Writes a result, with the machine and versions, atomically."""
    packages = ("torch", "transformers", "opencv-contrib-python-headless")
    result["machine"] = {
        "processor": platform.machine(),
        "threads": torch.get_num_threads(),
        "device": torch.cuda.get_device_name() if torch.cuda.is_available() else "cpu",
        "python": platform.python_version(),
        **{package: _version(package) for package in packages},
    }
    path.parent.mkdir(exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(result, indent=2) + "\n")
    part.replace(path)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
