"""Simulated pictures against real ones of the same type of sensor, per source and measure.

For DIGIT and GelSight Mini: medians over the touches of each source (10 %, 50 % and 90 % quantiles
for triples), the distances of simulated touches to each real source, and, as the best possible
result, the distances between real sources. Then a classifier of real against simulated patches,
trained on one real source and tested on another (mean of three seeds). Results are stored under a
name, so that one file can hold those of several versions of the simulator.

Run: python benchmarks/sim_reality.py --name NAME [--scenes 40] [--sensors digit gelsight_mini]
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from common import RESULTS, save
from omegaconf import OmegaConf
from reality.classifier import VIEWS, PatchSplit, told_apart
from reality.measures import Array
from reality.patches import patches
from reality.profiles import Profile, correlations, distances, profile
from reality.simulated import config, simulated, trial

from tactileforge.contracts import Recording
from tactileforge.data import ArrayFrames
from tactileforge.datasets import Recordings

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("TACTILEFORGE_REALDATA", ROOT.parent / "shared" / "realdata"))
#: Sources of `data=public_samples` by sensor, and those of `MORE`, for tests only.
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
        "background": "none",
    },
}
#: Pairs of real sources for training and for testing of classifiers.
PAIRS = {
    "digit": (("fots_digit", "touchd_force_digit"), ("touchd_force_digit", "fots_digit")),
    "gelsight_mini": (("octopi", "taxim_gelsight_mini"), ("taxim_gelsight_mini", "octopi")),
}
#: Recordings and patches per source, and seeds of the classifier.
_TOUCHES = 60
_PATCHES = 600
_SEEDS = 3


def real(source: str) -> list[Recording]:
    """At most 60 recordings of a source, evenly spread."""
    samples = OmegaConf.load(
        Path(str(files("tactileforge_datasets.conf") / "data/public_samples.yaml"))
    )
    layouts: Any = OmegaConf.to_container(samples.data.layouts, resolve=True)
    layout = {"object": "x", "text": "x", "source": source, "licence": "x"} | (
        MORE[source] if source in MORE else layouts[source]
    )
    if layout.get("split") == "time":
        layout["split"] = "train"
    data = Recordings(str(DATA), {source: layout}, val=0)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    return _with_median(found[:: -(-len(found) // _TOUCHES)])


def _with_median(recordings: list[Recording]) -> list[Recording]:
    """Recordings with the median of all stills as background: contacts are in many places."""
    if recordings[0].no_contact is not None:
        return recordings
    shown = np.concatenate([one.frames.read([0]) for one in recordings])
    still = ArrayFrames(np.median(shown, axis=0).astype(np.uint8)[None])
    return [replace(one, no_contact=still) for one in recordings]


def sensor_results(sensor: str, scenes: int) -> dict[str, Any]:
    """All results of one sensor."""
    start = time.perf_counter()
    played = _Cut(simulated(config(sensor), range(scenes)))
    ours = profile("simulated", sensor, played)
    ours.responses = profile("", sensor, simulated(trial(sensor), range(3))).responses
    theirs = {}
    for source in SOURCES[sensor]:
        theirs[source] = profile(source, sensor, real(source))
        print(sensor, source, len(theirs[source].looks), flush=True)
    names = list(theirs)
    pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
    return {
        "simulated": summary(ours),
        "real": {name: summary(one) for name, one in theirs.items()},
        "distance, simulated to real": {
            name: rounded(distances(ours, one)) for name, one in theirs.items()
        },
        "distance, real to real": {
            f"{a} to {b}": rounded(distances(theirs[a], theirs[b])) for a, b in pairs
        },
        "real or simulated": classified(sensor, played.halves()),
        "seconds": round(time.perf_counter() - start, 1),
    }


class _Cut:
    """Iterator over recordings; collects patches of each."""

    def __init__(self, recordings: Iterable[Recording]) -> None:
        self._recordings = recordings
        self._cut: list[Array] = []

    def __iter__(self) -> Any:
        for number, one in enumerate(self._recordings):
            self._cut.append(patches([one], 30, 1, number))
            yield one

    def halves(self) -> tuple[Array, Array]:
        """Patches of the first and of the second half of the scenes."""
        middle = len(self._cut) // 2
        return np.concatenate(self._cut[:middle]), np.concatenate(self._cut[middle:])


def real_patches(source: str) -> Array:
    """About 600 patches of a source; a single long recording gives several pictures."""
    recordings = real(source)
    most = 1 if len(recordings) > 1 else 40
    pictures = sum(max(1, min(most, len(one.frames) // 8)) for one in recordings)
    parts = [one.part(*ends) for one in recordings for ends in _parts(len(one.frames), most)]
    return patches(parts, -(-_PATCHES // pictures), 1)


def _parts(frames: int, most: int) -> list[tuple[int, int]]:
    edges = np.linspace(0, frames, max(1, min(most, frames // 8)) + 1).astype(int)
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def classified(sensor: str, halves: tuple[Array, Array]) -> dict[str, Any]:
    """Scores of classifiers by view, for each pair of real sources."""
    sources = sorted({name for pair in PAIRS[sensor] for name in pair})
    held = {source: real_patches(source) for source in sources}
    out: dict[str, Any] = {}
    for first, second in PAIRS[sensor]:
        train, test = PatchSplit(held[first], halves[0]), PatchSplit(held[second], halves[1])
        out[f"trained on {first}, tested on {second}"] = {
            view: _mean([told_apart(train, test, view, seed) for seed in range(_SEEDS)])
            for view in VIEWS
        }
        print(sensor, first, json.dumps(out), flush=True)
    return out


def _mean(scores: list[Any]) -> dict[str, Any]:
    names = ("accuracy", "auc", "seen")
    found = {name: round(float(np.mean([getattr(s, name) for s in scores])), 3) for name in names}
    return {**found, "patches": list(scores[0].patches)}


def summary(one: Profile) -> dict[str, Any]:
    """Medians over the touches of a source, as plain data."""
    out: dict[str, Any] = {"touches": len(one.looks), "faint": one.faint, "stored": one.stored}
    if not one.looks:
        return out
    out["bands, log10"] = listed(np.nanmedian(one.of("bands"), axis=0))
    for name in ("noise", "area", "contrast", "inside", "outside"):
        values = one.of(name)
        known = values[np.isfinite(values)]
        out[name] = listed(np.quantile(known, (0.1, 0.5, 0.9))) if len(known) else None
    ground = one.of("ground")
    deviation = np.sqrt(np.einsum("ncc->nc", one.of("covariance")))
    out["background"] = listed(ground.mean(axis=0))
    out["background spread"] = listed(ground.std(axis=0))
    out["change deviation"] = listed(np.median(deviation, axis=0))
    out["channel correlation"] = listed(np.median(correlations(one), axis=0))
    if one.responses:
        out["grey levels per N, normal"] = listed([a.normal for a in one.responses])
        out["grey levels per N, shear"] = [listed(a.shear) for a in one.responses]
        out["shear over contrast, per N"] = listed([a.relative for a in one.responses])
        out["curve at 1/4, 1/2, 3/4"] = [listed(a.curve) for a in one.responses]
    return out


def listed(values: Iterable[float]) -> list[float | None]:
    """Numbers with three decimals; None for NaN or infinity."""
    return [round(float(v), 3) if np.isfinite(v) else None for v in values]


def rounded(values: dict[str, float]) -> dict[str, float | None]:
    """Numbers by name, with three decimals; None for NaN or infinity."""
    return dict(zip(values, listed(values.values()), strict=True))


def main() -> None:
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--name", default="now")
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--sensors", nargs="+", default=list(SOURCES), choices=list(SOURCES))
    given = parser.parse_args()
    path = RESULTS / "sim_reality.json"
    result: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    found = result.get(given.name, {})
    for sensor in given.sensors:
        found[sensor] = sensor_results(sensor, given.scenes)
    save("sim_reality", {**result, "what": __doc__, given.name: found})


if __name__ == "__main__":
    main()
