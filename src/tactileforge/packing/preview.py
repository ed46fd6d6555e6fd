"""Preview of a filter as a page, for ``tactileforge data filter``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from tactileforge.contracts import Dataset, Recording
from tactileforge.data.frames.cut import spread_rows
from tactileforge.data.frames.pixel_contract import checked_chunks
from tactileforge.data.shards.index import sort_recordings
from tactileforge.errors import DataError
from tactileforge.packing import charts, filters
from tactileforge.packing.options import Filter, PackOptions
from tactileforge.packing.plan import SPLITS
from tactileforge.pages.images import amplified_difference, image, noted, strip
from tactileforge.pages.page import (
    NONE,
    Section,
    card,
    facts,
    html_page,
    items,
    legend,
    number,
    panel,
    panels,
    paragraph,
    percent,
    table,
)
from tactileforge.util.bars import Bar
from tactileforge.util.files import write_text

#: Shares of kept frames for suggested thresholds.
_SHARES = (0.75, 0.5, 0.25)
#: Recordings to show, and frames of a strip.
_SHOWN, _STRIP = 12, 6
#: Frames in memory at once.
_CHUNK = 16


@dataclass(frozen=True)
class Judged:
    """Recording with a score for each frame.

    Attributes:
        recording: Scored recording, a part of a long one.
        rows: int64 (n,), frame numbers after sampling.
        scores: float64 (n,), score of each frame; NaN for the first.
        peaks: float64 (n,), see `filters.peaks`.
    """

    recording: Recording
    rows: NDArray[np.int64]
    scores: NDArray[np.float64]
    peaks: NDArray[np.float64]

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the scored frames since the start of the recording, float64 (n,), s."""
        times: NDArray[np.float64] = self.recording.times[self.rows] - self.recording.times[0]
        return times

    def keeps(self, threshold: float | None) -> NDArray[np.bool_]:
        """Mask of the frames kept by a threshold, bool (n,)."""
        return self.peaks >= (-np.inf if threshold is None else threshold)


def preview(
    dataset: Dataset,
    name: str,
    path: Path,
    options: PackOptions | None = None,
    recordings: int = 24,
    frames: int = 300,
) -> Path:
    """Write a page with the effect of a filter; packs nothing.

    Args:
        dataset: Data set to pack.
        name: Name of the data set.
        path: Path of the page.
        options: Options with the filter; without a threshold, the page suggests some.
        recordings: Number of recordings to decode, spread evenly over the data of each sensor.
        frames: Largest number of frames of each, from its middle.

    Returns:
        Path of the page.

    Raises:
        DataError: No recording can be read.
    """
    chosen = (options or PackOptions()).filter
    everything = sort_recordings(item for split in SPLITS for item in dataset.recordings(split))
    skipped = list(dataset.skipped)
    # sorted by a hash, as for packing: a choice at even distances is a random one
    judged = []
    for recording in Bar(_spread(everything, recordings), desc="look", unit="recording"):
        try:
            start = max(0, (len(recording.frames) - frames) // 2)
            is_long = len(recording.frames) > frames
            part = recording.part(start, start + frames) if is_long else recording
            judged.append(judge(part, chosen))
        except DataError as error:
            skipped.append(f"{recording.key}: {error}")
    if not judged:
        raise DataError(
            "no recording can be read: " + "; ".join(skipped[:3] or ["the data set is empty"])
        )
    sections = [_scores(judged, chosen), _pictures(judged, chosen)]
    if skipped:
        sections.append(Section("skipped", "Not readable", items(skipped)))
    top = _overview(judged, len(everything), chosen)
    write_text(path, html_page(f"What is kept of {name}", top, sections))
    return path


def judge(recording: Recording, chosen: Filter) -> Judged:
    """Score the frames of a recording.

    Raises:
        DataError: A frame cannot be read.
    """
    rows = filters.sample_in_time(recording.times, chosen.every)
    chunks = checked_chunks(recording.frames, rows.tolist(), recording.key, _CHUNK)
    frames = (frame for chunk in chunks for frame in chunk)
    scores = filters.laplacian_scores(zip(rows.tolist(), frames, strict=True))
    times = recording.times[rows]
    peaks = filters.peaks(times, scores, filters.reach(times, chosen.span))
    return Judged(recording, rows, np.array(scores), peaks)


def threshold_for(judged: Sequence[Judged], share: float) -> float:
    """Threshold to keep a share of the frames; NaN for stills alone."""
    peaks = np.concatenate([item.peaks for item in judged])
    peaks = peaks[np.isfinite(peaks)]
    # a score that occurs, not one between two: frames at the threshold are kept
    return float(np.quantile(peaks, 1 - share, method="higher")) if len(peaks) else float("nan")


def _spread(everything: Sequence[Recording], count: int) -> list[Recording]:
    """Recordings spread evenly, as many of each sensor, and at least two of each."""
    sensors: dict[str, list[Recording]] = {}
    for recording in everything:
        sensors.setdefault(recording.sensor, []).append(recording)
    spread = []
    for sensor in sorted(sensors):
        members = sensors[sensor]
        spread += [members[i] for i in spread_rows(len(members), max(2, count // len(sensors)))]
    return spread


def _overview(judged: Sequence[Judged], total: int, chosen: Filter) -> Markup:
    laplacian = chosen.laplacian
    by_sensor = laplacian if isinstance(laplacian, Mapping) else {"": laplacian}
    thresholds = [f"{sensor} {value:g}".strip() for sensor, value in by_sensor.items() if value]
    shares = [item.keeps(chosen.threshold(item.recording.sensor)) for item in judged]
    return facts(
        {
            "Recordings": f"{len(judged)} looked at, of {total:,}",
            "Frames": f"{sum(len(item.rows) for item in judged):,} scored",
            "Threshold": ", ".join(thresholds) or NONE,
            "Sampling": "every frame" if chosen.every is None else f"every {chosen.every:g} s",
            "Length of a clip": f"{chosen.span:g} s",
            "Kept": percent(float(np.concatenate(shares).mean())),
        }
    )


def _scores(judged: Sequence[Judged], chosen: Filter) -> Section:
    """Section of the distribution of scores, with suggested thresholds."""
    sensors: dict[str, list[Judged]] = {}
    for item in judged:
        sensors.setdefault(item.recording.sensor, []).append(item)
    rows = []
    for sensor, scored in sensors.items():
        kept = np.concatenate([item.keeps(chosen.threshold(sensor)) for item in scored])
        rows.append((sensor, str(len(scored)), percent(float(kept.mean())), *_suggested(scored)))
    if len(sensors) > 1:
        rows.append(("all", str(len(judged)), "", *_suggested(judged)))
    head = ("Sensor", "recordings", "kept", *(f"{percent(share)} with" for share in _SHARES))
    drawn = charts.score_histogram(
        {
            sensor: np.concatenate([item.scores for item in scored])
            for sensor, scored in sensors.items()
        },
        {sensor: chosen.threshold(sensor) for sensor in sensors},
    )
    words = (
        "The score of a frame is the variance of the Laplacian of its difference to the frame "
        "before it. A frame is kept if one within the length of a clip reaches the threshold."
    )
    names = dict(enumerate(sensors))
    body = paragraph(words) + panels([panel("Scores", drawn)], wide=True)
    body += legend(names, line="threshold" if chosen.laplacian is not None else "")
    note = (
        "Thresholds (pack.filter.laplacian) that would keep a share of the frames. Stills are "
        "always kept, and left out of account."
    )
    return Section("scores", "Scores", body + table("thresholds", head, rows, note))


def _suggested(judged: Sequence[Judged]) -> list[str]:
    return [number(threshold_for(judged, share)) for share in _SHARES]


def _pictures(judged: Sequence[Judged], chosen: Filter) -> Section:
    shown = [item for item in judged if len(item.rows) > 1] or judged
    cards = [
        _card(shown[i], chosen.threshold(shown[i].recording.sensor))
        for i in spread_rows(len(shown), _SHOWN)
    ]
    words = (
        "Frames with their scores; below each, how it differs from the frame before, amplified "
        "alike in one recording. Shaded: what is kept."
    )
    return Section("frames", "Frames", paragraph(words) + panels(cards, wide=True))


def _card(judged: Judged, threshold: float | None) -> Markup:
    recording, kept = judged.recording, judged.keeps(threshold)
    title = " · ".join(filter(None, (recording.sensor, recording.object, recording.key)))
    body = Markup()
    if len(kept) > 1:
        body += charts.score_curve(judged.times, judged.scores, kept, threshold)
    # the square root of the largest score is a deviation in grey levels: it is shown as 40 of them
    gain = 40 / max(float(np.nanmax(judged.scores, initial=0)) ** 0.5, 1)
    for name, places in (("Kept", np.flatnonzero(kept)), ("Left out", np.flatnonzero(~kept))):
        if len(places):
            shown = np.unique(np.linspace(0, len(places) - 1, min(_STRIP, len(places))).astype(int))
            body += _strip(judged, name, places[shown].tolist(), gain)
    return card(title, body, f"{percent(float(kept.mean()))} kept")


def _strip(judged: Judged, name: str, places: Sequence[int], gain: float) -> Markup:
    """Frames side by side, above their differences from the previous frame."""
    top, bottom = [], []
    for place in places:
        before, row = judged.rows[max(place - 1, 0)], judged.rows[place]
        pair = judged.recording.frames.read([int(before), int(row)])
        change = amplified_difference(pair[1].astype(np.int16) - pair[0], gain)
        value = number(float(judged.scores[place]))
        words = f"frame {row}, score {value}"
        top.append(image(pair[1], words))
        bottom.append(noted(image(change, f"change, {words}"), value))
    return strip(top, _STRIP, name) + strip(bottom, _STRIP)
