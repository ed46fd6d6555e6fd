"""Doubts about pictures of one recording, by a few of its frames."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tactileforge.checks.doubts import Suspicion
from tactileforge.checks.sample import FrameSample
from tactileforge.checks.untared import NO_CONTACT, untared
from tactileforge.contracts import Recording
from tactileforge.data.frames.small import shrink
from tactileforge.sensors.light import LightCheck

#: Change of half of the image of another background, grey levels. Touch is local: real videos with
#: a fitting background stay below 2, and below 0.5 in the air.
NEW_GROUND = 6.0
#: The same of any cause: a large object that covers the gel changes it by up to 14.
NEW_STILL = 20.0
#: Largest share of saturated pixels. Real sensors without overexposure stay below 0.04.
SATURATED = 0.05
#: Longest run of identical frames, s; the noise of a live sensor makes any two frames differ.
FROZEN = 1.0
#: Frames from the start in which a camera may still settle.
_SETTLE = 60
#: Change of half of the image beyond that of any contact, grey levels.
_OTHER = 30.0


def check_pixels(recording: Recording, seen: FrameSample) -> Iterator[Suspicion]:
    """Check the pixels of some frames.

    Args:
        recording: The recording.
        seen: Some of its frames.
    """
    if recording.no_contact is not None:
        if seen.contact < NO_CONTACT:
            yield Suspicion(
                "never_in_contact", seen.contact, f"differs by {seen.contact:.2g} grey levels"
            )
        if odd := odd_first_frames(recording, seen):
            yield odd
        elif _has_changed(seen):
            words = f"half of the image differs by {seen.ground:.2g} grey levels"
            yield Suspicion("background_changed", seen.ground, words)
    if found := untared(recording):
        yield found
    if seen.saturated > SATURATED:
        share = f"{100 * seen.saturated:.0f} %"
        yield Suspicion("saturated", seen.saturated, f"{share} of the pixels")
    if seen.frozen > FROZEN:
        yield Suspicion("frozen", seen.frozen, f"the same image for {seen.frozen:.3g} s")


def _has_changed(seen: FrameSample) -> bool:
    """Whether a background is of another light, unit or day: no touch changes so much of it."""
    if seen.ground <= NEW_GROUND or seen.background is None:
        return False
    if seen.ground > NEW_STILL or len(seen.rows) == 1:
        return seen.ground > NEW_STILL
    still, frame = seen.background, seen.frames[int(seen.change.argmin())]
    return LightCheck(still.round().astype(np.uint8))(frame.round().astype(np.uint8))


def odd_first_frames(recording: Recording, seen: FrameSample) -> Suspicion | None:
    """Find a background of frames that are another picture, as of a camera just opened.

    Args:
        recording: The recording.
        seen: Some of its frames.
    """
    if not seen.own or seen.others <= NEW_GROUND:
        return None
    is_first = min(seen.own) == 0
    start = settled(recording, seen) if is_first else _likest(seen)
    if start is None:
        return None
    frames = recording.frames.read([start])
    # a flat object covers the gel and changes half of it, too, but not the light at all borders
    rest = recording.no_contact
    assert rest is not None  # it has rows of its own
    still = np.rint(np.median(rest.read(range(len(rest))), axis=0))
    is_other = seen.others > _OTHER or LightCheck(still.astype(np.uint8))(frames[0])
    if not is_other:
        return None
    count = len(seen.own)
    if not is_first:  # switched off, or a flash
        words = (
            f"frames {min(seen.own)} to {max(seen.own)}, which are the background, are another "
            f"picture than all others, by {seen.others:.0f} grey levels in half of it: name frames "
            f"without contact: background: {{frames: [{start}, {start + 1}]}} if there is none"
        )
        return Suspicion("odd_first_frames", seen.others, words)
    stop = min(start + count, len(recording.frames))
    what = f"the first {count} frames are" if count > 1 else "the first frame is"
    words = (
        f"{what} another picture than all others, by {seen.others:.0f} grey levels in half of it: "
        f"the gel is settled from frame {start}, so background: {{frames: [{start}, {stop}]}}"
    )
    return Suspicion("odd_first_frames", seen.others, words)


def _likest(seen: FrameSample) -> int | None:
    """Frame outside the background that differs least from it; None without one."""
    others = [i for i, row in enumerate(seen.rows.tolist()) if row not in seen.own]
    return int(seen.rows[min(others, key=lambda i: float(seen.change[i]))]) if others else None


def settled(recording: Recording, seen: FrameSample) -> int | None:
    """First frame that looks like those after it, and not like the background; None without one.

    Args:
        recording: The recording.
        seen: Some of its frames; its background is its first frames.
    """
    count = min(len(recording.frames), _SETTLE)
    frames = [shrink(frame) for frame in recording.frames.read(range(count))]
    # the median over the recording: touch is local, and settling is over soon
    others = [i for i, row in enumerate(seen.rows.tolist()) if row not in seen.own]
    usual = np.median(seen.frames[others], axis=0) if others else frames[-1]
    away = [float(np.median(np.abs(frame - usual).mean(axis=-1))) for frame in frames]
    odd = [row for row in range(count) if away[row] > NEW_GROUND]
    start = odd[-1] + 1 if odd else 0
    return start if 0 < start < count else None
