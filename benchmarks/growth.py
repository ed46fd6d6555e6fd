"""Growth of cost: CPU time and memory of five verbs against the amount of work.

Each measurement is a process of its own, forked from this one once all has been imported and each
verb has run on a small set, so that starting Python is not counted. CPU time is that of the process
and the processes that it starts, memory the highest resident memory over what it began with; of
processes that it starts, the largest one is given beside it. Caches are empty.

The slope is the exponent of the cost in the size: log cost against log size, by least squares over
all sizes (``slope``) and between the two largest (``slope_large``): 0 does not grow, 1 is linear. A
cost that is a fixed amount and a linear one has a slope below 1 which rises to it.

Run: python growth.py [--only WORDS] [--profile], with ``--profile`` the largest size of each is
profiled; then result_tables.py writes the table of docs/fast.md.
"""

from __future__ import annotations

import argparse
import contextlib
import cProfile
import ctypes
import gc
import json
import os
import pickle
import pstats
import resource
import statistics
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from common import RESULTS, memory_mb, write

import tactileforge
from tactileforge.training import build_data

ROOT = Path(__file__).parents[1]
#: Rows and columns of the pictures of all sets.
ROWS, COLUMNS = 64, 48
SENSORS = ("digit", "gelsight_mini", "gelsight", "gelslim", "duragel")

Work = Callable[[], object]


def write_set(
    root: Path, recordings: int = 4, frames: int = 50, classes: int = 4, sensors: int = 1
) -> Path:
    """Videos with forces and objects, `recordings` for each sensor."""
    rng = np.random.default_rng(0)
    shades = rng.integers(60, 120, (8, ROWS, COLUMNS, 3)).astype(np.uint8)
    layouts: dict[str, Any] = {}
    for name in SENSORS[:sensors]:
        folder = root / name
        folder.mkdir(parents=True)
        rows = ["file,object"]
        for number in range(recordings):
            film = cv2.VideoWriter(
                str(folder / f"{number}.avi"),
                cv2.VideoWriter.fourcc(*"MJPG"),
                30,
                (COLUMNS, ROWS),
            )
            force = np.abs(np.sin(np.arange(frames) / (9 + number % 5))) * 3
            for i in range(frames):
                picture = shades[(i + number) % 8].copy()
                cv2.circle(
                    picture, (20 + number % 20, 20), 3 + int(3 * force[i]), (200, 90, 40), -1
                )
                film.write(picture)
            film.release()
            noise = rng.normal(0, 0.01, (frames, 3))
            values = np.stack([0.1 * force, 0.2 * force, force], 1) + noise
            table = "\n".join(",".join(f"{v:.4f}" for v in row) for row in values)
            (folder / f"{number}.csv").write_text(f"fx,fy,fz\n{table}\n")
            rows.append(f"{number},thing{number % classes}")
        (folder / "labels.csv").write_text("\n".join(rows) + "\n")
        layouts[name] = {
            "videos": f"{name}/*.avi",
            "sensor": name,
            "background": {"first": 1},
            "force": {"file": f"{name}/{{stem}}.csv", "columns": ["fx", "fy", "fz"]},
            "labels": {"file": f"{name}/labels.csv", "key": "file"},
            "object": "{object}",
        }
    (root / "tactileforge.yaml").write_text(json.dumps({"layouts": layouts}))
    return aged(root)


def write_classes(root: Path, images: int = 8, classes: int = 4) -> Path:
    """Folders of `images` pictures, one for each of `classes`."""
    rng = np.random.default_rng(0)
    for number in range(classes):
        folder = root / f"thing{number}"
        folder.mkdir(parents=True)
        for i in range(images):
            picture = rng.integers(60, 120, (ROWS, COLUMNS, 3)).astype(np.uint8)
            cv2.circle(picture, (10 + number % 40, 20), 4 + number % 9, (200, 90, 40), -1)
            cv2.imwrite(str(folder / f"{i}.png"), picture)
    return aged(root)


def aged(root: Path) -> Path:
    """Dates files back, since caches keep nothing about recently changed ones."""
    for path in root.rglob("*"):
        os.utime(path, (10**9, 10**9))
    return root


def inspect(root: Path, out: Path) -> None:
    tactileforge.inspect(data="recordings", **{"data.root": root}, out=out / "page.html")


def pack(root: Path, out: Path) -> None:
    tactileforge.pack(
        data="recordings",
        **{"data.root": root, "pack.processes": 1, "pack.shard_frames": 2000},
        out=out / "packed",
    )


def train_start(root: Path, out: Path, workers: int = 0) -> None:
    """From the words of a run to its first batch."""
    words = ["scale=tiny", "data=recordings", f"data.root={root}", "data.val=0.25"]
    words += ["batch.size=4", f"batch.workers={workers}", "debug=none", "objective=[pixel,diff]"]
    data, _ = build_data(tactileforge.compose("anytouch2", words))
    next(iter(data.train_dataloader()))


def train(root: Path, out: Path, epochs: int = 1) -> None:
    words = ["scale=tiny", "data=recordings", "debug=none", "objective=[pixel,diff]"]
    words += ["batch.size=4", "batch.workers=0", "trainer.limit_train_batches=4"]
    words += ["trainer.max_steps=-1", f"trainer.max_epochs={epochs}", "encoder.image_size=32"]
    words += ["encoder.depth=1", "trainer.accelerator=cpu", "trainer.precision=32-true"]
    tactileforge.train(*words, **{"data.root": root, "data.val": 0.25}, folder=out / "run")


def bench(root: Path, out: Path, epochs: int = 20, workers: int = 0) -> None:
    tactileforge.bench(
        suite="classes",
        **{"classes.root": root, "classes.sensor": "digit", "classes.folds": 2},
        **{"probe.epochs": epochs, "seeds": 1, "workers": workers},
        model=["untrained:anytouch2"],
        untrained=["scale=tiny", "encoder.image_size=32", "encoder.depth=1"],
        out=out / "bench",
    )


def bench_videos(root: Path, out: Path) -> None:
    task = {
        "title": "Thing",
        "data": {"name": "recordings", "root": str(root), "val": 0.25},
        "target": "object",
        "probe": {"name": "linear", "epochs": 20},
        "metrics": ["accuracy"],
        "split": {"folds": 2, "group": "recording"},
    }
    tactileforge.bench(
        tasks={"thing": task},
        model=["untrained:anytouch2"],
        untrained=["scale=tiny", "encoder.image_size=32", "encoder.depth=1"],
        seeds=1,
        workers=0,
        out=out / "bench",
    )


def sim(out: Path, seconds: float = 2.0, sensors: int = 1, motion: float = 0.6) -> None:
    tactileforge.simulate(
        out=out / "sim",
        seconds=seconds,
        size=32,
        sensors=list(SENSORS[:sensors]),
        processes=1,
        action_seconds=motion,
        val=0,
    )


@dataclass
class Row:
    """A verb against the amount of one thing.

    Attributes:
        axis: What there is more of.
        verb: The verb.
        sizes: Its numbers.
        work: Makes the work of a size, given a folder for data and one for results; may write data.
        same: Whether the work is the same at each size, so that a slope of 0 is expected.
    """

    axis: str
    verb: str
    sizes: Sequence[int]
    work: Callable[[int, Path, Path], Work]
    same: bool = False


def made(root: Path, make: Callable[..., Path], **keys: int) -> Path:
    """A set of this script, made once."""
    name = "_".join([make.__name__, *(f"{key}{value}" for key, value in keys.items())])
    place = root / name
    return place if place.exists() else make(place, **keys)


def on_set(verb: Callable[..., object], key: str, **others: int) -> Callable[..., Work]:
    """Work of a verb on videos, with `key` of `write_set` as large as the size says."""
    return lambda size, root, out: partial(
        verb, made(root, write_set, **{**others, key: size}), out
    )


def on_classes(key: str, **others: int) -> Callable[..., Work]:
    """Work of the bench on folders of classes."""
    return lambda size, root, out: partial(
        bench, made(root, write_classes, **{**others, key: size}), out
    )


def in_classes(images: int) -> Callable[..., Work]:
    """Work of the bench on as many images in more classes."""
    return lambda size, root, out: partial(
        bench, made(root, write_classes, images=images // size, classes=size), out
    )


def with_key(verb: Callable[..., object], key: str, make: Any, **data: int) -> Callable[..., Work]:
    """Work of a verb on one set, with an argument as large as the size says."""
    return lambda size, root, out: partial(verb, made(root, make, **data), out, **{key: size})


def simulated(key: str, **others: float) -> Callable[..., Work]:
    """Work of the simulator."""
    return lambda size, root, out: partial(sim, out, **{**others, key: size})


LONG, MANY, THINGS, FEW = (100, 400, 1600), (16, 64, 256), (4, 16, 64), (1, 2, 4)
ROWS_OF_TABLE = [
    Row("frames of each of 4 recordings", "inspect", LONG, on_set(inspect, "frames")),
    Row("frames of each of 4 recordings", "pack", LONG, on_set(pack, "frames")),
    Row("frames of each of 4 recordings", "train start", LONG, on_set(train_start, "frames")),
    Row("frames of each of 4 recordings", "bench", LONG, on_set(bench_videos, "frames")),
    Row("seconds", "sim", (2, 8, 32), simulated("seconds")),
    Row("recordings of 20 frames", "inspect", MANY, on_set(inspect, "recordings", frames=20)),
    Row("recordings of 20 frames", "pack", MANY, on_set(pack, "recordings", frames=20)),
    Row(
        "recordings of 20 frames",
        "train start",
        MANY,
        on_set(train_start, "recordings", frames=20),
    ),
    Row("images of each of 4 classes", "bench", MANY, on_classes("images")),
    Row(
        "objects of 128 recordings",
        "inspect",
        THINGS,
        on_set(inspect, "classes", frames=10, recordings=128),
        True,
    ),
    Row(
        "objects of 128 recordings",
        "pack",
        THINGS,
        on_set(pack, "classes", frames=10, recordings=128),
        True,
    ),
    Row(
        "objects of 128 recordings",
        "train start",
        THINGS,
        on_set(train_start, "classes", frames=10, recordings=128),
        True,
    ),
    Row("classes of 128 images in all", "bench", THINGS, in_classes(128)),
    Row("classes of 8 images", "bench", THINGS, on_classes("classes")),
    Row(
        "epochs",
        "train",
        (4, 16, 64),
        with_key(train, "epochs", write_set, recordings=4, frames=100),
    ),
    Row(
        "epochs of the probe",
        "bench",
        (50, 200, 800),
        with_key(bench, "epochs", write_classes, images=16, classes=4),
    ),
    Row("sensors, 16 recordings each", "inspect", FEW, on_set(inspect, "sensors", recordings=16)),
    Row("sensors, 16 recordings each", "pack", FEW, on_set(pack, "sensors", recordings=16)),
    Row(
        "sensors, 16 recordings each",
        "train start",
        FEW,
        on_set(train_start, "sensors", recordings=16),
    ),
    Row("sensors", "sim", FEW, simulated("sensors", seconds=4.0)),
    Row(
        "processes",
        "train start",
        FEW,
        with_key(train_start, "workers", write_set, recordings=64),
        True,
    ),
    Row(
        "processes",
        "bench",
        FEW,
        with_key(bench, "workers", write_classes, images=16, classes=4),
        True,
    ),
]


def cpu_s() -> float:
    """CPU time of this process and its ended children, s."""
    own, others = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime


def apart(work: Work, place: Path, profile: bool = False) -> dict[str, float]:
    """CPU time and peak memory of some work, in a process of its own, with an empty cache.

    Raises:
        SystemExit: The work fails.
    """
    ends = os.pipe()
    child = os.fork()
    if not child:
        os.close(ends[0])
        log = os.open(place / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.environ["TACTILEFORGE_CACHE"] = str(place / "cache")
        found: Any = None
        try:
            gc.collect()
            ctypes.CDLL(None).malloc_trim(0)
            Path("/proc/self/clear_refs").write_text("5")  # the peak starts here
            held, used = memory_mb(), cpu_s()
            with cProfile.Profile() if profile else contextlib.nullcontext() as seen:
                work()
            used, most = cpu_s() - used, memory_mb("VmHWM") - held
            other = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
            found = {"cpu_s": used, "mb": most, "largest_child_mb": other}
            if seen:
                with (place / "profile.txt").open("w") as file:
                    stats = pstats.Stats(seen, stream=file)
                    stats.sort_stats("tottime").print_stats(25)
                    stats.sort_stats("cumtime").print_stats(60)
        except BaseException:
            traceback.print_exc()
        with os.fdopen(ends[1], "wb") as pipe:
            pickle.dump(found, pipe)
        os._exit(0)
    os.close(ends[1])
    with os.fdopen(ends[0], "rb") as pipe:
        raw = pipe.read()
    os.waitpid(child, 0)
    plain: dict[str, float] | None = pickle.loads(raw) if raw else None
    if plain is None:
        raise SystemExit((place / "log.txt").read_text()[-3000:])
    return plain


def slope(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Exponent of the costs in the sizes, by least squares of their logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(np.maximum(costs, 1e-3)), 1)[0])


def measure(row: Row, root: Path, rounds: int, profile: bool = False) -> dict[str, Any]:
    """Measures a row: medians of each size, and slopes."""
    found: dict[str, list[float]] = {"cpu_s": [], "mb": [], "largest_child_mb": []}
    for size in row.sizes:
        times = []
        for _ in range(rounds):
            with tempfile.TemporaryDirectory(dir=root) as place:
                last = profile and size == row.sizes[-1]
                times.append(apart(row.work(size, root, Path(place)), Path(place), last))
                if last:
                    print((Path(place) / "profile.txt").read_text()[:14000])
        for key, values in found.items():
            values.append(round(statistics.median(one[key] for one in times), 3))
    cpu = found["cpu_s"]
    return {
        "grows": row.axis,
        "verb": row.verb,
        "sizes": list(row.sizes),
        **found,
        "slope": round(slope(row.sizes, cpu), 2),
        "slope_large": round(slope(row.sizes[-2:], cpu[-2:]), 2),
        "same_work": row.same,
    }


def warm(root: Path, verbs: set[str]) -> None:
    """Runs verbs in this process, once: imports and first allocations are not measured."""
    place = root / "warm"
    place.mkdir()
    os.environ["TACTILEFORGE_CACHE"] = str(place / "cache")
    data, classes = made(root, write_set), made(root, write_classes)
    works: dict[str, Work] = {
        "inspect": partial(inspect, data, place),
        "pack": partial(pack, data, place),
        "train start": partial(train_start, data, place),
        "bench": partial(bench, classes, place, 2),
        "train": partial(train, data, place),
        "sim": partial(sim, place),
    }
    with (place / "log.txt").open("w") as file, contextlib.redirect_stdout(file):
        for verb in verbs:
            works[verb]()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="words of the rows, such as inspect,frames")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--profile", action="store_true")
    given = parser.parse_args()
    path = RESULTS / "growth.json"
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    held = json.loads(path.read_text())["rows"] if path.exists() else []
    rows = {(row["grows"], row["verb"]): row for row in held}
    words = given.only.split(",")
    chosen = [one for one in ROWS_OF_TABLE if all(w in f"{one.axis}, {one.verb}" for w in words)]
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        warm(Path(folder), {row.verb for row in chosen})
        print(f"warm: {time.process_time() - begun:.1f} s", flush=True)
        for row in chosen:
            found = measure(row, Path(folder), given.rounds, given.profile)
            rows[row.axis, row.verb] = found
            keep(path, rows)
            print(found, flush=True)


def keep(path: Path, rows: Mapping[tuple[str, str], dict[str, Any]]) -> None:
    """Writes the measured rows, in the order of the table."""
    order = [rows[row.axis, row.verb] for row in ROWS_OF_TABLE if (row.axis, row.verb) in rows]
    what = "CPU s and MB of a process against what there is more of; slopes are exponents"
    write(path, {"what": what, "rows": order})


if __name__ == "__main__":
    main()
