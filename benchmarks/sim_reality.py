"""Simulated pictures against real ones of the same type of sensor, per source and measure.

For DIGIT and GelSight Mini: medians over the touches of each source (10 %, 50 % and 90 % quantiles
for triples), the distances of simulated touches to each real source, and, as the best possible
result, the distances between real sources. Then a classifier of real against simulated patches,
trained on one real source and tested on another (mean of three seeds). Results are stored under a
name, so that one file can hold those of several versions of the simulator.

With `--whole`, classifiers of whole pictures (raw, and less their background) and the change of the
whole picture by shear instead. Sources of `HELD_OUT` took part in no choice of the simulator.

Run: python benchmarks/sim_reality.py --name NAME [--scenes 40] [--sensors digit gelsight_mini]
     python benchmarks/sim_reality.py --whole --name NAME [--scenes 60] [--without frame glow ...]
     python benchmarks/sim_reality.py --table plain now
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
from reality import whole
from reality.classifier import VIEWS, PatchSplit, told_apart
from reality.measures import Array
from reality.patches import patches
from reality.profiles import Profile, correlations, distances, profile
from reality.response import whole_shear
from reality.simulated import config, simulated, trial
from reality.whole import WholePictures, whole_pictures
from tactileforge_sim.randomise.table import TABLE

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
    "digit_unit_a": {
        "path": "digit_ball_presses/unitA",
        "images": "frame_*.png",
        "each": "touch",
        "sensor": "digit",
        "background": {"file": "background.png"},
    },
    "digit_unit_c": {
        "path": "digit_ball_presses/digitdepth",
        "images": "qt_images_000*.png",
        "each": "touch",
        "sensor": "digit",
        "background": "none",
    },
    "gelslam": {
        "path": "gelslam_mini/calibration",
        "images": "*mm/*.png",
        "each": "touch",
        "sensor": "gelsight_mini",
        "background": {"file": "background.png"},
    },
    "umi_cable": {
        "path": "anytouch2_umi_cable",
        "videos": "umi-2.mp4",
        "crops": {"mini": {"box": [0, 0, 640, 480], "sensor": "gelsight_mini"}},
        "sensor": "gelsight_mini",
        "background": {"first": 8},
    },
}
#: Pairs of real sources for training and for testing of classifiers.
PAIRS = {
    "digit": (("fots_digit", "touchd_force_digit"), ("touchd_force_digit", "fots_digit")),
    "gelsight_mini": (("octopi", "taxim_gelsight_mini"), ("taxim_gelsight_mini", "octopi")),
}
#: Pairs for whole pictures; sources that took part in no choice of the simulator, tested last; and
#: sources with forces.
WHOLE_PAIRS = {
    "digit": (("fots_digit", "touchd_force_digit"),),
    "gelsight_mini": (
        ("octopi", "taxim_gelsight_mini"),
        ("gsmini_cmu", "touchd_force_gelsight_mini"),
    ),
}
HELD_OUT = {
    "digit": ("digit_unit_a", "digit_unit_c"),
    "gelsight_mini": ("gelslam", "umi_cable"),
}
TRIALS = {"digit": "touchd_force_digit", "gelsight_mini": "touchd_force_gelsight_mini"}
#: Simulated pictures for classifiers of whole ones, and trials of shear: short and small.
_WHOLE: dict[str, Any] = {"size": 128, "motions": "press", "seconds": 0.1}
_SHEAR: dict[str, Any] = {"size": 64, "seconds": 0.5}
#: Recordings and patches per source, seeds of a classifier, and simulated trials of shear.
_TOUCHES = 60
_PATCHES = 600
_SEEDS, _TRIALS = 3, 3
#: Classifiers of whole pictures per pair: they are few, and seeds differ.
_CLASSIFIERS = 3


def real(source: str) -> list[Recording]:
    """At most 60 recordings of a source, evenly spread."""
    samples = OmegaConf.load(
        Path(str(files("tactileforge_datasets.conf") / "data/public_samples.yaml"))
    )
    layouts: Any = OmegaConf.to_container(samples.data.layouts, resolve=True)
    layout = {"object": "x", "text": "x", "source": source, "licence": "as the set says"} | (
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


def whole_results(sensor: str, scenes: int, rows: tuple[str, ...]) -> dict[str, Any]:
    """Classifiers of whole pictures, and change of the whole picture by shear.

    Args:
        sensor: Type of the sensor.
        scenes: Number of simulated touches; a half trains, the other half tests.
        rows: Randomised rows.
    """
    played = simulated(config(sensor, randomise=rows, **_WHOLE), range(scenes))
    ours = whole_pictures(played)
    halves = ours[: len(ours) // 2], ours[len(ours) // 2 :]
    theirs = {
        name: real_pictures(name)
        for name in (*(name for pair in WHOLE_PAIRS[sensor] for name in pair), *HELD_OUT[sensor])
    }
    chosen = [name for name in theirs if name not in HELD_OUT[sensor]]
    splits: list[tuple[tuple[str, ...], str]]
    splits = [((a,), b) for pair in WHOLE_PAIRS[sensor] for a, b in (pair, pair[::-1])]
    splits += [(tuple(chosen), name) for name in HELD_OUT[sensor]]
    splits += [(HELD_OUT[sensor], name) for name in chosen]
    out: dict[str, Any] = {"pictures": {"simulated": len(ours)}, "auc": {}}
    out["pictures"] |= {name: len(one) for name, one in theirs.items()}
    for names, other in splits:
        train = [theirs[name] for name in names], halves[0]
        words = f"trained on {' and '.join(names)}, tested on {other}"
        out["auc"][words] = {
            f"{shown}, {view}": round(
                whole.told_apart(train, (theirs[other], halves[1]), shown, view, _CLASSIFIERS), 3
            )
            for shown in ("raw", "change")
            for view in whole.VIEWS
        }
        print(sensor, words, out["auc"][words], flush=True)
    played = simulated(trial(sensor, randomise=rows, **_SHEAR), range(_TRIALS))
    found = [shear for one in played if (shear := whole_shear(one))]
    out["grey levels per N of shear, x and y"] = {
        "simulated": [listed(one) for one in found],
        "simulated, median": listed(np.median(found, axis=0)),
        "real": [listed(shear) for one in real(TRIALS[sensor]) if (shear := whole_shear(one))],
    }
    return out


def real_pictures(source: str) -> WholePictures:
    """Whole pictures of a source; a single long recording gives several."""
    recordings = real(source)
    most = 1 if len(recordings) > 1 else 40
    parts = [one.part(*ends) for one in recordings for ends in _parts(len(one.frames), most)]
    return whole_pictures(parts, 1)


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


def whole_table(result: dict[str, Any], before: str, now: str) -> str:
    """Markdown of the classifiers of whole pictures under two names, and their means."""
    columns = [f"{shown}, {view}" for shown in ("raw", "change") for view in whole.VIEWS]
    lines = [f"| sensor, trained on, tested on | {' | '.join(columns)} |", "|---" * 5 + "|"]
    for sensor in SOURCES:
        old, new = (result[name][sensor]["whole pictures"]["auc"] for name in (before, now))
        for words, found in new.items():
            cells = [f"{old[words][column]:.2f}, {found[column]:.2f}" for column in columns]
            given, tested = words.removeprefix("trained on ").split(", tested on ")
            if " and " in given:
                given = "the pairs" if tested in HELD_OUT[sensor] else "the held out"
            lines.append(f"| {sensor}: {given}; {tested} | {' | '.join(cells)} |")
        held = [words for words in new if words.split()[-1] in HELD_OUT[sensor]]
        both = [words for pair in WHOLE_PAIRS[sensor] for words in new if _is_of(words, pair)]
        for title, rows in (("mean of pairs", both), ("mean of held out", held)):
            means = [[np.mean([part[w][c] for w in rows]) for part in (old, new)] for c in columns]
            cells = [f"{first:.2f}, {second:.2f}" for first, second in means]
            lines.append(f"| **{sensor}, {title}** | {' | '.join(cells)} |")
    return "\n".join(lines)


def _is_of(words: str, pair: tuple[str, str]) -> bool:
    return words in {f"trained on {a}, tested on {b}" for a, b in (pair, pair[::-1])}


def main() -> None:
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--name", default="now")
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--sensors", nargs="+", default=list(SOURCES), choices=list(SOURCES))
    parser.add_argument("--whole", action="store_true")
    parser.add_argument("--without", nargs="+", default=[], choices=list(TABLE))
    parser.add_argument("--table", nargs=2, metavar=("BEFORE", "NOW"))
    given = parser.parse_args()
    rows = tuple(name for name in TABLE if name not in given.without)
    path = RESULTS / "sim_reality.json"
    if given.table:
        print(whole_table(json.loads(path.read_text()), *given.table))
        return
    for sensor in given.sensors:
        if given.whole:
            part = {"whole pictures": whole_results(sensor, given.scenes, rows)}
        else:
            part = sensor_results(sensor, given.scenes)
        result: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
        found = result.get(given.name, {})
        found[sensor] = found.get(sensor, {}) | part
        save("sim_reality", {**result, "what": __doc__, given.name: found})


if __name__ == "__main__":
    main()
