"""Runs the checks of streams over a running sensor, as `record` and `live` do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from tactileforge.checks.check import Check, Finding, Watch
from tactileforge.checks.listing import built, chosen
from tactileforge.checks.rules_stream import FROZEN
from tactileforge.contracts import Frame, SensorSpec


class StreamChecks:
    """Checks of one running sensor, shown its frames in turn.

    `look` runs in the thread of the sensor; others may read the attributes meanwhile.

    Args:
        name: Name of the sensor, for findings.
        spec: Spec of the sensor.
        ignore: Codes, beginnings of codes, or names of checks to leave out.

    Attributes:
        counts: Number of frames with each trouble; see `Check.troubles`.
        found: Findings by trouble; by the name of the check, if it tells of the stream so far.

    Raises:
        ConfigError: No check has such a code.

    Example:
        >>> import numpy as np
        >>> from tactileforge.contracts import Frame
        >>> from tactileforge.specs import spec
        >>> checks = StreamChecks("left", spec("digit"))
        >>> checks.look(Frame(array=np.zeros((320, 240, 3), np.uint8), time=0.0), arrived=0.0)
        True
        >>> print(checks.found["black"])
        left: TF602 pictures are black: is its light on, is exposure= too low?
    """

    def __init__(self, name: str, spec: SensorSpec, ignore: Iterable[str] = ()) -> None:
        self.name = name
        self.counts: Counter[str] = Counter()
        self.found: dict[str, Finding] = {}
        asked = [check for check in chosen(ignore=ignore) if "stream" in check.needs]
        self._watches: list[tuple[Check, Watch]] = [
            (check, watch) for check in built(asked) if (watch := check.watch(spec)) is not None
        ]

    def look(self, frame: Frame, arrived: float) -> bool:
        """Show a frame to all checks.

        Args:
            frame: The frame.
            arrived: Time of its arrival, on the clock of its time, s.

        Returns:
            Whether it is a picture of its own; False for one of a frozen camera, which the other
            checks do not see.
        """
        for one in self._watches:
            check, watch = one
            try:
                trouble = watch(frame, arrived)
            except Exception as error:  # a fault of a package's check must not end a recording
                self._watches = [other for other in self._watches if other is not one]
                why = f"its check failed, and looks no further ({type(error).__name__}: {error})"
                self.found[check.name] = check.found(self.name, why, fix="")
                continue
            if words := check.troubles.get(trouble):
                self.counts[trouble] += 1
                if trouble not in self.found:
                    self.found[trouble] = check.found(self.name, words, fix="")
            elif trouble:
                self.found[check.name] = check.found(self.name, trouble)
            else:
                self.found.pop(check.name, None)
            if trouble == FROZEN:
                return False
        return True

    def findings(self) -> list[Finding]:
        """What was found so far."""
        return list(self.found.values())
