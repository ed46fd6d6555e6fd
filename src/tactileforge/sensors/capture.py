"""Capture: reads one sensor in a thread, reconnects it, and counts its frames."""

from __future__ import annotations

import math
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Protocol

from tactileforge.contracts import Frame, Sensor
from tactileforge.errors import ConfigError, SensorError, TactileForgeError
from tactileforge.sensors.awake import AWAKE_CLOCK
from tactileforge.sensors.frame_contract import BAD_VALUES, bad_values, check_frame

#: Largest lead and lag of the time of a frame on arrival, s. Tens of seconds are another clock.
_AHEAD, _BEHIND = 1.0, 10.0
#: Longest wait of one read, s, so that stopping is quick; and pause between attempts to open, s.
_WAIT, _RETRY = 0.25, 0.5
#: Frames for the measurement of the rate.
_RATE_OVER = 60


@dataclass
class Counts:
    """Counters of the frames of a sensor.

    Attributes:
        frames: Frames handed on.
        backwards: Dropped frames with a time not after the previous one.
        untimed: Dropped frames without a finite time.
        frozen: Dropped frames of a picture repeated for too long.
        bad_values: Dropped samples with bad values, by `frame_contract.BAD_VALUES`.
        stalled: Calls of the driver longer than the allowed silence.
        reopened: Losses of the sensor with a return.
    """

    frames: int = 0
    backwards: int = 0
    untimed: int = 0
    frozen: int = 0
    bad_values: Counter[str] = field(default_factory=Counter)
    stalled: int = 0
    reopened: int = 0


class FrameWatch(Protocol):
    """A watcher of every frame of a sensor; `tactileforge.checks.StreamChecks` is one."""

    def look(self, frame: Frame, arrived: float) -> bool:
        """Look at a frame.

        Args:
            frame: The frame.
            arrived: Time of its arrival, on the clock of its time, s.

        Returns:
            Whether it is handed on; a frozen picture is not.
        """
        ...


class Capture:
    """Reader of an open sensor, in a thread until stopped.

    Args:
        name: Name of the sensor, for messages.
        sensor: Open sensor; its owner closes it.
        sink: Function called with each good frame, in that thread; must not block for long.
        reconnect: Seconds of attempts to open a lost sensor again.
        silence: Seconds without a frame until the sensor counts as lost.
        checks: What looks at every frame, in that thread; None for nothing.

    Attributes:
        counts: Counters of frames.
        error: Error that ended the capture; None for none.
        ended: Whether the source has reached its end.
        is_lost: Whether the sensor is being opened again.
        latest: Time of the last good frame, monotonic seconds.
        cause: Reason for the lack of a good frame; "" after a good one.
    """

    def __init__(
        self,
        name: str,
        sensor: Sensor,
        sink: Callable[[Frame], None],
        reconnect: float = 10.0,
        silence: float = 3.0,
        checks: FrameWatch | None = None,
    ) -> None:
        self.name, self.sensor, self.sink, self.checks = name, sensor, sink, checks
        self.reconnect, self.silence = reconnect, silence
        self.counts = Counts()
        self.error: TactileForgeError | None = None
        self.ended = False
        self.is_lost = False
        self.latest = -math.inf
        self.cause = ""
        self._good = self._opened = AWAKE_CLOCK.now()  # last good frame, and last open()
        self._lost: float | None = None  # time of the loss; None while frames come
        self._call: tuple[str, float] | None = None  # call of the driver that has not returned
        self._recent: deque[float] = deque(maxlen=_RATE_OVER)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"capture-{name}", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        AWAKE_CLOCK.start()
        self._good = self._opened = AWAKE_CLOCK.now()
        self._thread.start()

    def stop(self) -> None:
        """End the thread; a second call does nothing."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(5.0)

    @property
    def is_done(self) -> bool:
        """Whether no further frame will arrive."""
        return self.ended or self.error is not None

    @property
    def has_begun(self) -> bool:
        """Whether a frame has arrived."""
        return self.latest > -math.inf

    @property
    def fps(self) -> float:
        """Frames per second over the latest frames; sinks while none comes, and is 0 when lost."""
        times = list(self._recent)
        span = times[-1] - times[0] if len(times) > 1 else 0.0
        if span <= 0 or self.is_lost:
            return 0.0
        quiet = AWAKE_CLOCK.now() - self._good
        is_late = not self.is_done and quiet > 3 * span / (len(times) - 1)
        return (len(times) - 1) / (span + quiet * is_late)

    def drops(self) -> dict[str, int]:
        """Dropped frames by reason, with the counts of its driver (``sensor.drops``)."""
        counts = self.counts
        own = {key: getattr(counts, key) for key in ("backwards", "untimed", "frozen")}
        both = counts.bad_values + Counter(getattr(self.sensor, "drops", {}))
        return own | dict.fromkeys(getattr(self.sensor, "drops", {}), 0) | both

    def watch(self) -> None:
        """Check the reading thread for hanging, or an unexpected end.

        Called by another thread now and then.
        """
        call = self._call  # read once: the thread may set it to None meanwhile
        if self.is_done or self._stop.is_set():
            return
        if not self._thread.is_alive():
            self.error = SensorError(f"{self.name}: the thread that reads it has ended")
        elif call is not None and (took := AWAKE_CLOCK.now() - call[1]) > self.silence:
            self.counts.stalled += not self.is_lost
            self.is_lost = True
            if took > self.silence + self.reconnect:
                self.error = SensorError(
                    f"{self.name}: {call[0]}() of its driver has not returned for {took:.1f} s; it "
                    "is left behind: plug the device out and in"
                )

    @contextmanager
    def _calls(self, what: str) -> Iterator[None]:
        self._call = (what, AWAKE_CLOCK.now())
        try:
            yield
        finally:
            self._call = None

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._read()
                if self.is_done:
                    return
        except TactileForgeError as error:
            self.error = SensorError(f"{self.name}: {error}")
        except BaseException as error:  # a driver may raise anything, SystemExit included
            what = f"{self.name}: its driver fails with {type(error).__name__}: {error}"
            self.error = SensorError(what)
            self.error.__cause__ = error

    def _read(self) -> None:
        try:
            with self._calls("read"):
                frame = self.sensor.read(_WAIT)
        except TimeoutError as error:
            self._miss(str(error) or "no frame comes")
        except EOFError:
            self.ended = True
        except (SensorError, OSError) as error:
            self._reopen(str(error))
        else:
            self._take(frame)

    def _take(self, frame: Frame) -> None:
        is_finite = math.isfinite(frame.time)
        if not is_finite or frame.time <= self.latest:
            self.counts.untimed += not is_finite
            self.counts.backwards += is_finite
            self._miss("its times do not go on")
            return
        check_frame(frame, self.sensor.spec)
        if reason := bad_values(frame, self.sensor.spec):
            self.counts.bad_values[reason] += 1
            self._miss(BAD_VALUES[reason])
        else:
            self._accept(frame)

    def _miss(self, cause: str) -> None:
        """Note a missing frame: after a while, reopens the sensor, and then gives up."""
        now, self.cause = AWAKE_CLOCK.now(), cause
        if now - self._good > self.silence + self.reconnect:
            raise SensorError(f"{cause} (for {now - self._good:.1f} s)")
        if now - max(self._good, self._opened) > self.silence:
            self._reopen(cause)

    def _reopen(self, cause: str) -> None:
        self.is_lost, self.cause = True, cause
        with self._calls("close"), suppress(Exception):  # a lost device may fail to close
            self.sensor.close()
        if self._lost is None:
            self._lost = AWAKE_CLOCK.now()
        # packet sensors have a reopen() that keeps their zero; others are opened as at first
        reopen = getattr(self.sensor, "reopen", self.sensor.open)
        while not self._stop.wait(_RETRY):
            if AWAKE_CLOCK.now() > self._lost + self.reconnect:
                raise SensorError(f"{cause} (it has not come back within {self.reconnect:g} s)")
            try:
                with self._calls("open"):
                    reopen()
            except ConfigError:
                raise
            except Exception:  # any error of a driver may mean a device that is not back yet
                continue
            self.counts.reopened += 1
            self._opened = AWAKE_CLOCK.now()
            return

    def _accept(self, frame: Frame) -> None:
        # by the awake clock: after Ctrl-Z and fg, frames are old through no fault of the driver
        behind = AWAKE_CLOCK.since(frame.time)
        if not -_AHEAD < behind < _BEHIND:
            raise SensorError(
                f"a frame is {abs(behind):.1f} s {'behind' if behind > 0 else 'ahead of'} the "
                "clock: its times must be those of time.monotonic(), and a replay or simulation "
                "needs realtime=true"
            )
        self.latest, self.cause = frame.time, ""
        self._good = AWAKE_CLOCK.now()
        self.is_lost, self._lost = False, None
        self._recent.append(frame.time)
        if self.checks is not None and not self.checks.look(frame, frame.time + behind):
            self.counts.frozen += 1
            return
        self.counts.frames += 1
        self.sink(frame)


def check_captures(captures: Sequence[Capture], at_end: bool = False) -> None:
    """Check running captures.

    Args:
        captures: Captures of all sensors.
        at_end: Whether the recording is over; then a lost sensor will not come back.

    Raises:
        SensorError: A capture has ended with an error, hangs for too long, or is lost at the end.
    """
    for capture in captures:
        capture.watch()
        if capture.error is not None:
            raise capture.error
        if at_end and capture.is_lost and not capture.ended:
            raise SensorError(
                f"{capture.name}: it was lost, and had not come back at the end; what came before "
                "is kept"
            )
