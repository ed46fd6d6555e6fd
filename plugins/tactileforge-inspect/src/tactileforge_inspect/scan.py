"""One pass over a data set: counts of all recordings, pixels of a sample."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tactileforge.checks import (
    CheckRun,
    Doubts,
    Resting,
    Suspicion,
    check_lag,
    evenly,
    identical_groups,
    is_ignored,
    lag_of,
    odd_pictures,
    sample_of,
    similar_pairs,
)
from tactileforge.contracts import Dataset
from tactileforge.data import Lag
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.plugins import Bar
from tactileforge_inspect.counters import (
    Counters,
    RecordingSample,
    SampledRecording,
    duration_of,
)
from tactileforge_inspect.findings import InspectionFindings, Suspect
from tactileforge_inspect.frame_stats import FrameStats, frame_stats
from tactileforge_inspect.reasons import OF_FRAMES, OF_LABELS, REASONS

SPLITS = ("train", "val")
#: Suspicious recordings to keep for each reason, recordings shown as strips, and recordings to read
#: in full for an estimate of lag, which decodes up to a thousand frames of each.
_WORST = 12
_STRIPS = 9
_LAGS = 10


@dataclass(frozen=True)
class ScannedRecording:
    """Decoded recording with its statistics."""

    of: SampledRecording
    look: FrameStats


@dataclass(frozen=True)
class Scan:
    """Content of the page.

    Attributes:
        tally: Counts of all recordings.
        seen: Decoded recordings, in order.
        strips: Decoded recordings to show over time.
        lags: Recordings with their estimated lag.
        same: Groups of ``seen`` with the same pixels.
        similar: Nearly identical pairs of ``seen``, with their difference, grey levels.
        findings: Findings.
    """

    tally: Counters
    seen: list[ScannedRecording]
    strips: list[ScannedRecording]
    lags: list[tuple[SampledRecording, Lag]]
    same: list[list[int]]
    similar: list[tuple[int, int, float]]
    findings: InspectionFindings


class Suspects:
    """Suspicious recordings: counts of all, and the worst ones."""

    def __init__(self) -> None:
        self.counts = dict.fromkeys(REASONS, 0)
        self._kept: dict[str, list[tuple[float, int, Suspect, SampledRecording]]] = {}

    def add(self, flag: Suspicion, sampled: SampledRecording) -> None:
        """Count a recording, and keep it if it is among the worst."""
        self.counts[flag.reason] += 1
        recording = sampled.recording
        suspect = Suspect(
            flag.reason,
            flag.value,
            flag.words,
            recording.key,
            sampled.split,
            recording.sensor,
            sampled.order,
        )
        heap = self._kept.setdefault(flag.reason, [])
        heapq.heappush(
            heap, (REASONS[flag.reason].worst * flag.value, -sampled.order, suspect, sampled)
        )
        # the mildest goes, and of equal ones the last: memory does not grow with the data
        if len(heap) > _WORST:
            heapq.heappop(heap)

    def kept(self) -> list[SampledRecording]:
        """Recordings kept as the worst."""
        return [entry[3] for heap in self._kept.values() for entry in heap]

    def worst(self, seen: list[ScannedRecording]) -> dict[str, list[Suspect]]:
        """Worst suspects by reason, worst first, with pictures of decoded ones."""
        pictures = {item.of.order: item.look.frame for item in seen}
        return {
            reason: [
                replace(entry[2], picture=pictures.get(entry[2].order))
                for entry in sorted(self._kept[reason], key=lambda e: e[:2], reverse=True)
            ]
            for reason in REASONS
            if reason in self._kept
        }


def scan_dataset(dataset: Dataset, limit: int, progress: bool) -> Scan:
    """Read a data set.

    Args:
        dataset: Data set to inspect.
        limit: Number of recordings to decode.
        progress: Whether to show progress bars.

    Raises:
        DataNotFoundError: The data is missing.
        DataError: No recording can be opened.
    """
    tally, suspects, sample = Counters(), Suspects(), RecordingSample(limit)
    doubts, labels = Doubts(), CheckRun(OF_LABELS)
    unreadable: list[str] = []
    listed = _listed(dataset, unreadable)
    # one pass for all counts, none of which holds a recording: the data may exceed the memory
    for sampled in Bar(listed, desc="count", unit="recording", disable=not progress):
        tally.add(sampled.recording, sampled.split)
        doubts.add(sampled.recording)
        for flag in labels.look(sampled.recording, sampled.split):
            suspects.add(Suspicion(flag.name, flag.value, flag.words), sampled)
        sample.offer(sampled)
    if not tally.totals:
        problems = [*dataset.skipped, *unreadable, "the data set is empty"]
        raise DataError(f"no recording to look at; {problems[0]}")
    # the worst suspects are decoded as well, for their pictures on the page
    drawn = sample.drawn()
    orders = {sampled.order: sampled for sampled in [*drawn, *suspects.kept()]}
    chosen = [orders[order] for order in sorted(orders)]
    stripped = {sampled.order for sampled in _strips(drawn)}
    seen = _look(chosen, stripped, suspects, unreadable, progress)
    # together, after all are decoded: a picture is odd in comparison with the others
    looks = _compare(seen, suspects, has_layout(dataset))
    readable = {item.of.order for item in seen}
    lags = _lags(
        [sampled for sampled in drawn if sampled.order in readable], suspects, unreadable, progress
    )
    images = [item.look for item in seen]
    same, similar = identical_groups(images), similar_pairs(images)
    keys = [item.of.recording.key for item in seen]
    findings = InspectionFindings(
        totals=tally.totals,
        looked=len(seen),
        counts=suspects.counts,
        worst=suspects.worst(seen),
        duplicates=[tuple(keys[i] for i in group) for group in same],
        similar=[(keys[i], keys[j], level) for i, j, level in similar],
        repeated=[key for key, count in tally.names.top("key", _WORST) if count > 1],
        looks=looks,
        unreadable=list(dict.fromkeys([*dataset.skipped, *unreadable])),
        notes=[*getattr(dataset, "notes", ()), *doubts.of_all()],
        held_out=[*getattr(dataset, "held_out", ())],
    )
    strips = [item for item in seen if item.of.order in stripped]
    return Scan(tally, seen, strips, lags, same, similar, findings)


def _listed(dataset: Dataset, unreadable: list[str]) -> Iterator[SampledRecording]:
    """Recordings of both splits; an error in listing them is noted."""
    order = 0
    for split in SPLITS:
        try:
            for recording in dataset.recordings(split):
                yield SampledRecording(recording, split, order)
                order += 1
        except DataNotFoundError:
            raise
        except DataError as error:
            unreadable.append(
                f"{split}: reading stopped, recordings after it are not counted: {error}"
            )


def _look(
    chosen: list[SampledRecording],
    stripped: set[int],
    suspects: Suspects,
    unreadable: list[str],
    progress: bool,
) -> list[ScannedRecording]:
    seen, checks = [], CheckRun(OF_FRAMES)
    for sampled in Bar(chosen, desc="look", unit="recording", disable=not progress):
        try:
            sample = sample_of(sampled.recording)
            pixels = frame_stats(sampled.recording, sampled.order in stripped, sample)
        except DataError as error:
            unreadable.append(f"{sampled.recording.key}: {error}")
            continue
        seen.append(ScannedRecording(sampled, pixels))
        for flag in checks.look(sampled.recording, sampled.split, sample=sample):
            suspects.add(Suspicion(flag.name, flag.value, flag.words), sampled)
    unreadable += checks.unreadable
    return seen


def has_layout(dataset: Dataset) -> bool:
    """Whether layouts describe a data set, or one of a mixture."""
    several = getattr(dataset, "datasets", {}).values()
    return hasattr(type(dataset), "layouts") or any(map(has_layout, several))


def _compare(seen: list[ScannedRecording], suspects: Suspects, has_layout: bool) -> list[str]:
    """Line for each group of odd resting pictures; adds their recordings to the suspects."""
    resting = [
        Resting(one.of.recording.key, one.of.recording.sensor, one.look.shape, one.look.still)
        for one in seen
    ]
    lines = []
    for odd in odd_pictures(resting, has_layout):
        rows = [row for row in odd.rows if not is_ignored(seen[row].of.recording, odd.reason)]
        lines += [odd.line] * bool(rows)
        for row in rows:
            suspects.add(Suspicion(odd.reason, 0.0, odd.words), seen[row].of)
    return lines


def _lags(
    drawn: list[SampledRecording], suspects: Suspects, unreadable: list[str], progress: bool
) -> list[tuple[SampledRecording, Lag]]:
    able = [sampled for sampled in drawn if sampled.recording.force is not None]
    able = _over_sensors(able, _LAGS)
    lags = []
    for sampled in Bar(able, desc="lag", unit="recording", disable=not progress or not able):
        try:
            lag = lag_of(sampled.recording)
        except DataError as error:
            unreadable.append(f"{sampled.recording.key}: {error}")
            continue
        if lag is not None:
            lags.append((sampled, lag))
            for flag in check_lag(sampled.recording, lag):
                suspects.add(flag, sampled)
    return lags


def _strips(drawn: list[SampledRecording]) -> list[SampledRecording]:
    """Recordings to show over time: long ones, with labels over time if the sensor has any."""
    moving = [
        sampled
        for sampled in drawn
        if duration_of(sampled.recording) > 0 and (np.diff(sampled.recording.times) > 0).all()
    ]
    labelled = {sampled.recording.sensor for sampled in moving if _has_curve(sampled)}
    kept = [
        sampled
        for sampled in moving
        if _has_curve(sampled) or sampled.recording.sensor not in labelled
    ]
    frames: dict[str, list[int]] = {}
    for sampled in kept:
        frames.setdefault(sampled.recording.sensor, []).append(len(sampled.recording.frames))
    usual = {sensor: float(np.median(counts)) for sensor, counts in frames.items()}
    long = [
        sampled
        for sampled in kept
        if len(sampled.recording.frames) >= usual[sampled.recording.sensor]
    ]
    return _over_sensors(long, _STRIPS)


def _has_curve(sampled: SampledRecording) -> bool:
    return sampled.recording.force is not None or sampled.recording.action is not None


def _over_sensors(candidates: list[SampledRecording], count: int) -> list[SampledRecording]:
    """Some of the candidates, spread over the sensors and over the order."""
    queues: dict[str, list[SampledRecording]] = {}
    for sampled in candidates:
        queues.setdefault(sampled.recording.sensor, []).append(sampled)
    chosen: list[SampledRecording] = []
    for place, queue in enumerate(sorted(queues.values(), key=len)):
        share = -(-(count - len(chosen)) // (len(queues) - place))
        chosen += [queue[i] for i in evenly(len(queue), share)] if share else []
    return chosen
