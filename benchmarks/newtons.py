"""Forces in newton after ten seconds of presses, on the public trials with measured forces.

Of each trial, the first ten seconds calibrate and the rest judges. Shear along one axis comes late
in both trials, so errors on five blocks of time of the whole trial are reported too, each predicted
from the others. The mean change alone, the head alone, the head as it is and the mean force stand
beside what the calibration chose. Inputs that the folder has already are not read again.

Run: python benchmarks/newtons.py REALDATA [FOLDER]
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import torch
from common import save
from numpy.typing import NDArray
from omegaconf import OmegaConf
from tactileforge_live.calibrate.fit import BEFORE, MEAN, AxisFit, fit_axis, folds, hardly_pressed
from tactileforge_live.calibrate.force import candidates, keep_axes

import tactileforge
from tactileforge.contracts import AXES, Recording
from tactileforge.datasets import Recordings
from tactileforge.sensors import force_features

MODEL = "anytouch2.tiny"
TRIALS = ("touchd_force_gelsight_mini", "touchd_force_digit")
LAYOUTS = Path(str(files("tactileforge_datasets.conf") / "data/public_samples.yaml"))
#: Seconds of presses that calibrate.
SECONDS = 10.0
#: Names of all candidates.
ALL = ("change", "head", "pictures", "both")

Inputs = Mapping[str, NDArray[np.float64]]
Rows = dict[str, dict[str, Any]]


def trial(root: str, name: str) -> Recording:
    """A whole trial; its forces are delayed to the pictures, as its layout says."""
    layouts: Any = OmegaConf.to_container(OmegaConf.load(LAYOUTS).data.layouts)
    (recording,) = Recordings(root, {name: layouts[name] | {"hold_out": "none"}}).recordings(
        "train"
    )
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


def fitted(inputs: Inputs, forces: NDArray[np.float64]) -> dict[str, AxisFit]:
    """Fits of all axes to frames in time order, with all candidates."""
    fold = folds([len(forces)])
    return {
        axis: fit_axis(inputs, candidates("both", axis, inputs), column, fold, axis, axis)
        for axis, column in zip(AXES, forces.T, strict=True)
    }


def alone(inputs: Inputs, force: NDArray[np.float64], axis: str, name: str) -> AxisFit:
    """A fit of one candidate."""
    known = [one for one in candidates("both", axis, inputs) if one.name == name]
    return fit_axis(inputs, known, force, folds([len(force)]), axis)


def later(inputs: Inputs, times: NDArray[np.float64], forces: NDArray[np.float64]) -> Rows:
    """Scores after the first ten seconds, by fits to these."""
    parts = times < SECONDS, times >= SECONDS
    first, rest = ({name: values[part] for name, values in inputs.items()} for part in parts)
    early, late = (forces[part] for part in parts)
    kept, _ = keep_axes(fitted(first, early), hardly_pressed(early))
    rows: Rows = {}
    for axis, fitting, truth in zip(AXES, early.T, late.T, strict=True):
        fit = kept[axis].axis if axis in kept else None
        rows[axis] = {
            "frames": [len(fitting), len(truth)],
            "range": [round(float(np.ptp(force)), 2) for force in (fitting, truth)],
            "chosen": fit.chosen if fit else "left out",
            MEAN: score(np.full(len(truth), fitting.mean()), truth),
            BEFORE: score(rest[axis], truth),
            "calibrated": score(fit(rest) if fit else rest[axis], truth),
        }
        for name in ALL:
            single = alone(first, fitting, axis, name).axis
            rows[axis][f"{name} alone"] = None if single is None else score(single(rest), truth)
    return rows


def blocks(inputs: Inputs, forces: NDArray[np.float64]) -> Rows:
    """Errors on five blocks of time of the whole trial, each predicted from the others."""
    fits = fitted(inputs, forces)
    kept, _ = keep_axes(fits, hardly_pressed(forces))
    rows: Rows = {}
    for axis, fit in (fits | kept).items():
        # an axis that is left out stays what the model says
        predicted = fit.predicted if axis in kept or fit.before is None else fit.before
        chosen = kept[axis].axis if axis in kept else None
        rows[axis] = {
            "range": round(float(np.ptp(fit.measured)), 2),
            "chosen": chosen.chosen if chosen else "left out",
            "calibrated": score(predicted, fit.measured),
            "errors": {name: round(error, 3) for name, error in fit.errors.items()},
        }
    return rows


def main(words: Sequence[str]) -> None:
    torch.set_num_threads(1)
    root, folder = words[0], Path(words[1] if len(words) > 1 else "runs/newtons")
    rows: dict[str, Any] = {}
    for name in TRIALS:
        recording = trial(root, name)
        assert recording.force is not None
        inputs = inputs_of(recording, folder / f"{name}.npz")
        forces = np.asarray(recording.force, np.float64)
        within = blocks(inputs, forces)
        usable = np.isfinite([*inputs.values(), *forces.T]).all(0)
        inputs = {key: values[usable] for key, values in inputs.items()}
        after = later(inputs, recording.times[usable], forces[usable])
        for axis in AXES:
            rows[f"{name} {axis}"] = {
                "ten seconds, then the rest": after[axis],
                "five blocks of time": within[axis],
            }
    save("newtons", {"model": MODEL, "seconds": SECONDS, "rows": rows})


if __name__ == "__main__":
    main(sys.argv[1:])
