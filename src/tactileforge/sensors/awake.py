"""Awake clock: it stands still while this process is stopped (Ctrl-Z) or starved.

A driver without an answer for a minute is to blame only if this process waited for it meanwhile.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

#: Seconds between beats, and without a beat until the process counts as stopped. A busy machine
#: delays a thread by tenths of a second.
_BEAT, _GAP = 0.1, 1.0


class Pause(NamedTuple):
    """Pause of this process.

    Attributes:
        start: Monotonic seconds.
        end: Monotonic seconds.
    """

    start: float
    end: float


class AwakeClock:
    """Clock of the running time of this process, kept by a thread with a regular beat.

    It never goes back. After a second without a beat, it stands still.

    Args:
        monotonic: Function for monotonic seconds; None for ``time.monotonic``.
    """

    def __init__(self, monotonic: Callable[[], float] | None = None) -> None:
        self._monotonic = monotonic or (lambda: time.monotonic())
        self._pauses: deque[Pause] = deque(maxlen=16)
        self._total = 0.0
        self._beat = self._monotonic()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the beat, once a process."""
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
        """Note a beat, and the pause before it if there was one."""
        with self._lock:
            now = self._monotonic()
            if now - self._beat > _GAP:
                self._pauses.append(Pause(self._beat + _GAP, now))
                self._total += now - self._beat - _GAP
            self._beat = now

    def now(self) -> float:
        """Seconds of the clock, without pauses."""
        return self.of(self._monotonic())

    def since(self, moment: float) -> float:
        """Seconds since a moment, without pauses; negative for a future one.

        Args:
            moment: Moment, monotonic seconds.
        """
        with self._lock:
            now = self._monotonic()
            pauses = [*self._pauses, Pause(self._beat + _GAP, now)]
        slept = sum(max(0.0, pause.end - max(moment, pause.start)) for pause in pauses)
        return now - moment - slept

    def of(self, now: float) -> float:
        """Seconds of the clock at a moment after the last beat, monotonic seconds."""
        with self._lock:
            return min(now, self._beat + _GAP) - self._total


#: Clock of this process.
AWAKE_CLOCK = AwakeClock()
