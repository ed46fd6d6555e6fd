"""Force predicted against measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data.clips import Clips
from tactileforge.data.datamodule import TouchData
from tactileforge.heads.force import Forces
from tactileforge.module import TouchModule
from tactileforge.report.figures import force_curve_figure, scatter_figure
from tactileforge.report.page import (
    NONE,
    Section,
    legend,
    number,
    panel,
    panels,
    paragraph,
    table,
)
from tactileforge.report.samples import ForceReading, read_forces, spread

AXES = ("x", "y", "z")
_CLIPS = 200
_SPLITS = {"val": "validation", "train": "training"}


@dataclass(frozen=True)
class AxisScore:
    """One axis of one split.

    Attributes:
        mae: Mean absolute error, mN.
        median: That of always giving the median of the training clips, mN.
        correlation: Of measured and predicted; NaN where one of them does not vary.
    """

    mae: float
    median: float
    correlation: float


@dataclass(frozen=True)
class ForceResult:
    """What one head reads.

    Attributes:
        objective: Its name.
        readings: By split, ``val`` first; splits without labelled clips are absent.
        curve: Split and readings of every clip of one recording.
    """

    objective: str
    readings: dict[str, ForceReading]
    curve: tuple[str, ForceReading] | None

    def scores(self, split: str) -> list[AxisScore]:
        """Scores of x, y and z."""
        reading = self.readings[split]
        guess = np.median(self.readings.get("train", reading).measured, axis=(0, 1))
        out = []
        for axis in range(3):
            measured = reading.measured[..., axis].ravel().astype(np.float64)
            predicted = reading.predicted[..., axis].ravel().astype(np.float64)
            varies = measured.std() > 1e-6 and predicted.std() > 1e-9
            out.append(
                AxisScore(
                    1000 * float(np.abs(predicted - measured).mean()),
                    1000 * float(np.abs(guess[axis] - measured).mean()),
                    float(np.corrcoef(measured, predicted)[0, 1]) if varies else float("nan"),
                )
            )
        return out


def force_results(
    module: TouchModule, data: TouchData, predictions: dict[str, object]
) -> list[ForceResult]:
    """Reads the forces of labelled clips with every head that predicts them.

    Args:
        module: The trained module.
        data: The data of the run.
        predictions: One prediction of each head, which tells what it predicts.
    """
    results = []
    for key in (key for key, value in predictions.items() if isinstance(value, Forces)):
        readings: dict[str, ForceReading] = {}
        for split in _SPLITS:
            clips: Clips | None = getattr(data, split)
            which = spread(clips, _CLIPS, _has_force) if clips else []
            reading = read_forces(module, clips, which, key) if clips else None
            if reading:
                readings[split] = reading
        results.append(ForceResult(key, readings, _curve(module, data, readings, key)))
    return results


def _has_force(recording: Recording) -> bool:
    return recording.force is not None


def _curve(
    module: TouchModule, data: TouchData, readings: dict[str, ForceReading], key: str
) -> tuple[str, ForceReading] | None:
    """All clips of the recording whose force varies most, held out if any is."""
    for split in readings:
        clips: Clips = getattr(data, split)
        numbers = np.unique(clips.index[readings[split].clips, 0]).tolist()
        ranges = [np.nanstd(clips.recordings[n].force, axis=0).sum() for n in numbers]
        best = numbers[int(np.argmax(ranges))]
        own = np.flatnonzero(clips.index[:, 0] == best)[:_CLIPS].tolist()
        reading = read_forces(module, clips, own, key)
        if reading and len(reading.clips) > 2:
            return split, reading
    return None


def section(results: list[ForceResult], data: TouchData) -> Section:
    """Scatter and numbers of each axis, and one recording over time."""
    name, title = "force", "Force"
    if not results:
        return Section(name, title, paragraph("No objective predicts force."))
    body = ""
    for result in results:
        if len(results) > 1:
            body += f"<h3>{result.objective}</h3>"
        body += _result(result, data) if result.readings else paragraph("No clip has a force label.")
    return Section(name, title, body)


def _result(result: ForceResult, data: TouchData) -> str:
    assert data.train is not None
    sensors = sorted(
        {
            sensor
            for split, reading in result.readings.items()
            for sensor in _sensors(getattr(data, split), reading)
        }
    )
    splits = " and ".join(
        f"{len(reading.clips)} {_SPLITS[split]} clips" for split, reading in result.readings.items()
    )
    faint = " (drawn faintly)" if len(result.readings) > 1 else ""
    text = f"Each point is a frame of {splits}{faint}; on the dashed line the prediction is right."
    drawings = [panel(f"{axis} (N)", _scatter(result, data, sensors, i)) for i, axis in enumerate(AXES)]
    return (
        paragraph(text)
        + panels(drawings)
        + legend(sensors)
        + _scores(result)
        + _over_time(result, data)
    )


def _sensors(clips: Clips, reading: ForceReading) -> list[str]:
    return [clips.recordings[n].sensor for n in clips.index[reading.clips, 0].tolist()]


def _scatter(result: ForceResult, data: TouchData, sensors: list[str], axis: int) -> str:
    groups = []
    for split, reading in reversed(result.readings.items()):
        names = _sensors(getattr(data, split), reading)
        classes = np.repeat([sensors.index(name) for name in names], reading.measured.shape[1])
        faint = split == "train" and len(result.readings) > 1
        values = [part[..., axis].ravel() for part in (reading.measured, reading.predicted)]
        groups.append((values[0], values[1], classes, 0.25 if faint else 0.9))
    return scatter_figure(groups, ("measured (N)", "predicted (N)"), identity=True)


def _scores(result: ForceResult) -> str:
    rows = [
        (
            f"{axis}, {_SPLITS[split]}",
            number_of(score.mae),
            number_of(score.median),
            number(round(score.correlation, 2)),
        )
        for split in result.readings
        for axis, score in zip(AXES, result.scores(split), strict=True)
    ]
    note = "The last column but one: the error of always giving the median force of the training clips."
    head = ("Axis", "MAE (mN)", "median guess (mN)", "correlation")
    return table(f"force-{result.objective}", head, rows, note)


def _over_time(result: ForceResult, data: TouchData) -> str:
    if result.curve is None:
        return paragraph("No recording has enough labelled clips for a curve over time.", soft=True)
    split, reading = result.curve
    clips: Clips = getattr(data, split)
    recording = clips.recordings[clips.index[reading.clips[0], 0]]
    assert recording.force is not None
    times = np.concatenate([recording.times[clips.rows(clip)[1:]] for clip in reading.clips.tolist()])
    predicted = reading.predicted.reshape(-1, 3)
    shown = (recording.times <= times.max()) & np.isfinite(recording.force).all(1)
    drawings = [
        panel(
            axis,
            force_curve_figure(
                (recording.times[shown], times),
                (recording.force[shown, i], predicted[:, i]),
                axis,
            ),
        )
        for i, axis in enumerate(AXES)
    ]
    title = f"One {_SPLITS[split]} recording over time: {recording.key} ({recording.sensor})"
    line = paragraph("Measured as a line, predicted as points.", soft=True)
    return f"<h3>{_escaped(title)}</h3>" + line + panels(drawings)


def number_of(milli: float) -> str:
    """Millinewton, whole above ten."""
    return NONE if milli != milli else f"{milli:.0f}" if milli >= 10 else f"{milli:.2g}"
