"""All the numbers of a set of touches, and how far two sets are from each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.reality import measures
from tactileforge.reality.measures import Array
from tactileforge.reality.response import Response, response
from tactileforge.reality.touches import Look, Touch, look, touches

#: Touches of a source of which pictures are kept, and trials that are fitted.
SHOWN, _TRIALS = 4, 6


@dataclass
class Profile:
    """The touches of one source by one type of sensor.

    Attributes:
        name: Of the source.
        sensor: Type of the sensor.
        looks: The numbers of each touch.
        responses: To force, of the trials that tell.
        shown: A few touches, with pictures.
        faint: Touches that were too faint to measure, or had no background.
    """

    name: str
    sensor: str
    looks: list[Look] = field(default_factory=list)
    responses: list[Response] = field(default_factory=list)
    shown: list[Touch] = field(default_factory=list)
    faint: int = 0

    def of(self, name: str) -> Array:
        """A number of all touches, stacked along the first axis."""
        return np.array([getattr(one, name) for one in self.looks], np.float64)


def profile(name: str, sensor: str, recordings: Iterable[Recording]) -> Profile:
    """Measures the recordings of a source, one in memory at a time.

    Args:
        name: Of the source.
        sensor: Type of the sensor of all recordings.
        recordings: Each is one touch.

    Raises:
        DataError: A recording cannot be read.
    """
    out = Profile(name, sensor)
    for recording in recordings:
        for seen in touches(recording):
            found = look(seen)
            if found is None:
                out.faint += 1
                continue
            out.looks.append(found)
            if len(out.shown) < SHOWN:
                out.shown.append(seen)
        if len(out.responses) < _TRIALS and (answer := response(recording)) is not None:
            out.responses.append(answer)
    return out


#: The numbers that are compared: the unit of the distance, and what it is told in.
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
    """One number for each thing that is compared, see `DISTANCES`; 0 for equal sets.

    All are Wasserstein distances over touches, see `measures.distance`, of base-10 logarithms
    where the unit is decades (0.3 is a factor of 2), averaged over bands or channels. NaN where a
    set does not tell.
    """
    pairs = {name: (_sample(ours, name), _sample(theirs, name)) for name in DISTANCES}
    return {
        name: float(
            np.mean([measures.distance(a, b) for a, b in zip(one.T, other.T, strict=True)])
        )
        for name, (one, other) in pairs.items()
    }


def _sample(one: Profile, name: str) -> Array:
    """What is compared, (touches, columns)."""
    if name == "spectrum":
        return one.of("bands").reshape(-1, len(measures.BANDS) - 1)
    if name == "background colour":
        return one.of("ground").reshape(-1, 3)
    if name == "channel correlation":
        return correlations(one)
    if name == "normal force":
        return _logs([answer.normal for answer in one.responses])
    if name == "shear":
        return _logs([float(np.nanmean(answer.shear)) for answer in one.responses if _told(answer)])
    words = {"detail inside": "inside", "detail outside": "outside"}
    return _logs(one.of(words.get(name, name)).tolist())


def _told(answer: Response) -> bool:
    return bool(np.isfinite(answer.shear).any())


def _logs(values: Sequence[float]) -> Array:
    known = np.array(values, np.float64).reshape(-1, 1)
    return np.log10(np.where(known > 0, known, np.nan))


def correlations(one: Profile) -> Array:
    """Correlation of the changes of red and green, red and blue, green and blue, (touches, 3)."""
    covariance = one.of("covariance").reshape(-1, 3, 3)
    deviation = np.sqrt(np.maximum(np.einsum("ncc->nc", covariance), 1e-9))
    shared: Array = covariance / (deviation[:, :, None] * deviation[:, None])
    return shared[:, [0, 0, 1], [1, 2, 2]]


def summary(one: Profile) -> dict[str, Any]:
    """Medians over the touches of a source, as plain data."""
    out: dict[str, Any] = {"touches": len(one.looks), "faint": one.faint}
    if not one.looks:
        return out
    out["bands, log10"] = _rounded(np.nanmedian(one.of("bands"), axis=0))
    for name in ("noise", "area", "contrast", "inside", "outside"):
        values = one.of(name)
        known = values[np.isfinite(values)]
        out[name] = _rounded(np.quantile(known, (0.1, 0.5, 0.9))) if len(known) else None
    ground = one.of("ground")
    out["background"] = _rounded(ground.mean(axis=0))
    out["background spread"] = _rounded(ground.std(axis=0))
    out["change deviation"] = _rounded(
        np.median([np.sqrt(np.diag(look.covariance)) for look in one.looks], axis=0)
    )
    out["channel correlation"] = _rounded(np.median(correlations(one), axis=0))
    if one.responses:
        out["grey levels per N, normal"] = _rounded([a.normal for a in one.responses])
        out["grey levels per N, shear"] = [_rounded(a.shear) for a in one.responses]
        out["shear over contrast, per N"] = _rounded([a.relative for a in one.responses])
        out["curve at 1/4, 1/2, 3/4"] = [_rounded(a.curve) for a in one.responses]
    return out


def _rounded(values: Iterable[float]) -> list[float | None]:
    return [round(float(v), 3) if np.isfinite(v) else None for v in values]
