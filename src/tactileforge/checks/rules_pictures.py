"""Checks of pictures: TF301 to TF399."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np

from tactileforge.checks.check import Check, Examples, Finding
from tactileforge.checks.codes import CODES
from tactileforge.checks.doubts import FIXES, TINY
from tactileforge.checks.made import COUNT, made_touch, press, resting
from tactileforge.checks.pixels import NEW_GROUND, SATURATED
from tactileforge.checks.resting import Resting, odd_pictures
from tactileforge.checks.rules import LabelCheck, PixelCheck, one_bad
from tactileforge.checks.seen import Seen
from tactileforge.checks.untared import NO_CONTACT
from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data.frames.lazy import ArrayFrames

_FRAMES = frozenset({"frames"})
#: Share of white pixels beyond which the picture is lost.
_LOST = 0.5


class NoBackground(LabelCheck):
    """No frame without contact."""

    reason = "no_background"
    code, level, needs = CODES[reason], "note", frozenset({"labels"})
    title = "No background"
    why = (
        "Nothing is subtracted, so the encoder also sees the light of the sensor. Name a frame "
        "without contact, if there is one."
    )
    fix = "background: {first: 3} or {median: true} in the layout, if nothing touches there"

    @staticmethod
    def examples() -> Examples:
        """None is given."""
        return one_bad(made_touch(no_contact=None))


class NeverInContact(PixelCheck):
    """A recording in the air."""

    reason = "never_in_contact"
    code, level = CODES[reason], "note"
    title = "Never in contact"
    why = (
        f"In no frame that was looked at does the strongest 1 % of the image differ by "
        f"{NO_CONTACT:g} grey levels from the background. There is nothing to learn from."
    )
    fix = "leave it out"
    unit = "grey levels"
    worst = -1

    @staticmethod
    def examples() -> Examples:
        """Nothing touches."""
        return one_bad(made_touch(depth=np.zeros(COUNT)))


class BackgroundChanged(PixelCheck):
    """A background of another light, unit or day."""

    reason = "background_changed"
    code, level = CODES[reason], "warning"
    title = "The background has changed"
    why = (
        f"Even in the frame of least change, half of the image differs by {NEW_GROUND:g} grey "
        "levels or more (of a still, by 20): the light or exposure is another one, or the "
        "background is that of another sensor. Flat objects that cover the gel can look like that."
    )
    fix = FIXES[reason]
    unit = "grey levels"

    @staticmethod
    def examples() -> Examples:
        """The background of another unit."""
        return one_bad(
            made_touch(edit=lambda frames: np.add(frames, 20, out=frames, casting="unsafe"))
        )


class OddFirstFrames(PixelCheck):
    """First frames of another picture taken for the background."""

    reason = "odd_first_frames"
    code, level = CODES[reason], "error"
    title = "Odd first frames are the background"
    why = (
        "A camera that has just opened gives black, green or dim frames. Taken for the background, "
        "they make the whole gel look touched in every clip."
    )
    fix = FIXES[reason]
    unit = "grey levels"

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        for one in super().look(seen):
            start, _, stop = one.words.partition("frames: [")[2].rstrip("]}").partition(", ")
            is_sure = stop.isdigit()  # of other frames than the first, which touch is not known
            keys = {"background": {"frames": [int(start), int(stop)]}} if is_sure else None
            yield self.found(one.where, one.words, one.value, keys)

    @staticmethod
    def examples() -> Examples:
        """Three black frames, which are the background; and a background of good first frames."""
        return Examples([_first(1.0)], [_first(0.02)])


def _first(light: float, count: int = 3) -> Recording:
    """A touch whose first frames, with a share of their light, are the background."""
    frames = made_touch().frames.read(range(COUNT))
    frames[:count] = (frames[:count] * light).astype(np.uint8)
    film = ArrayFrames(frames)
    return made_touch(frames=film, no_contact=FrameSubset(film, range(count)))


class Saturated(PixelCheck):
    """Pixels at 0 or 255."""

    reason = "saturated"
    code, level = CODES[reason], "note"
    title = "Saturated"
    why = (
        f"In the worst frame, more than {100 * SATURATED:g} % of the pixels have a channel at 0 or "
        "255, where touch leaves no trace."
    )
    fix = "record with less light or a shorter exposure"

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`; where light took most of a picture, it is a warning."""
        for one in super().look(seen):
            # a black border takes as much, and nothing is lost there
            yield replace(one, level="warning") if seen.sample.white > _LOST else one

    @staticmethod
    def examples() -> Examples:
        """A bar of light across the picture."""
        return one_bad(made_touch(edit=lambda frames: frames[:, 10:20].fill(255)))


class _RestingCheck(Check):
    """A reason of `resting.odd_pictures`, which compares the gels at rest of a set.

    Attributes:
        reason: The reason.
    """

    needs = frozenset({"frames", "several"})
    reason: ClassVar[str] = ""

    def __init__(self) -> None:
        self._seen: list[Resting] = []
        self._has_layout = True

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        self._has_layout = seen.has_layout
        if seen.is_picture:
            one = seen.recording
            still = seen.sample.still
            self._seen.append(Resting(one.key, one.sensor, seen.sample.shape, still))
        return ()

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        for odd in odd_pictures(self._seen, self._has_layout):
            if odd.reason == self.reason:
                for row in odd.rows:
                    yield self.found(self._seen[row].key, odd.words, 1.0, odd.keys, "")


class ColoursSwapped(_RestingCheck):
    """Red and blue exchanged."""

    reason = "colours_swapped"
    code, level = CODES[reason], "error"
    title = "Red and blue look swapped"
    why = (
        "The gel at rest has the colours of the others, or of its sensor, with red and blue "
        "exchanged: the program that recorded wrote blue first. In a layout, channels: bgr."
    )
    fix = "if so, channels: bgr in the layout; if not, ignore: [TF306]"

    @staticmethod
    def examples() -> Examples:
        """A recorder that writes blue first."""
        return one_bad(made_touch(still=resting()[..., ::-1]))


class OnItsSide(_RestingCheck):
    """A picture after a quarter turn, or half a turn beside the others."""

    reason = "on_its_side"
    code, level = CODES[reason], "error"
    title = "Lying on its side"
    why = (
        "The gel at rest has its lights, or the picture its sides, where those of the sensor are "
        "after a quarter turn. In a layout, rotate: 90 or 270."
    )
    fix = "if so, rotate: 90 or 270 in the layout; if not, ignore: [TF307]"

    @staticmethod
    def examples() -> Examples:
        """A quarter turn."""
        return one_bad(made_touch(still=np.rot90(resting())))


class Mirrored(_RestingCheck):
    """A picture as in a mirror."""

    reason = "mirrored"
    code, level = CODES[reason], "error"
    title = "Mirrored"
    why = (
        "The gel at rest has its lights where those of the sensor are in a mirror: a preview or a "
        "webcam program flips its pictures. The sign of the shear and the names of slides are "
        "wrong. In a layout, mirror: x (left and right) or y (up and down)."
    )
    fix = "if so, mirror: x or y in the layout; if not, ignore: [TF308]"

    @staticmethod
    def examples() -> Examples:
        """Left and right are exchanged."""
        return one_bad(made_touch(still=resting()[:, ::-1]))


class GreyPictures(_RestingCheck):
    """Pictures without colours of a sensor, or a set, that has some."""

    reason = "grey_pictures"
    code, level = CODES[reason], "error"
    title = "Grey pictures"
    why = (
        "The sensor, or the rest of the set, is lit in colours, which tell the slope of the gel; "
        "here the three channels are one."
    )
    fix = "record in colours, or leave it out"

    @staticmethod
    def examples() -> Examples:
        """The mean of the channels in all three."""

        def grey(frames: np.ndarray) -> None:
            frames[:] = frames.mean(-1, keepdims=True)

        still = ArrayFrames(np.repeat(resting().mean(-1)[None, ..., None], 3, -1).astype(np.uint8))
        return one_bad(made_touch(edit=grey, no_contact=still))


class TinyPictures(LabelCheck):
    """Pictures of a few pixels."""

    reason = "tiny_pictures"
    code, level, needs = CODES[reason], "warning", frozenset({"labels"})
    title = "Tiny pictures"
    why = (
        f"Fewer than {TINY} pixels along a side, in which no contact has a shape: were they "
        "reduced, or cut?"
    )
    fix = FIXES[reason]
    unit = "pixels"
    worst = -1

    @staticmethod
    def examples() -> Examples:
        """Pictures of 4 x 3 pixels."""
        small = made_touch(depth=press()).frames.read(range(COUNT))[:, ::20, ::20]
        film = ArrayFrames(np.ascontiguousarray(small))
        return one_bad(made_touch(frames=film, no_contact=FrameSubset(film, [0, 1, 2])))
