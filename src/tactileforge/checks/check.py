"""A check: a rule about touch data with a code, a reason, a fix and examples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeAlias

from tactileforge.checks.seen import Seen
from tactileforge.contracts import Frame, Recording, SensorSpec

Level: TypeAlias = Literal["error", "warning", "note"]
#: A check of one running sensor: of a frame and the time of its arrival, s, its trouble; "" for
#: none. That is a name in `Check.troubles`, or words about the stream so far.
Watch: TypeAlias = Callable[[Frame, float], str]

#: What a check may need, from cheap to dear. ``labels``, ``times`` and ``forces`` decode nothing;
#: ``captions`` are asked about where clips are mirrored. ``frames`` decodes a few frames of a
#: recording, ``all frames`` up to a thousand; ``several`` compares decoded recordings, ``set`` all
#: of them; a ``stream`` comes frame by frame.
NEEDS = (
    *("labels", "times", "forces", "captions", "frames", "all frames", "several", "set"),
    "stream",
)
LEVELS: tuple[Level, ...] = ("error", "warning", "note")


@dataclass(frozen=True)
class Finding:
    """Finding of a check.

    Attributes:
        code: Code of the check.
        name: Name of the check.
        level: ``error``, ``warning`` or ``note``.
        where: Key of the recording; "" for the set as a whole.
        words: Measured number in words, or the whole line for a set.
        value: Measured number, in the unit of the check.
        fix: What puts it right.
        keys: Keys of a layout that put it right, with their values; empty where there are none.
    """

    code: str
    name: str
    level: Level
    where: str
    words: str
    value: float = 0.0
    fix: str = ""
    keys: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        """One line, ``recording: TF203 words; fix``."""
        place = self.where or "the whole set"
        return f"{place}: {self.code} {self.words}" + (f"; {self.fix}" if self.fix else "")


@dataclass(frozen=True)
class Examples:
    """Input of a check that is right, and input that is not; both are its test.

    Attributes:
        good: Recordings of a set, or frames of a stream, without a finding.
        bad: The same with at least one finding.
        sensor: Spec of the sensor of a stream; None for recordings.
    """

    good: Sequence[Recording] | Sequence[Frame]
    bad: Sequence[Recording] | Sequence[Frame]
    sensor: SensorSpec | None = None


class Check:
    """A rule about touch data; plugins of the kind ``checks`` are subclasses.

    A check is built anew for each set. It is shown every recording in turn, may keep a little of
    each, and is asked at the end about the set. A check of a stream is built for each sensor.

    Attributes:
        code: ``TF`` and three digits, or two to four capitals of a package's own and three digits.
        title: Problem, as a heading.
        level: ``error`` where what is learned would be wrong, ``warning`` where it is likely to be,
            ``note`` for a choice that costs something.
        needs: What it looks at, some of `NEEDS`.
        why: Effect on training, and the measure; one or two sentences.
        fix: What puts it right, with the key where there is one.
        unit: Unit of the measured number; "" for none.
        worst: 1 if larger numbers are worse, -1 if smaller ones are.
        troubles: Faults of single frames of a stream, by name, in words with the
            fix. Frames with each are counted, and the first one is named.
    """

    code: ClassVar[str] = ""
    title: ClassVar[str] = ""
    level: ClassVar[Level] = "warning"
    needs: ClassVar[frozenset[str]] = frozenset()
    why: ClassVar[str] = ""
    fix: ClassVar[str] = ""
    unit: ClassVar[str] = ""
    worst: ClassVar[int] = 1
    troubles: ClassVar[Mapping[str, str]] = {}
    #: Name of the entry point, set by the catalogue.
    name: str = ""

    def look(self, seen: Seen) -> Iterable[Finding]:
        """Look at a recording.

        Args:
            seen: The recording, with frames that are decoded when they are asked for.

        Raises:
            DataError: A frame cannot be decoded.
        """
        return ()

    def end(self) -> Iterable[Finding]:
        """Tell of the set, after all of its recordings were shown."""
        return ()

    def watch(self, spec: SensorSpec) -> Watch | None:
        """Begin to watch a running sensor; None where there is nothing to watch.

        What it returns is called in the thread of the sensor, for every frame, in order.
        """
        return None

    @staticmethod
    def examples() -> Examples:
        """Good and bad input."""
        raise NotImplementedError

    def found(
        self,
        where: str,
        words: str,
        value: float = 0.0,
        keys: Mapping[str, Any] | None = None,
        fix: str | None = None,
    ) -> Finding:
        """Make a finding of this check."""
        fix = self.fix if fix is None else fix
        return Finding(self.code, self.name, self.level, where, words, value, fix, keys or {})


def findings_of(check: Check, shown: Sequence[Any], sensor: SensorSpec | None) -> list[str]:
    """Run a check on one of its examples; give its findings in words.

    Args:
        check: A check, built anew.
        shown: Recordings of a set, or frames of a stream.
        sensor: Spec of the sensor of a stream; None for recordings.
    """
    return list(_findings(check, shown, sensor))


def _findings(check: Check, shown: Sequence[Any], sensor: SensorSpec | None) -> Iterator[str]:
    if sensor is not None:
        watch = check.watch(sensor)
        for number, frame in enumerate(shown):
            # frames of an example carry no time of arrival: they are taken to come at their rate
            if watch is not None and (words := watch(frame, number / sensor.fps)):
                yield words
        return
    for number, recording in enumerate(shown):
        # every other one is held out, so that splits can be compared
        seen = Seen(recording, "val" if number % 2 else "train")
        yield from map(str, check.look(seen))
    yield from map(str, check.end())
