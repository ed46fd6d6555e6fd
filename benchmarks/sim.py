"""Simulated touch: frames per second, the cost of five sensors, memory.

- Finished frames per second at 320 x 240 (mechanics, optics, force): slides of four indenters on
  one sensor, in one process, and in two processes of one thread each.
- Cost of one contact on five sensors, relative to one.
- Peak resident memory of a short and of a long touch.
- CPU time of a frame by part, for touches of a DIGIT of 240 rows with all rows of randomisation, as
  the command makes them. With names of packages only this is measured, alternating, and added to
  the result: an earlier simulator is a copy of both packages with other names.

Run: python benchmarks/sim.py [old_sim tactileforge_sim]
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path as File
from typing import Any

import numpy as np
import torch
from common import save, side_by_side
from tactileforge_sim.geometry.shapes import shape
from tactileforge_sim.mechanics.motions import MOTIONS, Path, Speeds
from tactileforge_sim.play import play_scenes
from tactileforge_sim.scene import Scene

NAMES = ("small_sphere", "pentagram", "small_square_array", "cylindrical")
FIVE = ("digit", "gelsight", "gelsight_mini", "gelslim", "duragel")
SPEEDS = Speeds(depth=0.5, slide=3.0, seconds=0.8, rest=0.1)


def slide(name: str) -> Scene:
    """A press, a slide and a lift."""
    path = MOTIONS["slide_right"]((0, 0, 0.3, 0, 0), SPEEDS, np.random.default_rng(0))
    return Scene(seed=0, shape=shape(name), path=path, motion="slide_right")


def frames(name: str, sensors: tuple[str, ...]) -> int:
    """Plays a slide, and returns the number of finished frames."""
    return sum(len(shots.pictures) for shots in play_scenes(slide(name), sensors, 240))


def rate(sensors: tuple[str, ...]) -> dict[str, float]:
    """Frames per second of each indenter, after a warm-up."""
    out = {}
    for name in NAMES:
        frames(name, sensors)
        start = time.perf_counter()
        out[name] = round(frames(name, sensors) / (time.perf_counter() - start), 1)
    return out


def two_processes() -> float:
    """Frames per second of two processes with one thread each: twice the slower one's."""
    code = (
        "import torch; torch.set_num_threads(1); from sim import *; r = rate(('digit',));"
        "print(len(NAMES) / sum(1 / v for v in r.values()))"
    )
    running = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    return round(2 * min(float(p.communicate()[0]) for p in running), 1)


def memory() -> dict[str, float]:
    """Peak memory after a short and after a long touch, MB."""
    out = {}
    base = slide("small_sphere")
    for repeats in (1, 20):
        times = np.concatenate(
            [base.path.times + i * base.path.seconds * 1.01 for i in range(repeats)]
        )
        poses = np.concatenate([base.path.poses] * repeats)
        actions = (*base.path.actions, *(("stay", *base.path.actions) * (repeats - 1)))
        touch = replace(base, path=Path(times, poses, actions))
        count = sum(len(shots.pictures) for shots in play_scenes(touch, ["digit"], 240))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        out[f"{count} frames"] = round(peak, 1)
    return out


def parts(*packages: str, scenes: Sequence[int] = (1, 3, 4, 7)) -> dict[str, dict[str, float]]:
    """CPU ms a frame of the parts of a touch for each package, in turn."""
    torch.set_num_threads(1)
    spent = {package: Counter[str]() for package in packages}
    makes: dict[str, Callable[[int], Any]] = {}
    for package in packages:
        module = {
            n: import_module(f"{package}.{n}") for n in ("config", "generate", "play", "view")
        }
        config = module["config"].SimConfig(
            sensors=("digit",), indenters="pretrain", motions="atomic", size=240, seconds=0.6,
            force=(0.5, 8.0), markers=None, viscosity=0.0, lag=0.0, seed=0, randomise="all",
        )  # fmt: skip
        times = spent[package]
        config.scene(0)

        def timed(
            call: Callable[..., Any], times: Counter[str], name: str, *a: Any, **k: Any
        ) -> Any:
            start = time.process_time()
            try:
                return call(*a, **k)
            finally:
                times[name] += time.process_time() - start  # type: ignore[assignment]

        for owner, call, name in (
            (module["config"].SimConfig, "scene", "drawing a touch"),
            (module["generate"], "render_scene_image", "photo of the object"),
            (module["generate"], "encode_image", "encoding"),
            (module["play"].SensorView, "pictures", "pictures"),
            (module["play"]._Film, "__init__", "gel and sensor"),
        ):
            inner = getattr(owner, call)
            step = lambda *a, inner=inner, times=times, name=name, **k: timed(  # noqa: E731
                inner, times, name, *a, **k
            )
            setattr(owner, call, step)
        makes[package] = partial(timed, module["generate"].recordings, times, "all", config)
    for make in makes.values():
        make(0)
    for times in spent.values():
        times.clear()
    count = 0
    for scene in scenes:
        for package in packages if scene % 2 else packages[::-1]:
            made = makes[package](scene)
        count += len(made[0].frames)
    for times in spent.values():
        apart = sum(value for name, value in times.items() if name != "all")
        times["contact and friction, and the rest"] = times["all"] - apart
    return {
        package: {name: round(1e3 * value / count, 2) for name, value in times.items()}
        for package, times in spent.items()
    }


def main() -> None:
    if packages := sys.argv[1:]:
        file = File(__file__).parent / "results" / "sim.json"
        known = json.loads(file.read_text())
        found = parts(*packages)
        first, last = found[packages[0]]["all"], found[packages[-1]]["all"]
        known["CPU ms a frame by part"] = found | {"times as fast": round(first / last, 2)}
        file.write_text(json.dumps(known, indent=2) + "\n")
        return
    memory_mb = memory()
    times = side_by_side(
        {
            f"{name}, {len(sensors)}": lambda name=name, sensors=sensors: frames(name, sensors)  # type: ignore[misc]
            for name in NAMES
            for sensors in (("digit",), FIVE)
        },
        rounds=3,
    )
    costs = {
        name: round(times[f"{name}, 5"]["median_s"] / times[f"{name}, 1"]["median_s"], 2)
        for name in NAMES
    }
    save(
        "sim",
        {
            "what": __doc__,
            "frames a second, one process": rate(("digit",)),
            "frames a second, two processes of one thread": two_processes(),
            "five sensors against one": costs,
            "five sensors against one, all": round(
                sum(times[f"{n}, 5"]["median_s"] for n in NAMES)
                / sum(times[f"{n}, 1"]["median_s"] for n in NAMES),
                2,
            ),
            "peak memory, MB": memory_mb,
            "CPU ms a frame by part": parts("tactileforge_sim"),
            "times": times,
            "threads of one process": torch.get_num_threads(),
        },
    )


if __name__ == "__main__":
    main()
