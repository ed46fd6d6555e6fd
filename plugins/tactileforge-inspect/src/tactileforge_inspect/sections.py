"""Sections of the page on content: totals, images, labels."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from markupsafe import Markup

from tactileforge.checks import LAG_CORRELATION, LAG_PROMINENCE, evenly, is_sure
from tactileforge.contracts import ACTIONS, LABELS
from tactileforge.data import counted, size_text
from tactileforge.pages import (
    MINUS,
    NONE,
    SPLIT_WORDS,
    Section,
    card,
    cards,
    duration,
    figure,
    heading,
    image,
    legend,
    number,
    panel,
    panels,
    paragraph,
    recording_figure,
    strip,
    table,
)
from tactileforge_inspect import charts
from tactileforge_inspect.counters import source_rows
from tactileforge_inspect.findings import Total
from tactileforge_inspect.scan import Scan, ScannedRecording

AXES = ("x", "y", "z")
#: Recordings of a contact sheet of a sensor, and rows of objects and of sources.
_SHEET, _OBJECTS, _SOURCES = 24, 30, 20


def totals(survey: Scan) -> Section:
    """Section of totals: recordings, frames, time, labels and sources."""
    shapes: dict[str, Counter[str]] = {}
    for seen in survey.seen:
        shape = shapes.setdefault(seen.of.recording.sensor, Counter())
        shape[size_text(seen.look.shape)] += 1
    sizes = {sensor: [size for size, _ in shape.most_common()] for sensor, shape in shapes.items()}
    rows = [
        (f"{sensor}, {SPLIT_WORDS[split]}", *_row(total, sizes.get(sensor, [])))
        for (split, sensor), total in sorted(survey.tally.totals.items(), key=lambda row: row[0][1])
    ]
    head = ("Sensor", "recordings", "frames", "time", "Hz", "text|pixels", *LABELS, "background")
    note = "Under a label, and under background, the number of recordings that have it."
    names, _ = survey.tally.names.number("source")
    lines = [
        (source or "not given", f"text|{licence or 'not given'}", tier, f"{count:,}")
        for source, licence, tier, count in source_rows(survey.tally.names, _SOURCES)
    ]
    body = table("recordings", head, rows, note)
    for line in survey.findings.held_out:
        body += paragraph(f"Held out: {line}.")
    body += table("sources", ("Source", "text|licence", "tier", "recordings"), lines)
    if names > _SOURCES:
        body += paragraph(f"And {names - _SOURCES} more sources.", soft=True)
    return Section("totals", "Contents", body)


def _row(total: Total, sizes: Sequence[str]) -> list[str]:
    low, high = round(total.slowest, 1), round(total.fastest, 1)
    rate = f"{low:g} to {high:g}" if high > low else f"{low:g}"
    rate = NONE if math.isnan(low) else rate
    more = f" and {len(sizes) - 3} more" if len(sizes) > 3 else ""
    return [
        f"{total.recordings:,}",
        f"{total.frames:,}",
        duration(total.seconds) if total.seconds else "stills",
        rate,
        f"text|{', '.join(sizes[:3]) or NONE}{more}",
        *(counted(total.carrying, label) for label in (*LABELS, "background")),
    ]


def sheets(survey: Scan) -> Section:
    """Section of contact sheets: for each sensor, the strongest contact of some recordings."""
    by_sensor: dict[str, list[ScannedRecording]] = {}
    for item in survey.seen:
        by_sensor.setdefault(item.of.recording.sensor, []).append(item)
    body = paragraph(
        "The frame that differs most from the background, and the difference around mid-grey, "
        "amplified; no difference where a recording has no background."
    )
    for sensor, seen in sorted(by_sensor.items()):
        body += heading(sensor) + cards(recording_card(seen[i]) for i in evenly(len(seen), _SHEET))
    return Section("contact", "Contact", body)


def recording_card(seen: ScannedRecording, words: str = "") -> Markup:
    """Card of a recording: its frame of largest contact, the difference, and a caption."""
    pictures = [seen.look.frame]
    if seen.look.difference is not None:
        pictures.append(seen.look.difference)
    key = seen.of.recording.key
    return figure(pictures, words or key, key, 2)


def strips(survey: Scan) -> Section:
    """Section of recordings over time, with their forces and actions."""
    if not survey.strips:
        text = "Every recording that was looked at is a still: there is nothing to show over time."
        return Section("clips", "Over time", paragraph(text))
    body = paragraph(
        "Recordings spread over the sensors, frames spread over their time (marked on the axis); "
        "below them the difference from the background, amplified. "
        "Forces are those of the object on the gel: x to the right of the image, y down, z into "
        "the gel."
    )
    if any(seen.of.recording.force is not None for seen in survey.strips):
        body += legend({i: f"{axis} (N)" for i, axis in enumerate(AXES)}, area="a labelled action")
    return Section("clips", "Over time", body + panels(map(_strip, survey.strips), wide=True))


def _strip(seen: ScannedRecording) -> Markup:
    recording = seen.of.recording
    title = " · ".join(filter(None, (recording.sensor, recording.object)))
    images = [
        image(picture, f"frame {row}{words}")
        for pictures, words in ((seen.look.strip, ""), (seen.look.strip_difference, ", difference"))
        for picture, row in zip(pictures, seen.look.strip_rows, strict=False)
    ]
    body = strip(images, len(seen.look.strip))
    if recording.force is not None or recording.action is not None:
        body += recording_figure(recording, recording.times[seen.look.strip_rows].tolist())
    rate = 1 / recording.period
    seconds = float(recording.times[-1] - recording.times[0])
    below = f"{recording.key} · {len(recording.frames)} frames, {seconds:.3g} s, {rate:.3g} Hz"
    if recording.text:
        below += f" · “{recording.text}”"
    return card(title, body, below)


def label_histograms(survey: Scan) -> Section:
    """Section of histograms of forces, actions, objects and durations."""
    tally, parts = survey.tally, []
    body = Markup()
    if tally.forces:
        sensors = dict(sorted(tally.forces.items()))
        by_axis = {axis: [of[i] for of in sensors.values()] for i, axis in enumerate(AXES)}
        known = {axis: of for axis, of in by_axis.items() if any(one.counts.any() for one in of)}
        drawings = [
            panel(f"Force along {axis}", charts.force_histogram(of, axis))
            for axis, of in known.items()
        ]
        body += legend(dict(enumerate(sensors))) + panels(drawings)
        if missing := [axis for axis in AXES if axis not in known]:
            body += paragraph(f"No force is known along {' and '.join(missing)}.", soft=True)
    actions = dict(tally.names.top("action", len(ACTIONS) + 1))
    if actions:
        names = {name.replace("_", " "): count for name, count in actions.items()}
        parts.append(panel("Frames by action", charts.bars(names, "frames by action")))
    if tally.durations.sum():
        stills = f"{tally.stills:,} stills are left out." if tally.stills else ""
        parts.append(panel("Durations", charts.durations(tally.durations), stills))
    objects = tally.names.top("object", _OBJECTS)
    if objects:
        kinds, counted = tally.names.number("object")
        rest = counted - sum(count for _, count in objects)
        more = f"{kinds - len(objects):,} more objects have {rest:,} recordings."
        drawing = charts.bars(dict(objects), "recordings by object")
        title = f"Recordings by object ({kinds:,})"
        parts.append(panel(title, drawing, more if kinds > len(objects) else ""))
    if not body and not parts:
        body = paragraph("Stills without labels.")
    return Section("labels", "Labels", body + panels(parts, wide=True) + _lags(survey))


def _lags(survey: Scan) -> Markup:
    if not survey.lags:
        return Markup()
    rows = [
        (
            drawn.recording.sensor,
            f"text|{drawn.recording.key}",
            f"{1000 * lag.seconds:.0f}".replace("-", MINUS) if is_sure(lag) else "not sure",
            number(lag.correlation),
            number(lag.prominence),
        )
        for drawn, lag in survey.lags
    ]
    head = ("Sensor", "text|recording", "lag (ms)", "correlation", "prominence")
    words = (
        "Lag of images behind forces, from all frames of a few recordings: the normal "
        "force is correlated with the change of the image. Where the correlation, or its "
        f"prominence over other lags, is below {LAG_CORRELATION:g} or {LAG_PROMINENCE:g}, the "
        "recording does not tell."
    )
    return heading("Forces and images in time") + table("lags", head, rows, words)
