"""Checks for suspicious recordings; each gives a number, and the same in words.

`data.labels.doubts` has the checks without decoding, shared with training and packing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.data import (
    LARGEST_GAP,
    NO_CONTACT,
    RANGE,
    TINY,
    Lag,
    Suspicion,
    estimate_lag,
    untared,
)
from tactileforge.pages import percent
from tactileforge_inspect.findings import Reason
from tactileforge_inspect.frame_stats import FrameStats, changes

#: Change of half of the image of another background, grey levels. Touch is local: real videos with
#: a fitting background stay below 2, and below 0.5 in the air.
NEW_GROUND = 6.0
#: Largest share of saturated pixels. Real sensors without overexposure stay below 0.04.
SATURATED = 0.05
#: Longest run of identical frames, s; the noise of a live sensor makes any two frames differ.
FROZEN = 1.0
#: Smallest lag to report, s and frames, and smallest certainty of its estimate. Estimates on
#: recordings without lag are off by up to 0.05 s.
LAG = 0.05
LAG_FRAMES = 1.5
LAG_CORRELATION = 0.8
LAG_PROMINENCE = 0.15
#: An imprint grows by shear too, after the force has: a lag below `LAG_LONG` seconds has to fit
#: better than none, by this much in the correlation.
LAG_GAIN, LAG_LONG = 0.1, 0.2
#: Smallest and largest number of frames for an estimate of lag.
LAG_LEAST, LAG_MOST = 30, 1000

#: Checks by name, in the order of the page; `docs/inspect.md` has the same table.
REASONS = {
    "no_background": Reason(
        "No background",
        "Nothing is subtracted, so the encoder also sees the light of the sensor. Name a frame "
        "without contact, if there is one.",
    ),
    "never_in_contact": Reason(
        "Never in contact",
        f"In no frame that was looked at does the strongest 1 % of the image differ by "
        f"{NO_CONTACT:g} grey levels from the background. There is nothing to learn from.",
        "grey levels",
        worst=-1,
    ),
    "background_changed": Reason(
        "The background has changed",
        f"Even in the frame of least change, half of the image differs by {NEW_GROUND:g} grey "
        "levels or more: the light or exposure is another one, or the background is that of "
        "another sensor. Stills, and flat objects that cover the gel, can look like that too.",
        "grey levels",
    ),
    "saturated": Reason(
        "Saturated",
        f"In the worst frame, more than {percent(SATURATED)} of the pixels have a channel at 0 or "
        "255, where touch leaves no trace.",
    ),
    "colours_swapped": Reason(
        "Red and blue look swapped",
        "The gel at rest has the colours of the others, or of its sensor, with red and blue "
        "exchanged: the program that recorded wrote blue first. In a layout, channels: bgr.",
    ),
    "on_its_side": Reason(
        "Lying on its side",
        "The gel at rest has its lights, or the picture its sides, where those of the sensor are "
        "after a quarter turn. In a layout, rotate: 90 or 270.",
    ),
    "grey_pictures": Reason(
        "Grey pictures",
        "The sensor is lit in colours, which tell the slope of the gel; here the three channels "
        "are one.",
    ),
    "frozen": Reason(
        "Frozen",
        f"Frames do not change at all for more than {FROZEN:g} s: the camera, or the program that "
        "recorded, had stopped.",
        "s",
    ),
    "lag": Reason(
        "Images and forces do not fit in time",
        f"By cross-correlation of the normal force with the change of the image, by more than "
        f"{LAG:g} s and {LAG_FRAMES:g} frames. Shift the forces (layouts have lag_s).",
        "s",
    ),
    "gaps_in_time": Reason(
        "Gaps in time",
        f"A step of more than {LARGEST_GAP:g} usual ones, or times that do not increase. No clip "
        "is cut across a gap.",
        "usual steps",
    ),
    "force_out_of_range": Reason(
        "Force out of range",
        f"More than {RANGE:g} times what the sensor's force scale is: wrong unit, or sensor?",
        "times the scale",
    ),
    "axes_exchanged": Reason(
        "Axes of the force look exchanged",
        "In contact, a shear has one sign and is larger than the normal force, which is what "
        "pressing does: the columns may not be in the order x, y, z.",
        "times the normal force",
    ),
    "untared_force": Reason(
        "The force is not tared",
        "Where the picture is that of the background, the force is more than a twentieth of the "
        "scale: the sensor of force has an offset, or something touches in the background.",
        "times the scale",
    ),
    "stuck_force": Reason(
        "The force is stuck",
        "The same force other than 0 stays for more than a second and a quarter of the recording, "
        "or for two seconds between samples with noise, which strain gauges have: the sensor of "
        "force may have stopped.",
        "s",
    ),
    "forces_apart": Reason(
        "Forces start late or end early",
        "More than a second and a tenth of the recording has no force before the first, or after "
        "the last: its sensor was not running, or its times are late.",
        "s",
    ),
    "forces_between": Reason(
        "Frames between have no force",
        "A clip learns force where all of its frames have one. With a label in every third frame, "
        "hardly any clip does. Forces on times of their own are interpolated.",
        "share of the frames",
    ),
    "pulling_force": Reason(
        "Pulling",
        "The normal force is negative, but an object cannot pull the gel: pressing has to be "
        "positive, and the sensor of force tared.",
        "N",
    ),
    "tiny_pictures": Reason(
        "Tiny pictures",
        f"Fewer than {TINY} pixels along a side, in which no contact has a shape: were they "
        "reduced, or cut?",
        "pixels",
        worst=-1,
    ),
    "views_elsewhere": Reason(
        "Camera views of another time",
        "No camera view was taken while the sensor touched, by its times: is their clock, or its "
        "unit, another one?",
        "s",
    ),
}


def check_pixels(recording: Recording, seen: FrameStats) -> Iterator[Suspicion]:
    """Check the pixels of some frames."""
    if recording.no_contact is not None:
        if seen.contact < NO_CONTACT:
            yield Suspicion(
                "never_in_contact", seen.contact, f"differs by {seen.contact:.2g} grey levels"
            )
        if seen.ground > NEW_GROUND:
            words = f"half of the image differs by {seen.ground:.2g} grey levels"
            yield Suspicion("background_changed", seen.ground, words)
    if found := untared(recording):
        yield found
    if seen.saturated > SATURATED:
        yield Suspicion("saturated", seen.saturated, f"{percent(seen.saturated)} of the pixels")
    if seen.frozen > FROZEN:
        yield Suspicion("frozen", seen.frozen, f"the same image for {seen.frozen:.3g} s")


def check_lag(recording: Recording, lag: Lag) -> Iterator[Suspicion]:
    """Check the estimated lag of images behind forces."""
    late = abs(lag.seconds)
    step = recording.period
    is_better = lag.correlation - lag.unshifted >= LAG_GAIN or late >= LAG_LONG
    if is_sure(lag) and is_better and late > max(LAG, LAG_FRAMES * step):
        side = "after" if lag.seconds > 0 else "before"
        words = f"images come {late:.2g} s {side} forces (correlation {lag.correlation:.2g})"
        yield Suspicion("lag", late, words)


def is_sure(lag: Lag) -> bool:
    """Whether a lag is reliable: force and image change, and fit at one lag."""
    return lag.correlation >= LAG_CORRELATION and lag.prominence >= LAG_PROMINENCE


def lag_of(recording: Recording) -> Lag | None:
    """Estimate the lag of a recording with force, around its largest force.

    Returns:
        The lag; None without force, or with too few frames.

    Raises:
        DataError: A frame cannot be decoded.
    """
    force, count = recording.force, len(recording.frames)
    if force is None or count < LAG_LEAST or not np.isfinite(force[:, 2]).any():
        return None
    # around the largest force, as the rest of a long recording may be in the air
    middle = int(np.nanargmax(np.abs(force[:, 2])))
    start = min(max(0, middle - LAG_MOST // 2), max(0, count - LAG_MOST))
    stretch = slice(start, min(count, start + LAG_MOST))
    change = changes(recording, range(count)[stretch])
    return estimate_lag(recording.times[stretch], force[stretch], change)
