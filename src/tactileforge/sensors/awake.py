"""A clock that stands still while this process does: stopped (Ctrl-Z), or starved.

A driver that has not answered for a minute is to blame only if anybody waited for it meanwhile.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

#: Seconds between two beats, and after which a beat that is missing means that nothing ran.
_BEAT, _GAP = 0.1, 1.0


class Pause(NamedTuple):
    """A time in which this process did not run.

    Attributes:
        start: Monotonic seconds.
        end: Monotonic seconds.
    """

    start: float
    end: float


class AwakeClock:
    """Counts the seconds in which this process ran, by a thread that beats.

    It never goes back. Where the beat is missing for more than a second, it stands still.

    Args:
        monotonic: Seconds that never go back; None for ``time.monotonic``.
    """

    def __init__(self, monotonic: Callable[[], float] | None = None) -> None:
        self._monotonic = monotonic or (lambda: time.monotonic())
        self._pauses: deque[Pause] = deque(maxlen=16)
        self._total = 0.0
        self._beat = self._monotonic()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Starts the beat, once a process."""
        with self._lock:
            if self._thread is not None and self._thread.is_alive():  # a fork has no threads
                return
            self._beat = self._monotonic()
            self._thread = threading.Thread(target=self._run, name="awake", daemon=True)
            self._thread.start()

    def _run(self) -> None:
        never = threading.Event()
        while not never.wait(_BEAT):
            self.beat()

    def beat(self) -> None:
        """Notes that this process runs, and the pause before, if it did not."""
        with self._lock:
            now = self._monotonic()
            if now - self._beat > _GAP:
                self._pauses.append(Pause(self._beat + _GAP, now))
                self._total += now - self._beat - _GAP
            self._beat = now

    def now(self) -> float:
        """Seconds, without those of pauses."""
        return self.of(self._monotonic())

    def since(self, moment: float) -> float:
        """Seconds since a moment, without those of pauses; negative for one to come.

        Args:
            moment: Monotonic seconds.
        """
        with self._lock:
            now = self._monotonic()
            pauses = [*self._pauses, Pause(self._beat + _GAP, now)]
        slept = sum(max(0.0, pause.end - max(moment, pause.start)) for pause in pauses)
        return now - moment - slept

    def of(self, now: float) -> float:
        """This clock at a moment since the last beat, monotonic seconds."""
        with self._lock:
            return min(now, self._beat + _GAP) - self._total


#: That of this process.
CLOCK = AwakeClock()
