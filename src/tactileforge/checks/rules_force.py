"""Checks of forces: TF201 to TF299."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from tactileforge.checks.check import Check, Examples, Finding
from tactileforge.checks.codes import CODES
from tactileforge.checks.doubts import FIXES, RANGE
from tactileforge.checks.force_axes import ForceAxes
from tactileforge.checks.force_runs import FRAMES, cut_off
from tactileforge.checks.made import COUNT, NEWTON, made_touch, press
from tactileforge.checks.rules import LabelCheck, PixelCheck, right_force, with_force
from tactileforge.checks.seen import Seen
from tactileforge.checks.untared import drifted
from tactileforge.checks.zero_force import zero_where_pressed
from tactileforge.data.labels.plausible import impossible

_FORCES = frozenset({"forces"})
#: Largest force of a whole set as a share of the scale, below which its unit is doubtful; and the
#: same where the pictures show a clear imprint, with its smallest size, grey levels.
_FAINT, _FAINT_IMPRINT, _IMPRINT = 0.01, 0.04, 25.0


class ForceOutOfRange(LabelCheck):
    """A force beyond the scale of the sensor."""

    reason = "force_out_of_range"
    code, level, needs = CODES[reason], "error", _FORCES
    title = "Force out of range"
    why = f"More than {RANGE:g} times what the sensor's force scale is: wrong unit, or sensor?"
    fix = FIXES[reason]
    unit = "times the scale"

    @staticmethod
    def examples() -> Examples:
        """Grams in place of newtons."""
        return with_force(right_force() * 101.97)


class PullingForce(LabelCheck):
    """A normal force below 0."""

    reason = "pulling_force"
    code, level, needs = CODES[reason], "error", _FORCES
    title = "Pulling"
    why = (
        "The normal force is negative, but an object cannot pull the gel: pressing has to be "
        "positive, and the sensor of force tared."
    )
    fix = FIXES[reason]
    unit = "N"

    @staticmethod
    def examples() -> Examples:
        """The axis z points out of the gel."""
        return with_force(right_force() * np.array([1, 1, -1]))


class ZeroForce(Check):
    """A force of exactly 0 where the gel is pressed."""

    code, level = CODES["zero_force"], "error"
    needs = frozenset({"forces", "frames"})
    title = "The force is zero where the gel is pressed"
    why = (
        "Frames with an imprint as deep as that of the largest force have a force of exactly 0: a "
        "part of the file is missing, the sensor of force was off, or empty cells were read as 0. "
        "It is learned as a touch without force."
    )
    fix = "leave the cells empty where nothing was measured, or restore the missing part"
    unit = "share of the frames"

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        if seen.recording.force is not None and (seen.recording.force == 0).all(axis=1).any():
            found = zero_where_pressed(seen.recording, seen.sample)
            if found is not None:
                yield self.found(seen.key, found.words, found.value)

    @staticmethod
    def examples() -> Examples:
        """A chunk of 40 rows is missing."""
        return with_force(np.where((np.abs(np.arange(COUNT) - 40) < 20)[:, None], 0, right_force()))


class AxesExchanged(LabelCheck):
    """A shear like pressing, in a recording or in all of them together."""

    reason = "axes_exchanged"
    code, level, needs = CODES[reason], "error", _FORCES
    title = "Axes of the force look exchanged"
    why = (
        "In contact, a shear has one sign and is larger than the normal force, which is what "
        "pressing does: the columns may not be in the order x, y, z."
    )
    fix = FIXES[reason]
    unit = "times the normal force"

    def __init__(self) -> None:
        self._axes, self._told = ForceAxes(), False

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        if seen.recording.force is not None:
            self._axes.add(seen.recording.force)
        for one in super().look(seen):
            self._told = True
            yield one

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        axis = self._axes.pressing()
        if axis and not self._told:
            words = f"forces of all recordings are largest along {axis}, with one sign"
            yield self.found("", words)

    @staticmethod
    def examples() -> Examples:
        """The columns are z, x, y."""
        return with_force(right_force()[:, [2, 0, 1]])


class UntaredForce(PixelCheck):
    """A force where nothing touches."""

    reason = "untared_force"
    code, level = CODES[reason], "error"
    needs = frozenset({"forces", "frames"})
    title = "The force is not tared"
    why = (
        "Where the picture is that of the background, the force is more than a twentieth of the "
        "scale: the sensor of force has an offset, or something touches in the background."
    )
    fix = FIXES[reason]
    unit = "times the scale"

    @staticmethod
    def examples() -> Examples:
        """The weight of a tool in all rows."""
        return with_force(right_force() + np.array([0, 0, 2.5]))


class DriftingForce(Check):
    """Another force at rest at the end than at the beginning."""

    code, level = CODES["drifting_force"], "warning"
    needs = frozenset({"forces", "frames"})
    title = "The zero of the force drifts"
    why = (
        "Where pictures are that of the background, early and late in the recording, forces differ "
        "by more than a twentieth of the scale: the sensor of force warms up, or was not tared "
        "again. All forces between are wrong by a part of that."
    )
    fix = "tare before each recording, and subtract the line through the forces at rest"
    unit = "times the scale"

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        if seen.recording.force is not None and seen.recording.no_contact is not None:
            found = drifted(seen.recording, seen.sample)
            if found is not None:
                yield self.found(seen.key, found.words, found.value)

    @staticmethod
    def examples() -> Examples:
        """A load cell warming up."""
        drift = np.linspace(0, 1.5, COUNT)[:, None] * np.array([0, 0, 1])
        return with_force(right_force() + drift)


class StuckForce(LabelCheck):
    """One and the same force for seconds."""

    reason = "stuck_force"
    code, level, needs = CODES[reason], "warning", frozenset({"forces", "times"})
    title = "The force is stuck"
    why = (
        "The same force other than 0 stays for more than a second and a quarter of the recording, "
        "or for two seconds between samples with noise, which strain gauges have: the sensor of "
        "force may have stopped."
    )
    fix = FIXES[reason]
    unit = "s"

    @staticmethod
    def examples() -> Examples:
        """The sensor of force stops in the middle."""
        rows = np.minimum(np.arange(COUNT), 45)
        return with_force(right_force()[rows])


class ConstantForce(Check):
    """The same force in all frames of a set."""

    code, level, needs = CODES["constant_force"], "error", _FORCES
    title = "The forces are all the same"
    why = (
        "Nothing can be learned from a label that never changes: 0 N of a sensor without its plug."
    )
    fix = "was the sensor of force connected, and are its columns the right ones?"

    def __init__(self) -> None:
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self._frames = 0

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        force = seen.recording.force
        if force is not None:
            known = force[np.isfinite(force).any(axis=1)]
            self._frames += len(known)
            if len(known):
                # fmin and fmax pass over NaN: an axis may be without a label
                self._low = np.fmin(self._low, np.fmin.reduce(known))
                self._high = np.fmax(self._high, np.fmax.reduce(known))
        return ()

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        known = np.isfinite(self._low)
        if self._frames >= FRAMES and (self._low[known] == self._high[known]).all():
            values = ", ".join(f"{axis:g}" for axis in self._low[known])
            what = f"are all the same ({values} N)" if self._low[known].any() else "are all 0 N"
            yield self.found("", f"the forces of all {self._frames} frames {what}")

    @staticmethod
    def examples() -> Examples:
        """All forces are 0."""
        return with_force(np.zeros((COUNT, 3)))


class FaintForce(Check):
    """Forces of a set far too small for its pictures."""

    code, level, needs = CODES["faint_force"], "warning", frozenset({"forces", "frames", "several"})
    title = "Forces are faint"
    why = (
        "The largest force of the set is less than a hundredth of the scale of its sensor, or less "
        "than a twenty-fifth where pictures show a deep imprint: kN or kgf in place of N."
    )
    fix = "is it kgf, or kN? unit: kgf (kN) of force in a layout converts"
    unit = "share of the scale"
    worst = -1

    def __init__(self) -> None:
        self._share, self._felt, self._imprint, self._frames = 0.0, "", 0.0, 0

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        force = seen.recording.force
        if force is None or not np.isfinite(force).any():
            return ()
        self._frames += int(np.isfinite(force).any(axis=1).sum())
        share = float(np.nanmax(np.abs(force) / seen.scale))
        if share > self._share:
            self._share, self._felt = share, f"{np.nanmax(np.abs(force)):.2g} N"
        if self._share < _FAINT_IMPRINT and seen.recording.no_contact is not None:
            self._imprint = max(self._imprint, seen.sample.contact)
        return ()

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        is_deep = self._share < _FAINT_IMPRINT and self._imprint > _IMPRINT
        if self._frames >= FRAMES and self._share > 0 and (self._share < _FAINT or is_deep):
            words = f"the largest force is {self._felt}, {100 * self._share:.2g} % of the scale"
            if is_deep:
                words += f", though pictures change by {self._imprint:.0f} grey levels"
            yield self.found("", words, self._share)

    @staticmethod
    def examples() -> Examples:
        """Kilograms in place of newtons, and kN."""
        weak = made_touch(force=np.asarray(right_force() / 2 / 9.80665, np.float32))
        faint = made_touch(depth=0.02 * press(), force=right_force() * np.float32(0.02))
        assert NEWTON == 6
        return Examples([made_touch(), faint], [weak])


class ForceCutOff(Check):
    """Forces clipped at one value in several recordings."""

    code, level, needs = CODES["force_cut_off"], "warning", frozenset({"forces", "several"})
    title = "Forces are cut off"
    why = (
        "In two recordings or more the largest force along an axis is the same number, held for "
        "six rows or more, while smaller ones have noise: the sensor of force, its amplifier or "
        "its driver ends there, and what presses harder is learned as this."
    )
    fix = "leave the cells empty where the sensor of force was at its end"
    unit = "N"

    def __init__(self) -> None:
        self._tops: Counter[tuple[int, float]] = Counter()

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        if seen.recording.force is not None:
            tops = ((axis, cut_off(seen.recording.force, axis)) for axis in range(3))
            self._tops.update((axis, top) for axis, top in tops if top is not None)
        return ()

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        for (axis, top), count in sorted(self._tops.items()):
            if count > 1:
                words = f"forces along {'xyz'[axis]} end at {top:.4g} N in {count} recordings"
                yield self.found("", words, abs(top))

    @staticmethod
    def examples() -> Examples:
        """A load cell of half the range."""
        good, bad = [made_touch(0), made_touch(1)], []
        for seed, one in enumerate(good):
            force = np.minimum(np.asarray(one.force), np.float32(NEWTON / 2))
            bad.append(made_touch(seed, force=force))
        return Examples(good, bad)


class ImpossibleLabels(Check):
    """A force that would tear the gel, or a number beyond float32."""

    code, level, needs = CODES["impossible_labels"], "error", frozenset({"forces", "labels"})
    title = "Impossible labels"
    why = "A force of a hundred times the scale would tear the gel; the recording is not read."
    fix = "say its unit (unit: of force in a layout), or correct it"

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        if words := impossible(seen.recording):
            yield self.found(seen.key, words.removeprefix(f"{seen.key}, "), fix="")

    @staticmethod
    def examples() -> Examples:
        """A slip of the exponent."""
        return with_force(right_force() * 1e6)
