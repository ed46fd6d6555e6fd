"""Force predicted against measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from tactileforge.contracts import AXES
from tactileforge.data.batches.clips import Clips
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.pages.curves import Curve
from tactileforge.pages.figures import SPLITS, lines_figure
from tactileforge.pages.forces import agreement_figure, prediction_figure
from tactileforge.pages.page import (
    NONE,
    SPLIT_WORDS,
    Section,
    heading,
    legend,
    number,
    panel,
    panels,
    paragraph,
    table,
)
from tactileforge.report.axes import AxisScore, axis_score
from tactileforge.report.samples import ClipReader, ForceReading, spread, spread_places, whole_key

#: Word for the recordings of a mixture that name no source.
OWN = "own recordings"


@dataclass(frozen=True)
class ForceResult:
    """Forces predicted by one head, and their scores.

    Attributes:
        objective: Name of the objective of the head.
        readings: Readings by split, ``val`` first; splits without labelled clips are absent.
        recording: Key of the recording shown over time.
        curve: Readings of the parts of that recording, by split.
        origins: Source of each clip of the readings, by split; see `contracts.Recording`.
    """

    objective: str
    readings: dict[str, ForceReading]
    recording: str
    curve: dict[str, ForceReading]
    origins: dict[str, list[str]]

    @property
    def sources(self) -> list[str]:
        """Distinct sources of the clips."""
        return sorted({source for of in self.origins.values() for source in of})

    def scores(self, split: str, source: str | None = None) -> list[AxisScore]:
        """Scores of x, y and z, of all clips or of a source; NaN along an axis without a label."""
        measured, predicted = self._of(split, source)
        known, _ = self._of("train" if "train" in self.readings else split, source)
        return [
            axis_score(measured[..., i], predicted[..., i], known[..., i]) for i in range(len(AXES))
        ]

    def _of(self, split: str, source: str | None) -> tuple[NDArray[Any], NDArray[Any]]:
        """Measured and predicted forces of the clips of a source; None for all."""
        reading = self.readings[split]
        if source is None:
            return reading.measured, reading.predicted
        rows = [i for i, one in enumerate(self.origins[split]) if one == source]
        return reading.measured[rows], reading.predicted[rows]


def force_results(
    readers: Mapping[str, ClipReader], keys: Sequence[str], count: int
) -> list[ForceResult]:
    """Predicts the forces of labelled clips with every force head.

    Args:
        readers: Readers of clips, by split.
        keys: Objectives whose heads predict forces.
        count: Largest number of clips to read, per split and for the recording shown over time.
    """
    results = []
    for key in keys:
        readings: dict[str, ForceReading] = {}
        for split, reader in readers.items():
            labelled = spread(reader.clips, count, lambda recording: recording.force is not None)
            reading = reader.forces(labelled, key)
            if reading:
                readings[split] = reading
        recording = _liveliest(readers, readings)
        curve = {}
        for split in readings:
            clips = readers[split].clips
            # its parts may be in both splits
            clips_of_it = [i for i, r in enumerate(clips.recordings) if whole_key(r) == recording]
            cut = np.flatnonzero(np.isin(clips.index[:, 0], clips_of_it))
            reading = readers[split].forces(cut[spread_places(len(cut), count)].tolist(), key)
            if reading:
                curve[split] = reading
        origins = {
            split: _origins(readers[split].clips, reading) for split, reading in readings.items()
        }
        results.append(ForceResult(key, readings, recording, curve, origins))
    return results


def _origins(clips: Clips, reading: ForceReading) -> list[str]:
    return [clips.recordings[n].source for n in clips.index[reading.clips, 0].tolist()]


def _liveliest(readers: Mapping[str, ClipReader], readings: Mapping[str, ForceReading]) -> str:
    """Key of the recording with the most varying force, among those of the first split."""
    forces: dict[str, list[NDArray[np.float32]]] = {}
    for split, reading in readings.items():
        clips = readers[split].clips
        for row in np.unique(clips.index[reading.clips, 0]).tolist():
            recording = clips.recordings[row]
            if split == next(iter(readings)) and recording.force is not None:
                forces.setdefault(whole_key(recording), []).append(recording.force)
    varies = {}
    for key, parts in forces.items():
        # deviations of the labelled axes, N: a constant force along one of them counts nothing
        axes = (axis[np.isfinite(axis)] for axis in np.concatenate(parts).T)
        varies[key] = float(sum(values.std() for values in axes if len(values)))
    return max(varies, key=lambda key: varies[key], default="")


def forces_section(
    results: list[ForceResult], data: TouchData, curves: Mapping[str, Curve], last_step: int
) -> Section:
    """Scatter plot and scores of each axis, R2 over the run, and one recording over time.

    Args:
        results: Results of each force head.
        data: Data of the run.
        curves: Logged values, by name.
        last_step: Last step of the run.
    """
    name, title = "force", "Force"
    body = Markup()
    for result in results:
        if len(results) > 1:
            body += heading(result.objective)
        body += (
            _result(result, data, _learning(result.objective, curves, last_step))
            if result.readings
            else paragraph("No clip has a force label.")
        )
    return Section(name, title, body)


def _learning(objective: str, curves: Mapping[str, Curve], last_step: int) -> Markup:
    """R2 and deviation of the predictions of each axis, over the run."""
    drawn = []
    for name, title, unit in (
        ("r2_{}", "R\N{SUPERSCRIPT TWO} of each axis, validation", "R\N{SUPERSCRIPT TWO}"),
        ("deviation_{}_N", "Deviation of the predictions, validation", "N"),
    ):
        by_axis = {axis: curves.get(f"val/{objective}/{name.format(axis)}") for axis in AXES}
        lines = {axis: curve for axis, curve in by_axis.items() if curve is not None}
        if lines:
            drawn.append(panel(title, lines_figure(unit, last_step, lines)))
    names = dict(enumerate(AXES))
    return heading("Over the run") + legend(names) + panels(drawn) if drawn else Markup()


def _result(result: ForceResult, data: TouchData, learning: Markup) -> Markup:
    sensors = sorted(
        {
            sensor
            for split, reading in result.readings.items()
            for sensor in _sensors(getattr(data, split), reading)
        }
    )
    splits = " and ".join(
        f"{len(reading.clips)} {SPLIT_WORDS[split]} clips"
        for split, reading in result.readings.items()
    )
    faint = " (drawn faintly)" if len(result.readings) > 1 else ""
    text = f"Each point is a frame of {splits}{faint}; on the dashed line the prediction is right."
    drawings = [
        panel(f"{axis} (N)", _scatter(result, data, sensors, i))
        for i, axis in enumerate(AXES)
        if any(np.isfinite(head.measured[..., i]).any() for head in result.readings.values())
    ]
    return (
        paragraph(text)
        + panels(drawings)
        + legend(dict(enumerate(sensors)))
        + _scores(result)
        + learning
        + _over_time(result, data)
    )


def _sensors(clips: Clips, reading: ForceReading) -> list[str]:
    return [clips.recordings[n].sensor for n in clips.index[reading.clips, 0].tolist()]


def _scatter(result: ForceResult, data: TouchData, sensors: list[str], axis: int) -> Markup:
    groups = []
    # validation last, on top of the fainter training clips
    for split, reading in reversed(result.readings.items()):
        names = _sensors(getattr(data, split), reading)
        classes = np.repeat([sensors.index(name) for name in names], reading.measured.shape[1])
        faint = split == "train" and len(result.readings) > 1
        true, estimated = (
            part[..., axis].ravel() for part in (reading.measured, reading.predicted)
        )
        known = np.isfinite(true)
        groups.append((true[known], estimated[known], classes[known], 0.25 if faint else 0.9))
    return agreement_figure(groups, ("measured (N)", "predicted (N)"))


def _scores(result: ForceResult) -> Markup:
    rows = [
        (
            f"{axis}, {SPLIT_WORDS[split]}{'' if source is None else f', {source or OWN}'}",
            newtons(axis_score.mae),
            newtons(axis_score.median),
            number(round(axis_score.correlation, 2) + 0.0),  # + 0.0 turns -0.0 into 0
            number(round(axis_score.r2, 2) + 0.0),
            newtons(axis_score.measured),
            f"{'bad|' if axis_score.collapsed else ''}{newtons(axis_score.predicted)}",
        )
        for split in result.readings
        for source in (None, *(result.sources if len(result.sources) > 1 else ()))
        if source is None or source in result.origins[split]
        for axis, axis_score in zip(AXES, result.scores(split, source), strict=True)
    ]
    note = (
        "Median guess: the error of always giving the median force of the training clips. An axis "
        "whose predictions deviate by less than a tenth of the force's deviation has collapsed."
    )
    head = ("Axis", "MAE (N)", "median guess (N)", "correlation", "R\N{SUPERSCRIPT TWO}")
    columns = (*head, "deviation (N)", "predicted (N)")
    return table(f"force-{result.objective}", columns, rows, note)


def _over_time(result: ForceResult, data: TouchData) -> Markup:
    measured, predicted = [], {}
    for split, reading in result.curve.items():
        clips: Clips = getattr(data, split)
        for row in np.unique(clips.index[reading.clips, 0]).tolist():
            recording = clips.recordings[row]
            measured.append((recording.times, recording.force))
        rows = [(clip, clips.recordings[clips.index[clip, 0]]) for clip in reading.clips.tolist()]
        # forces are predicted for frames 2..T
        times = np.concatenate([part.times[clips.rows(clip)[1:]] for clip, part in rows])
        predicted[split] = (times, reading.predicted.reshape(-1, 3))
    drawings = []
    for i, axis in enumerate(AXES):
        if not any(force is not None and np.isfinite(force[:, i]).any() for _, force in measured):
            continue
        lines = [(times, force[:, i]) for times, force in measured]
        points = {split: (times, force[:, i]) for split, (times, force) in predicted.items()}
        drawings.append(panel(f"{axis} (N)", prediction_figure(lines, points, axis)))
    names = {SPLITS[split]: f"predicted, {SPLIT_WORDS[split]}" for split in predicted}
    title = f"One recording over time: {result.recording}"
    return heading(title) + legend(names, line="measured") + panels(drawings)


def newtons(value: float) -> str:
    """A force in N as text: two digits, at least to the millinewton."""
    return NONE if value != value else f"{value:.3f}" if value < 0.1 else f"{value:.2f}"
