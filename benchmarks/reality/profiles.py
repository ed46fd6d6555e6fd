"""Measures of a set of touches, and the distances between two sets."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from reality import measures
from reality.measures import Array
from reality.response import Response, response
from reality.touches import (
    StrongestTouch,
    TouchMeasures,
    measure_touch,
    strongest_touches,
)
from tactileforge.checks.sample import evenly
from tactileforge.contracts import Frames, FrameSubset, Recording

#: Floor of compared logarithms: a hundredth of a grey level counts as nothing.
_FLOOR = 0.01
#: Number of touches per source with images on the page, and of fitted trials.
SHOWN, _TRIALS = 3, 6


@dataclass
class Profile:
    """The touches of one source on one type of sensor.

    Attributes:
        name: Name of the source.
        sensor: Type of the sensor.
        looks: Measures of each touch.
        responses: Responses to force, one per usable trial.
        shown: A few touches, with images.
        faint: Number of touches too faint to measure.
        stored: Endings of the frames' files, without the dot.
    """

    name: str
    sensor: str
    looks: list[TouchMeasures] = field(default_factory=list)
    responses: list[Response] = field(default_factory=list)
    shown: list[StrongestTouch] = field(default_factory=list)
    faint: int = 0
    stored: list[str] = field(default_factory=list)

    def of(self, name: str) -> Array:
        """One measure of all touches, stacked along the first axis."""
        return np.array([getattr(numbers, name) for numbers in self.looks], np.float64)


def profile(name: str, sensor: str, recordings: Iterable[Recording]) -> Profile:
    """Measures the recordings of a source, one in memory at a time.

    Args:
        name: Name of the source.
        sensor: Type of the sensor of all recordings.
        recordings: Recordings of touches.

    Raises:
        DataError: A recording cannot be read.
    """
    out, every = Profile(name, sensor), 1
    for recording in recordings:
        if (ending := _ending(recording.frames)) and ending not in out.stored:
            out.stored.append(ending)
        for seen in strongest_touches(recording):
            numbers = measure_touch(seen)
            if numbers is None:
                out.faint += 1
                continue
            out.looks.append(numbers)
            if len(out.looks) % every == 1 % every:
                out.shown.append(seen)
            if len(out.shown) == 2 * SHOWN:
                out.shown, every = out.shown[::2], 2 * every
        if len(out.responses) < _TRIALS and (answer := response(recording)) is not None:
            out.responses.append(answer)
    out.shown = [out.shown[row] for row in evenly(len(out.shown), SHOWN)]
    return out


def _ending(frames: Frames) -> str:
    """Ending of the first file of frames, or their codec; "" for frames without a file."""
    while isinstance(frames, FrameSubset):
        frames = frames.base
    if codec := getattr(frames, "codec", ""):
        return str(codec)
    paths = getattr(frames, "paths", None)
    path = paths[0] if paths else getattr(frames, "path", "")
    return Path(str(path)).suffix.lstrip(".").lower()


#: Compared measures, each with the unit of its distance.
DISTANCES = {
    "spectrum": "decades",
    "noise": "decades",
    "area": "decades",
    "contrast": "decades",
    "detail inside": "decades",
    "detail outside": "decades",
    "background colour": "grey levels",
    "channel correlation": "of 1",
    "normal force": "decades",
    "shear": "decades",
}


def distances(ours: Profile, theirs: Profile) -> dict[str, float]:
    """Distance between two sets by each measure, see `DISTANCES`; 0 for equal sets.

    All are Wasserstein distances over touches, see `measures.distance`, of base-10 logarithms
    where the unit is decades (0.3 is a factor of 2), averaged over bands or channels. NaN for a
    measure missing from a set.
    """
    pairs = {name: (_sample(ours, name), _sample(theirs, name)) for name in DISTANCES}
    return {
        name: float(
            np.mean([measures.distance(a, b) for a, b in zip(left.T, other.T, strict=True)])
        )
        for name, (left, other) in pairs.items()
    }


def ratio(apart: Iterable[float], among: Iterable[float]) -> float:
    """Ratio of the distances of simulated touches to real sources and between these.

    Returns:
        The median of the former over the median of the latter; NaN without the latter.
    """
    ours, theirs = (
        np.array([distance for distance in pair if distance == distance]) for pair in (apart, among)
    )
    if not len(ours) or not len(theirs) or not np.median(theirs):
        return float("nan")
    return float(np.median(ours) / np.median(theirs))


def _sample(source: Profile, name: str) -> Array:
    """Values of one measure, (touches, columns)."""
    if name == "spectrum":
        return source.of("bands").reshape(-1, len(measures.BANDS) - 1)
    if name == "background colour":
        return source.of("ground").reshape(-1, 3)
    if name == "channel correlation":
        return correlations(source)
    if name == "normal force":
        return _logs([answer.normal for answer in source.responses])
    if name == "shear":
        return _logs(
            [float(np.nanmean(answer.shear)) for answer in source.responses if _told(answer)]
        )
    words = {"detail inside": "inside", "detail outside": "outside"}
    return _logs(source.of(words.get(name, name)).tolist())


def _told(answer: Response) -> bool:
    return bool(np.isfinite(answer.shear).any())


def _logs(values: Sequence[float]) -> Array:
    known = np.array(values, np.float64).reshape(-1, 1)
    return np.log10(np.maximum(known, _FLOOR))


def correlations(source: Profile) -> Array:
    """Correlation of the changes of red and green, red and blue, green and blue, (touches, 3)."""
    covariance = source.of("covariance").reshape(-1, 3, 3)
    deviation = np.sqrt(np.maximum(np.einsum("ncc->nc", covariance), 1e-9))
    shared: Array = covariance / (deviation[:, :, None] * deviation[:, None])
    return shared[:, [0, 0, 1], [1, 2, 2]]
