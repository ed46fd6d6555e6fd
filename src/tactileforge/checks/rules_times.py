"""Checks of times: TF101 to TF199."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tactileforge.checks.check import Check, Examples, Finding
from tactileforge.checks.clocks import repeated_times
from tactileforge.checks.codes import CODES
from tactileforge.checks.doubts import FIXES
from tactileforge.checks.lag import LAG, LAG_FRAMES, check_lag, lag_of
from tactileforge.checks.made import COUNT, FPS, made_touch, press
from tactileforge.checks.pixels import FROZEN
from tactileforge.checks.repeats import every, repeated
from tactileforge.checks.rules import LabelCheck, PixelCheck, one_bad, right_force, with_force
from tactileforge.checks.seen import Seen
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.labels.align import LARGEST_GAP

#: Share of steps far shorter than usual from which frames count as stored twice.
_PAIRED = 0.3


class GapsInTime(LabelCheck):
    """A step of several usual ones, or times that do not increase."""

    reason = "gaps_in_time"
    code, level, needs = CODES[reason], "warning", frozenset({"times"})
    title = "Gaps in time"
    why = (
        f"A step of more than {LARGEST_GAP:g} usual ones, or times that do not increase. No clip "
        "is cut across a gap."
    )
    fix = "record without gaps, or cut the recording there"
    unit = "usual steps"

    @staticmethod
    def examples() -> Examples:
        """A second is missing in the middle."""
        return one_bad(made_touch(times=np.arange(COUNT) / FPS + (np.arange(COUNT) >= 50)))


class RepeatedFrames(Check):
    """Frames stored more often than the camera gave them."""

    code, level, needs = CODES["repeated_frames"], "error", frozenset({"times", "frames"})
    title = "Frames are stored several times"
    why = (
        "Copies of one frame look like a gel that stands still, and everything seems to move at "
        "the rate of the recorder, not of the camera. Told where the gel moves, by neighbours that "
        "do not differ, in an even rhythm."
    )
    fix = FIXES["repeated_frames"]
    unit = "share of the frames"

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        times = seen.recording.times
        if len(times) < 2 or not times[-1] > times[0] or not seen.is_picture:
            return
        # of all frames: files round the times of single ones to milliseconds
        found = repeated(seen.steps, (len(times) - 1) / float(times[-1] - times[0]))
        if found is not None:
            keys = {"every": every(found.value)}
            fix = f"every: {keys['every']:g} in the layout keeps one of each"
            yield self.found(seen.key, found.words, found.value, keys, fix)

    @staticmethod
    def examples() -> Examples:
        """A camera of 18 frames a second, stored as 30."""
        once = made_touch(depth=press(54)).frames.read(range(54))
        rows = np.arange(COUNT) * 54 // COUNT
        return one_bad(made_touch(frames=ArrayFrames(once[rows])))


class Frozen(PixelCheck):
    """The same picture for a second or more."""

    reason = "frozen"
    code, level = CODES[reason], "warning"
    title = "Frozen"
    why = (
        f"Frames do not change at all for more than {FROZEN:g} s: the camera, or the program that "
        "recorded, had stopped."
    )
    fix = "leave the stretch out"
    unit = "s"

    @staticmethod
    def examples() -> Examples:
        """The camera stops in the middle."""
        return one_bad(
            made_touch(edit=lambda frames: frames.__setitem__(slice(31, 75), frames[30]))
        )


class LagOfImages(Check):
    """Images later or earlier than their forces."""

    code, level = CODES["lag"], "warning"
    needs = frozenset({"times", "forces", "frames", "all frames"})
    title = "Images and forces do not fit in time"
    why = (
        f"By cross-correlation of the normal force with the change of the image, by more than "
        f"{LAG:g} s and {LAG_FRAMES:g} frames. Shift the forces (layouts have lag_s)."
    )
    fix = "lag_s: of force in the layout shifts them"
    unit = "s"

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        if (lag := lag_of(seen.recording)) is not None:
            for one in check_lag(seen.recording, lag):
                yield self.found(seen.key, one.words, one.value)

    @staticmethod
    def examples() -> Examples:
        """Forces a third of a second early."""
        depth = np.concatenate([press(45), 0.6 * press(45)])
        good = made_touch(depth=depth)
        assert good.force is not None
        return Examples([good], [made_touch(depth=depth, force=np.roll(good.force, -10, axis=0))])


class ForcesApart(LabelCheck):
    """Forces that begin late or end early."""

    reason = "forces_apart"
    code, level, needs = CODES[reason], "warning", frozenset({"times", "forces"})
    title = "Forces start late or end early"
    why = (
        "More than a second and a tenth of the recording has no force before the first, or after "
        "the last: its sensor was not running, or its times are late."
    )
    fix = FIXES[reason]
    unit = "s"

    @staticmethod
    def examples() -> Examples:
        """The first half has no forces."""
        return with_force(np.where(np.arange(COUNT)[:, None] < 45, np.nan, right_force()))


class ForcesBetween(LabelCheck):
    """Frames between others with a force have none."""

    reason = "forces_between"
    code, level, needs = CODES[reason], "warning", frozenset({"times", "forces"})
    title = "Frames between have no force"
    why = (
        "A clip learns force where all of its frames have one. With a label in every third frame, "
        "hardly any clip does. Forces on times of their own are interpolated."
    )
    fix = FIXES[reason]
    unit = "share of the frames"

    @staticmethod
    def examples() -> Examples:
        """One frame of three has a force."""
        return with_force(np.where(np.arange(COUNT)[:, None] % 3, np.nan, right_force()))


class ViewsElsewhere(LabelCheck):
    """Camera views of another time than the touch."""

    reason = "views_elsewhere"
    code, level, needs = CODES[reason], "warning", frozenset({"times"})
    title = "Camera views of another time"
    why = (
        "No camera view was taken while the sensor touched, by its times: is their clock, or its "
        "unit, another one?"
    )
    fix = FIXES[reason]
    unit = "s"

    @staticmethod
    def examples() -> Examples:
        """Views of an hour later."""
        views = ArrayFrames(np.full((2, 8, 8, 3), 90, np.uint8))
        return Examples(
            [made_touch(image=views, image_times=np.array([0.5, 2.0]))],
            [made_touch(image=views, image_times=np.array([3600.0, 3602.0]))],
        )


class PairedTimes(Check):
    """Times that come in pairs, as of messages that were stored twice."""

    code, level, needs = CODES["paired_times"], "warning", frozenset({"times"})
    title = "Times come in pairs"
    why = (
        "Every other frame follows the one before at once: messages were stored twice, or by two "
        "recorders into one file, and clips show each moment twice."
    )
    fix = "keep one recorder, or leave every other frame out (every: 2 in the layout)"
    unit = "share of the steps"

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        share = repeated_times(seen.recording.times)
        if share >= _PAIRED:
            words = f"{100 * share:.0f} % of the frames come right after the one before"
            yield self.found(seen.key, words, share, {"every": 2})

    @staticmethod
    def examples() -> Examples:
        """Two recorders, a tenth of a millisecond apart."""
        numbers = np.arange(COUNT)
        return one_bad(made_touch(times=numbers // 2 * 2 / FPS + numbers % 2 * 1e-4))
