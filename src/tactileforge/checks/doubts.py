"""Doubts about labels and times, found without decoding a frame.

`data inspect` counts them on its page; training and packing warn of each kind once (`Doubts`).
"""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Set as AbstractSet
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from tactileforge.checks.codes import CODES
from tactileforge.checks.force_axes import ForceAxes
from tactileforge.checks.force_runs import FRAMES, away, between, stuck
from tactileforge.checks.ignored import is_ignored
from tactileforge.checks.names import plain_name
from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data.labels.align import LARGEST_GAP
from tactileforge.errors import ConfigError
from tactileforge.specs.published import spec

#: Largest plausible force, as a multiple of the sensor's scale. Strong touches are within twice
#: (simulated ones too); pounds, kilograms and grams taken for newtons are 4 times or more.
RANGE = 3.0
#: Smallest pulling force, as a share of the scale of the normal force and of the largest one here.
PULL = 0.05
#: Largest share of frames without a force between others: a few are lost to cleaning.
SPARSE = 0.05
#: Smallest side of a picture in which a contact has a shape, pixels.
TINY = 8
#: Largest force of a whole set as a share of the scale, below which its unit is doubtful.
_FAINT = 0.01
#: Objects whose spelling is compared; the first of a set, so that memory does not grow with it.
_SPELLED = 300

#: Names kept to tell one from several.
_NAMES = 2

#: Reasons repeated by training and packing, with their fixes. The others are choices (no
#: background), or do not affect learning (gaps: no clip is cut across one).
FIXES = {
    "force_out_of_range": "is it grams or mN? unit: of force in a layout (gf, mN, ...) converts",
    "pulling_force": "pressing is positive: does z point out of the gel (sign: [1, 1, -1]), or was "
    "the sensor of force not tared?",
    "axes_exchanged": "in contact, z is the largest and of one sign: are the columns in the order "
    "x, y, z of the gel? (A slide to one side with much friction looks alike.)",
    "untared_force": "was the sensor of force tared? Or does something touch in the background?",
    "stuck_force": "did the sensor of force stop? leave the cells empty from there on",
    "forces_apart": "did its sensor start later, or stop earlier? Or is its clock another?",
    "forces_between": "a clip learns force where all of its frames have one: label those between, "
    "or give forces on times of their own (time:), which are interpolated",
    "tiny_pictures": "give the pictures as they were taken",
    "views_elsewhere": "give the views times on the clock of the frames",
    "zero_force": "leave the cells empty where nothing was measured, or restore the missing part",
    "repeated_frames": "clips show each moment several times; every: in the layout keeps one each",
    "odd_first_frames": "the camera had not settled: name frames without contact after these",
    "background_changed": "is it the background of another unit or day? background: {first: 3} or "
    "{median: true} takes one from the recording",
}


@dataclass(frozen=True)
class Suspicion:
    """A reason to distrust a recording.

    Attributes:
        reason: Name of the reason; the page of ``data inspect`` explains it.
        value: Measured number, in the unit of the reason.
        words: Measured number in words.
    """

    reason: str
    value: float
    words: str


def check_labels(recording: Recording) -> Iterator[Suspicion]:
    """Check labels, times and sizes, save for ignored findings; decodes nothing."""
    return (flag for flag in _suspicions(recording) if not is_ignored(recording, flag.reason))


def _suspicions(recording: Recording) -> Iterator[Suspicion]:
    if recording.no_contact is None:
        yield Suspicion("no_background", 0.0, "no frame without contact")
    yield from _times(recording)
    yield from _force(recording)
    yield from _views(recording)
    height, width = recording.frames.shape
    smallest = TINY
    with suppress(ConfigError):  # the sensor is not installed here
        own = spec(recording.sensor)
        # arrays have a few taxels, and a side of 0 is not stated
        smallest = min([TINY, *(side for side in (own.height, own.width) if side > 0)])
    if min(height, width) < smallest:
        yield Suspicion("tiny_pictures", min(height, width), f"{width} x {height} pixels")


class Doubts:
    """Doubts about the recordings of a set, each kind once."""

    def __init__(self) -> None:
        self.total = 0
        self._worst: dict[str, tuple[float, int, str]] = {}
        self._force_frames = 0
        self._range = np.array([[np.inf] * 3, [-np.inf] * 3])
        self._objects: dict[str, set[str]] = {"object": set(), "action": set()}
        self._named = {"object": 0, "action": 0}
        self._spellings: dict[str, str] = {}
        self._alike: tuple[str, str] | None = None
        self._strongest, self._felt = 0.0, ""
        self._axes = ForceAxes()

    def add(self, recording: Recording) -> None:
        """Check a recording."""
        self.total += 1
        for flag in check_labels(recording):
            self.flag(recording, flag)
        self._classes(recording)
        force = recording.force
        if force is not None and np.isfinite(force).any():
            known = force[np.isfinite(force).any(axis=1)]
            with suppress(ConfigError):  # the sensor is not installed here
                scale = np.array(spec(recording.sensor).force_scale)
                share = float(np.nanmax(np.abs(known) / scale))
                if share > self._strongest:
                    self._strongest, self._felt = share, f"{np.nanmax(np.abs(known)):.2g} N"
            self._axes.add(force)
            self._force_frames += len(known)
            # fmin and fmax pass over NaN: an axis may be without a label
            self._range[0] = np.fmin(self._range[0], np.fmin.reduce(known))
            self._range[1] = np.fmax(self._range[1], np.fmax.reduce(known))

    def flag(self, recording: Recording, found: Suspicion) -> None:
        """Add a suspicion of a recording, if it is one of `FIXES`."""
        if found.reason in FIXES:
            value, count, words = self._worst.get(found.reason, (-np.inf, 0, ""))
            if found.value > value:
                value, words = found.value, f"{recording.key}: {found.words}"
            self._worst[found.reason] = value, count + 1, words

    def _classes(self, recording: Recording) -> None:
        seen: dict[str, set[str]] = {"object": set(), "action": set()}
        if recording.object is not None:
            seen["object"] = {recording.object}
            plain = plain_name(recording.object)
            other = self._spellings.get(plain, recording.object)
            if len(self._spellings) < _SPELLED:
                self._spellings[plain] = other
            if other != recording.object and self._alike is None:
                self._alike = other, recording.object
        if recording.action is not None:
            shown = np.unique(recording.action[recording.action >= 0]).tolist()
            seen["action"] = {ACTIONS[i] for i in shown if i < len(ACTIONS)}
        for label, names in seen.items():
            self._named[label] += bool(names)
            if len(self._objects[label]) < _NAMES:
                self._objects[label] |= names

    def of_each(self) -> list[str]:
        """One line for each reason of `FIXES`, with the worst recording."""
        return [
            f"{CODES[reason]} {reason.replace('_', ' ')} in {count} of {self.total} recordings "
            f"({words}); {FIXES[reason]}"
            for reason, (_, count, words) in self._worst.items()
        ]

    def of_all(
        self, labels: AbstractSet[str] = frozenset(("force", "object", "action"))
    ) -> list[str]:
        """One line for each kind of doubt about the set as a whole.

        Args:
            labels: Labels to check for more than one value, as learning needs.
        """
        out = []
        low, high = self._range
        known = np.isfinite(low)
        constant = (low[known] == high[known]).all()
        if "force" in labels and self._force_frames >= FRAMES and constant:
            values = ", ".join(f"{axis:g}" for axis in low[known])
            what = "are all 0 N" if not low[known].any() else f"are all the same ({values} N)"
            out.append(
                f"{CODES['constant_force']} the forces of all {self._force_frames} frames {what}: "
                "was the sensor of force connected, and are its columns the right ones?"
            )
        if "force" in labels and self._force_frames >= FRAMES and 0 < self._strongest < _FAINT:
            out.append(
                f"{CODES['faint_force']} the largest force is {self._felt}, less than a hundredth "
                "of the scale of its sensor: is it kN? unit: kN of force in a layout converts"
            )
        axis = self._axes.pressing()
        if "force" in labels and axis and "axes_exchanged" not in self._worst:
            fix = FIXES["axes_exchanged"]
            code = CODES["axes_exchanged"]
            out.append(
                f"{code} forces of all recordings are largest along {axis}, with one sign; {fix}"
            )
        if "object" in labels and self._alike is not None:
            one, other = self._alike
            out.append(
                f"{CODES['spelled_alike']} objects {one!r} and {other!r} differ only in their "
                "spelling, and count as two: spell them alike, if they are one"
            )
        for label, names in self._objects.items():
            if label in labels and len(names) == 1 and self._named[label] > 1:
                out.append(
                    f"{CODES['one_class']} only one {label} ({next(iter(names))}) in "
                    f"{self._named[label]} recordings: nothing that tells one {label} from another "
                    "can be learnt"
                )
        return out


def _times(recording: Recording) -> Iterator[Suspicion]:
    times, count = recording.times, len(recording.frames)
    if len(times) != count:
        yield Suspicion("gaps_in_time", float("inf"), f"{len(times)} times for {count} frames")
        return
    steps = np.diff(times)
    usual = float(np.median(steps)) if len(steps) else 1.0
    if len(steps) and (not np.isfinite(times).all() or steps.min() <= 0):
        yield Suspicion("gaps_in_time", float("inf"), "times do not increase")
    elif len(steps) and steps.max() > LARGEST_GAP * usual:
        gaps = int((steps > LARGEST_GAP * usual).sum())
        words = f"{gaps} gap{'s' * (gaps > 1)}, up to {steps.max():.3g} s (usual {usual:.3g} s)"
        yield Suspicion("gaps_in_time", float(steps.max() / usual), words)


def _force(recording: Recording) -> Iterator[Suspicion]:
    force = recording.force
    if force is None or not np.isfinite(force).any():
        return
    if words := away(force, recording.times):
        yield Suspicion("forces_apart", float(words.split()[0]), words)
    share, words = between(force)
    if share > SPARSE:
        yield Suspicion("forces_between", share, words)
    axes = ForceAxes()
    axes.add(force)
    # an axis without any value was not measured; as NaN, it would be the largest of all
    force = np.where(np.isfinite(force).any(axis=0), force, 0.0)
    scale = np.ones(3)
    with suppress(ConfigError):  # the sensor is not installed here
        scale = np.array(spec(recording.sensor).force_scale)
        largest = np.nanmax(np.abs(force), axis=0)
        axis = int((largest / scale).argmax())
        times = float(largest[axis] / scale[axis])
        if times > RANGE:
            words = f"{largest[axis]:.3g} N along {'xyz'[axis]}, {times:.2g} times the scale"
            yield Suspicion("force_out_of_range", times, words)
    if pressing := axes.pressing():
        words = f"largest along {pressing}, with one sign, {min(axes.ratio, 1e3):.2g} times z"
        yield Suspicion("axes_exchanged", axes.ratio, words)
    if words := stuck(force, recording.times):
        yield Suspicion("stuck_force", float(words.split()[0]), words)
    normal = force[:, 2]
    pull = -float(np.nanmin(normal))
    if pull > PULL * max(scale[2], float(np.nanmax(np.abs(normal)))):
        yield Suspicion("pulling_force", pull, f"down to {-pull:.3g} N along z")


def _views(recording: Recording) -> Iterator[Suspicion]:
    views, times = recording.image_times, recording.times
    if views is None or not len(views) or len(times) < 2:
        return
    away = max(float(views[0] - times[-1]), float(times[0] - views[-1]))
    if away > times[-1] - times[0]:
        yield Suspicion("views_elsewhere", away, f"{away:.3g} s from the nearest frame")
