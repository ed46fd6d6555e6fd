"""Simulated pictures against real ones of the same type of sensor: every source, every number.

For DIGIT and GelSight Mini: medians over the touches of each source (10 %, 50 % and 90 % where three
numbers stand), the distances of the simulated touches to each real source, and, as what can be hoped
for, the distances of real sources to each other. Then a classifier of real against simulated patches,
trained on one source and tested on another. Results stand under a name, so that those of two states of
the simulator lie in one file.

Run: python benchmarks/sim_reality.py --name NAME [--scenes 30]
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from typing import Any

import cv2
import torch
from common import RESULTS, save
from omegaconf import OmegaConf

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.reality.profiles import Profile, distances, profile, summary
from tactileforge.reality.simulated import simulated
from tactileforge.sim.record import Config

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("TACTILEFORGE_REALDATA", ROOT.parent / "shared" / "realdata"))
#: Sources of `conf/data/public_samples.yaml` by sensor, and more that only tests may use.
SOURCES = {
    "digit": ("fots_digit", "digit_edge", "touchd_force_digit"),
    "gelsight_mini": (
        "octopi",
        "taxim_gelsight_mini",
        "gsmini_cmu",
        "touchd_force_gelsight_mini",
        "tactile_mnist",
        "gs_sdk",
    ),
}
MORE: dict[str, dict[str, Any]] = {
    "digit_edge": {
        "path": "digit_edge_press_seq/edge6",
        "images": "*.jpg",
        "each": "sequence",
        "sensor": "digit",
        "background": {"first": 8},
        "fps": 30,
    },
    "gsmini_cmu": {
        "path": "gsmini_calib_ball_cmu/images",
        "images": "*.jpg",
        "each": "touch",
        "sensor": "gelsight_mini",
        "background": {"file": "frame_0.png"},
    },
}
_TOUCHES = 60


def real(source: str) -> list[Recording]:
    """At most 60 recordings of a source, evenly spread."""
    samples = OmegaConf.load(ROOT / "conf" / "data" / "public_samples.yaml")
    layouts: Any = OmegaConf.to_container(samples.data.layouts, resolve=True)
    layout = {"object": "x", "text": "x", "source": source, "licence": "MIT"} | (
        MORE[source] if source in MORE else layouts[source]
    )
    if layout.get("split") == "time":
        layout["split"] = "train"
    data = Recordings(str(DATA), {source: layout}, val=0)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    return found[:: -(-len(found) // _TOUCHES)]


def config(sensor: str, **given: Any) -> Config:
    """What is simulated for a sensor."""
    how: dict[str, Any] = {
        "sensors": (sensor,),
        "indenters": "all",
        "motions": "atomic",
        "size": 240,
        "seconds": 0.5,
        "force": (0.5, 8.0),
        "markers": None,
        "viscosity": 0.0,
        "lag": 0.0,
        "seed": 0,
        "codec": "png",
    }
    return Config(**(how | given))


def trials(sensor: str) -> Config:
    """The trial of the ToucHD demonstrations: press, slides in four directions, lift."""
    force = (7.0, 9.5) if sensor == "digit" else (4.0, 6.0)
    shapes = ("one_quarter_cylindrical", "square_prism", "regular_triangular")
    return config(sensor, indenters=shapes, motions="force_trial", seconds=2.0, force=force)


def sensor_results(sensor: str, scenes: int) -> dict[str, Any]:
    """All numbers of one sensor."""
    start = time.perf_counter()
    ours = profile("simulated", sensor, simulated(config(sensor), range(scenes)))
    ours.responses = profile("", sensor, simulated(trials(sensor), range(3))).responses
    theirs: list[Profile] = []
    for source in SOURCES[sensor]:
        theirs.append(profile(source, sensor, real(source)))
        print(sensor, source, len(theirs[-1].looks), flush=True)
    return {
        "simulated": summary(ours),
        "real": {one.name: summary(one) for one in theirs},
        "distance, simulated to real": {one.name: rounded(distances(ours, one)) for one in theirs},
        "distance, real to real": {
            f"{a.name} to {b.name}": rounded(distances(a, b))
            for i, a in enumerate(theirs)
            for b in theirs[i + 1 :]
        },
        "seconds": round(time.perf_counter() - start, 1),
    }


def rounded(values: dict[str, float]) -> dict[str, float | None]:
    """Three decimals; None for what cannot be told."""
    return {name: None if v != v else round(v, 3) for name, v in values.items()}


def main() -> None:
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--name", default="now")
    parser.add_argument("--scenes", type=int, default=30)
    parser.add_argument("--sensors", nargs="+", default=list(SOURCES))
    given = parser.parse_args()
    path = RESULTS / "sim_reality.json"
    result: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    found = result.get(given.name, {})
    for sensor in given.sensors:
        found[sensor] = sensor_results(sensor, given.scenes)
    save("sim_reality", {"what": __doc__, **result, given.name: found})


if __name__ == "__main__":
    main()
