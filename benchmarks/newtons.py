"""Forces in newton after ten seconds of presses, on the public trials with measured forces.

Of each trial, the first ten seconds calibrate and the rest judges. Shear along one axis comes late
in both trials, so errors on five blocks of time of the whole trial are told too, each predicted
from the others. The mean change alone, the head alone, the head as it is and the mean force stand
beside what the calibration chose. Inputs that the folder has already are not read again.

Run: python benchmarks/newtons.py REALDATA [FOLDER]
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from common import save
from numpy.typing import NDArray
from omegaconf import OmegaConf

import tactileforge
from tactileforge.calibration.features import force_features
from tactileforge.calibration.fit import BEFORE, MEAN, AxisFit, fit_axis, folds, hardly_pressed
from tactileforge.calibration.force import candidates
from tactileforge.contracts import AXES, Recording
from tactileforge.datasets.recordings import Recordings

MODEL = "anytouch2.tiny"
TRIALS = ("touchd_force_gelsight_mini", "touchd_force_digit")
LAYOUTS = Path(__file__).parents[1] / "conf" / "data" / "public_samples.yaml"
#: Seconds of presses that calibrate.
SECONDS = 10.0
#: Names of all candidates.
ALL = ("change", "head", "pictures", "both")

Inputs = Mapping[str, NDArray[np.float64]]


def trial(root: str, name: str) -> Recording:
    """A whole trial; its forces are delayed to the pictures, as its layout says."""
    layouts: Any = OmegaConf.to_container(OmegaConf.load(LAYOUTS).data.layouts)
    (recording,) = Recordings(root, {name: layouts[name] | {"split": "train"}}).recordings("train")
    return recording


def inputs_of(recording: Recording, path: Path) -> Inputs:
    """Inputs of every frame, of pictures and head, float64 (T,) each."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "force_inputs: ")  # frames with changed light
            found = force_features(recording, "both", tactileforge.load(MODEL))
        np.savez(path, names=np.array(list(found)), values=np.stack(list(found.values())))
    with np.load(path) as held:
        return dict(zip(held["names"].tolist(), held["values"], strict=True))


def score(predicted: NDArray[np.float64], force: NDArray[np.float64]) -> dict[str, float]:
    """Root mean square error, N and in percent of the range, and R2."""
    error = float(np.sqrt(np.mean((predicted - force) ** 2)))
    return {
        "rmse": round(error, 3),
        "percent_of_range": round(100 * error / float(np.ptp(force)), 1),
        "r2": round(1 - error**2 / float(np.var(force)), 3),
    }


def fitted(inputs: Inputs, force: NDArray[np.float64], axis: str, names: Sequence[str]) -> AxisFit:
    """A fit of some of the candidates to frames in time order."""
    known = [one for one in candidates("both", axis, inputs) if one.name in names]
    raw = axis if names == ALL else None
    return fit_axis(inputs, known, force, folds([len(force)]), axis, raw)


def later(recording: Recording, inputs: Inputs, axis: str) -> dict[str, Any]:
    """Scores after the first ten seconds, by fits to these."""
    assert recording.force is not None
    times, force = recording.times, recording.force[:, AXES.index(axis)].astype(np.float64)
    usable = np.isfinite(force) & np.all([np.isfinite(x) for x in inputs.values()], axis=0)
    early, late = usable & (times < SECONDS), usable & (times >= SECONDS)
    first = {name: values[early] for name, values in inputs.items()}
    rest = {name: values[late] for name, values in inputs.items()}
    truth, level = force[late], float(force[early].mean())
    fit = fitted(first, force[early], axis, ALL)
    kept = None if axis in hardly_pressed(recording.force[early]) else fit.axis
    row: dict[str, Any] = {
        "frames": [int(early.sum()), int(late.sum())],
        "range": [round(float(np.ptp(force[part])), 2) for part in (early, late)],
        "chosen": kept.chosen if kept else "left out",
        MEAN: score(np.full(len(truth), level), truth),
        BEFORE: score(rest[axis], truth),
        "calibrated": score(kept(rest) if kept else rest[axis], truth),
    }
    for name in ALL:
        alone = fitted(first, force[early], axis, [name]).axis
        row[f"{name} alone"] = None if alone is None else score(alone(rest), truth)
    return row


def blocks(inputs: Inputs, force: NDArray[np.float64], axis: str) -> dict[str, Any]:
    """Errors on five blocks of time of the whole trial, each predicted from the others."""
    fit = fitted(inputs, force, axis, ALL)
    # an axis that is left out stays what the model says
    predicted = fit.predicted if fit.axis or fit.before is None else fit.before
    return {
        "range": round(float(np.ptp(fit.measured)), 2),
        "chosen": fit.axis.chosen if fit.axis else "left out",
        "calibrated": score(predicted, fit.measured),
        "errors": {name: round(error, 3) for name, error in fit.errors.items()},
    }


def main(words: Sequence[str]) -> None:
    torch.set_num_threads(1)
    root, folder = words[0], Path(words[1] if len(words) > 1 else "runs/newtons")
    rows: dict[str, Any] = {}
    for name in TRIALS:
        recording = trial(root, name)
        assert recording.force is not None
        inputs = inputs_of(recording, folder / f"{name}.npz")
        for column, axis in enumerate(AXES):
            force = recording.force[:, column].astype(np.float64)
            rows[f"{name} {axis}"] = {
                "ten seconds, then the rest": later(recording, inputs, axis),
                "five blocks of time": blocks(inputs, force, axis),
            }
    save("newtons", {"model": MODEL, "seconds": SECONDS, "rows": rows})


if __name__ == "__main__":
    main(sys.argv[1:])
