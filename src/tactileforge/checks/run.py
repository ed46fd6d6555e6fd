"""Runs checks over recordings, wherever data enters."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from tactileforge.checks.check import Finding
from tactileforge.checks.ignored import is_ignored
from tactileforge.checks.listing import built, catalogue, chosen
from tactileforge.checks.sample import FrameSample
from tactileforge.checks.seen import Seen
from tactileforge.contracts import Recording
from tactileforge.data.frames.cut import spread_rows

#: Needs that decode frames, from cheap to dear.
DECODING = frozenset({"frames", "all frames"})
#: Needs that a run over recordings cannot meet, or is not asked to.
_ELSEWHERE = frozenset({"stream", "captions"})
#: Recordings whose frames are looked at where data enters a run; of all others, labels alone.
CHECKED_AT_ENTRY = 8


class CheckRun:
    """Checks of one set, shown its recordings in turn.

    Args:
        select: Codes, beginnings of codes, or names of the checks to run; none for all.
        ignore: The same of checks to leave out.
        without: Needs that are not met; see `check.NEEDS`.

    Attributes:
        unreadable: A line for each recording with a frame that cannot be decoded.

    Raises:
        ConfigError: No check has such a code.
    """

    def __init__(
        self,
        select: Iterable[str] = (),
        ignore: Iterable[str] = (),
        without: Iterable[str] = (),
    ) -> None:
        self._checks = built(chosen(select, ignore, {*_ELSEWHERE, *without}))
        self.unreadable: list[str] = []
        self._ignoring: dict[str, Recording] = {}

    def look(
        self,
        recording: Recording,
        split: str = "train",
        has_layout: bool = True,
        decode: bool = True,
        sample: FrameSample | None = None,
    ) -> list[Finding]:
        """Show a recording to all checks.

        Args:
            recording: The recording.
            split: Its split.
            has_layout: Whether a layout describes it.
            decode: Whether frames may be decoded; checks that need some are then left out.
            sample: Frames that were decoded already.

        Returns:
            What was found in the recording; see `end` for the set.
        """
        seen = Seen(recording, split, has_layout, sample)
        found: list[Finding] = []
        if "ignore" in recording.labels:
            self._ignoring[recording.key] = recording
        for check in self._checks:
            if not decode and check.needs & DECODING:
                continue
            try:
                found += filter(self._is_told, check.look(seen))
            except Exception as error:
                # said once; the other checks of frames would fail alike. A fault of a reader is
                # told by the door that reads the data itself
                self.unreadable.append(str(error))
                decode = False
        return found

    def end(self) -> list[Finding]:
        """What was found in the set as a whole, after all recordings."""
        return [one for check in self._checks for one in check.end() if self._is_told(one)]

    def _is_told(self, one: Finding) -> bool:
        """Whether its recording does not leave the check out."""
        recording = self._ignoring.get(one.where)
        return recording is None or not is_ignored(recording, one.name, one.code)


def check_recordings(
    recordings: Sequence[Recording],
    run: CheckRun | None = None,
    looked: int | None = None,
    has_layout: bool = True,
) -> list[Finding]:
    """Check recordings, and then the set as a whole.

    Args:
        recordings: The recordings.
        run: Checks to run; None for all but those of streams.
        looked: Number of recordings whose frames are decoded, spread over all; None for all.
        has_layout: Whether a layout describes them.
    """
    run = run or CheckRun()
    places = set(spread_rows(len(recordings), len(recordings) if looked is None else looked))
    found = [
        one
        for place, recording in enumerate(recordings)
        for one in run.look(recording, "train", has_layout, place in places)
    ]
    return [*found, *run.end()]


def lines_of(findings: Iterable[Finding], total: int) -> list[str]:
    """One line for each check with findings, with the worst recording.

    Args:
        findings: What was found.
        total: Number of recordings that were looked at.
    """
    by_check: dict[str, list[Finding]] = {}
    for one in findings:
        by_check.setdefault(one.code, []).append(one)
    lines = []
    for code, ones in sorted(by_check.items()):
        of_set = [one for one in ones if not one.where]
        lines += [f"{code} {one.words}" + (f"; {one.fix}" if one.fix else "") for one in of_set]
        if of_each := [one for one in ones if one.where]:
            worst = max(of_each, key=lambda one: _sign(one) * one.value)
            name = worst.name.replace("_", " ")
            line = f"{code} {name} in {len(of_each)} of {total} recordings ({worst.where}: "
            lines.append(f"{line}{worst.words})" + (f"; {worst.fix}" if worst.fix else ""))
    return lines


def _sign(one: Finding) -> int:
    known = catalogue().get(one.name)
    return 1 if known is None else known.worst


def severe(findings: Iterable[Finding]) -> list[Finding]:
    """Findings of the level ``error``."""
    return [one for one in findings if one.level == "error"]
