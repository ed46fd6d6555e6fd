"""Lights switched on during a press, read by a calibration of ten seconds.

Forty synthetic lights, on the public trials with measured forces, in pictures in which something
presses. Of each light: the share of frames that are read (with a force, not NaN), and in these the
mean error, over frames, of the axis that the light moves most. Beside it the later frames without
another light that get no force (false alarms), and the same by five blocks of time.

The fit is that of the pictures, without a model. `sensors.light.LightCheck` looks first, as in
`Model.force`.

Run: python benchmarks/lights_pressed.py REALDATA
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
import torch
from common import save
from newtons import SECONDS, TRIALS, trial
from numpy.typing import NDArray
from tactileforge_live.calibrate.fit import fit_axis, folds, hardly_pressed
from tactileforge_live.calibrate.force import candidates, keep_axes

from tactileforge.contracts import AXES
from tactileforge.sensors import (
    PICTURE_FEATURES,
    LightCheck,
    amid_other_light,
    border_inputs,
    border_range,
    frame_chunks,
    has_other_light,
    median_background,
    picture_inputs,
)

#: Colours of lamps, and every how manieth later frame is lit.
COLOURS = {
    "white": (1, 1, 1),
    "red": (1, 0.15, 0.1),
    "green": (0.1, 1, 0.15),
    "blue": (0.1, 0.2, 1),
    "warm": (1, 0.8, 0.5),
}
EVERY = 12
#: Largest error of a frame that is read, N: what a light may do unseen.
ALLOWED = 0.3

Floats = NDArray[np.float64]
Inputs = Mapping[str, Floats]


def lights(size: tuple[int, int]) -> dict[str, tuple[Floats, Floats]]:
    """Added grey levels and factor of each light, float (H, W, 3) or one number."""
    x, y = np.meshgrid(*(np.linspace(0, 1, n) for n in size[::-1]))
    none: Floats = np.zeros(1)
    whole: Floats = np.ones(1)
    lamps: dict[str, Floats] = {}
    for number, far in enumerate(((x, y), (1 - x, y), (x, 1 - y), (1 - x, 1 - y))):
        shape = np.exp(-(far[0] ** 2 + far[1] ** 2) / 0.15)[..., None]
        for colour, level in (("white", 40), ("white", 12), ("warm", 25), ("red", 40)):
            lamps[f"corner {number} {colour} {level}"] = level * shape * np.array(COLOURS[colour])
    for colour, level in (
        *(("white", 10), ("white", 4), ("red", 10), ("red", 25)),
        *(("green", 10), ("green", 25), ("blue", 15)),
    ):
        lamps[f"uniform {colour} {level}"] = level * np.array(COLOURS[colour])
    for side, ramp in (("left", 1 - x), ("right", x), ("top", 1 - y), ("bottom", y)):
        lamps[f"gradient {side} white 20"] = 20 * ramp[..., None] * np.ones(3)
    for side, ramp in (("left", 1 - x), ("bottom", y)):
        lamps[f"gradient {side} red 30"] = 30 * ramp[..., None] * np.array(COLOURS["red"])
    for side, away in (("left", x), ("right", 1 - x), ("top", y)):
        lamps[f"edge {side} white 30"] = 30 * np.exp(-away / 0.2)[..., None] * np.ones(3)
    lamps["edge bottom red 40"] = 40 * np.exp((y - 1) / 0.2)[..., None] * np.array(COLOURS["red"])
    above = np.exp(-((x - 0.5) ** 2 + (y - 0.4) ** 2) / 0.2)[..., None]
    lamps["lamp above 25"] = 25 * above * np.ones(3)
    found = {name: (lamp, whole) for name, lamp in lamps.items()}
    found |= {"exposure 1.1": (none, 1.1 * whole), "exposure .92": (none, 0.92 * whole)}
    found["red dims"] = none, np.array([0.8, 1, 1])
    found["one side dims"] = none, 1 - 0.25 * np.exp(-(x**2) / 0.2)[..., None]
    # its phase is that of the frame, see `lit`
    return found | {"flicker 6": (6 * whole, whole), "flicker 15": (15 * whole, whole)}


def lit(frames: NDArray[np.uint8], name: str, light: tuple[Floats, Floats]) -> NDArray[np.uint8]:
    """Frames in a light, uint8 (N, H, W, 3)."""
    add, gain = light
    if name.startswith("flicker"):
        add = add * np.sin(2 * np.pi * 0.23 * np.arange(len(frames)))[:, None, None, None]
    shown: NDArray[np.uint8] = np.rint(frames * gain + add).clip(0, 255).astype(np.uint8)
    return shown


def shrunk(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Downsample to a quarter of the rows and columns by area; every cell below is larger."""
    size = frames.shape[2] // 4, frames.shape[1] // 4
    return np.stack([cv2.resize(one, size, interpolation=cv2.INTER_AREA) for one in frames])


def inputs_of(frames: NDArray[np.uint8], rest: NDArray[np.uint8]) -> Inputs:
    """Inputs from pictures, float64 (N,) each, with the changes at the borders."""
    rows = []
    for start in range(0, len(frames), 64):
        some = frames[start : start + 64]
        seen, still = (torch.from_numpy(x).movedim(-1, -3) for x in (some, rest[None]))
        found = {name: value.numpy() for name, value in picture_inputs(seen, still).items()}
        rows.append(found | border_inputs(some, rest))
    return {name: np.concatenate([row[name] for row in rows]).astype(float) for name in rows[0]}


def part(inputs: Inputs, rows: Any) -> Inputs:
    """Inputs of some frames."""
    return {name: values[rows] for name, values in inputs.items()}


def alarms(inputs: Inputs, times: Floats) -> dict[str, float]:
    """False-alarm rates, percent of frames, of a calibration from the other frames."""
    early, block = times < SECONDS, np.arange(len(times)) * 5 // len(times)
    later = has_other_light(part(inputs, ~early), border_range(part(inputs, early)))
    later = amid_other_light(later, times[~early])
    blocks = np.concatenate(
        [
            has_other_light(part(inputs, block == n), border_range(part(inputs, block != n)))
            for n in range(5)
        ]
    )
    return {
        "later": round(100 * float(later.mean()), 2),
        "blocks": round(100 * float(amid_other_light(blocks, times).mean()), 2),
    }


def judged(name: str, root: str) -> dict[str, Any]:
    """False alarms of one trial, and the effect of each light."""
    recording = trial(root, name)
    assert recording.force is not None
    frames = np.concatenate([shrunk(part) for part in frame_chunks(recording.frames)])
    (rest,) = shrunk(median_background(recording).round().astype(np.uint8)[None])
    forces, times = np.asarray(recording.force, np.float64), recording.times
    inputs = inputs_of(frames, rest)
    usable = np.isfinite(forces).all(1)
    early = usable & (times < SECONDS)
    pictures = {key: inputs[key][early] for key in PICTURE_FEATURES}
    fold = folds([int(early.sum())])
    fits = {
        axis: fit_axis(pictures, candidates("pictures", axis, pictures), column, fold, axis)
        for axis, column in zip(AXES, forces[early].T, strict=True)
    }
    kept, _ = keep_axes(fits, hardly_pressed(forces[early]))
    axes = {axis: fit.axis for axis, fit in kept.items() if fit.axis is not None}
    known = border_range(part(inputs, early))
    rows = np.flatnonzero(usable & (times >= SECONDS))[::EVERY]
    check, plain = LightCheck(rest), part(inputs, rows)
    told: dict[str, Any] = {}
    for light, change in lights(frames.shape[1:3]).items():
        shown = lit(frames[rows], light, change)
        seen = inputs_of(shown, rest)
        other = has_other_light(seen, known) | np.array([check(one) for one in shown])
        # as frames of 30 Hz in a row, of which a stream knows those before
        read = ~amid_other_light(other, np.arange(len(rows)) / 30, ahead=False)
        error = np.max([np.abs(axis(seen) - axis(plain)) for axis in axes.values()], 0)
        told[light] = {
            "read": round(float(read.mean()), 3),
            "error_unchecked": round(float(error.mean()), 2),
            "error_read": round(float(error[read].mean()), 2) if read.any() else None,
            "worst_read": round(float(error[read].max()), 2) if read.any() else None,
        }
    worst = [row["worst_read"] or 0.0 for row in told.values()]
    return {
        "axes": list(axes),
        "frames": [int(early.sum()), len(rows)],
        "false_alarms_percent": alarms(part(inputs, usable), times[usable]),
        "read_percent": round(100 * float(np.mean([row["read"] for row in told.values()])), 2),
        "lights_never_read": sum(row["read"] == 0 for row in told.values()),
        "lights_within_allowed": sum(one <= ALLOWED for one in worst),
        "lights": told,
    }


def table(rows: Mapping[str, Any]) -> str:
    """The table of `docs/calibrate.md`, by kind of light."""
    kinds: dict[str, list[str]] = {}
    for light in next(iter(rows.values()))["lights"]:
        kinds.setdefault(light.split()[0], []).append(light)
    lines = ["| light | " + " | ".join(f"{name}: unchecked; read, worst" for name in rows) + " |"]
    lines.append("|---" * (len(rows) + 1) + "|")
    for kind, names in kinds.items():
        cells = []
        for row in rows.values():
            some = [row["lights"][name] for name in names]
            error = np.mean([one["error_unchecked"] for one in some])
            share = 100 * np.mean([one["read"] for one in some])
            worst = max(one["worst_read"] or 0.0 for one in some)
            cells.append(f"{error:.2f} N; {share:.0f} %" + (f", {worst:.2f} N" if share else ""))
        lines.append(f"| {kind}, {len(names)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(words: Sequence[str]) -> None:
    torch.set_num_threads(1)
    rows = {name: judged(name, words[0]) for name in TRIALS}
    print(table(rows))
    save("lights_pressed", {"seconds": SECONDS, "allowed_newton": ALLOWED, "trials": rows})


if __name__ == "__main__":
    main(sys.argv[1:])
