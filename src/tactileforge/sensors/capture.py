"""Reads one sensor in a thread, reconnects when it is lost, and counts its frames."""

from __future__ import annotations

import math
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from tactileforge.contracts import Frame, Sensor
from tactileforge.errors import ConfigError, SensorError, TactileForgeError
from tactileforge.sensors.awake import CLOCK
from tactileforge.sensors.clock_lag import ClockLag
from tactileforge.sensors.frame_contract import BAD_VALUES, bad_values, check_frame
from tactileforge.sensors.health import Health
from tactileforge.sensors.picture_changes import CHANGES, PictureChanges

#: Seconds by which the time of a frame may differ from the clock when it arrives.
_AHEAD, _BEHIND = 1.0, 10.0
#: Seconds that one read may wait, so that stopping is quick; and between two attempts to open.
_WAIT, _RETRY = 0.25, 0.5
#: Frames over which the rate is measured.
_RATE_OVER = 60


@dataclass
class Counts:
    """Counters of the frames of a sensor.

    Attributes:
        frames: Frames handed on.
        backwards: Frames that were not later than the one before, and were dropped.
        untimed: Frames whose time is no number, and were dropped.
        frozen: Frames that repeated one picture for too long, and were dropped.
        bad_values: Samples that were dropped for their values, by `frame_contract.BAD_VALUES`.
        stalled: How often its driver did not return for longer than silence may last.
        reopened: How often it was lost and came back.
    """

    frames: int = 0
    backwards: int = 0
    untimed: int = 0
    frozen: int = 0
    bad_values: Counter[str] = field(default_factory=Counter)
    stalled: int = 0
    reopened: int = 0


class Capture:
    """Reads an open sensor in a thread until it is stopped.

    Args:
        name: What to call it in messages.
        sensor: Open; its owner closes it.
        sink: Takes each good frame, in that thread; must not block for long.
        reconnect: Seconds for which a sensor that is lost is opened again and again.
        silence: Seconds without a frame after which it counts as lost.

    Attributes:
        counts: What it has given.
        health: What its pictures look like.
        changes: How its pictures have changed since the first.
        lag: How its times go.
        error: Why it has ended; None while all is well.
        ended: Whether its source is over.
        is_lost: Whether it is being opened again.
        latest: Time of the last good frame.
        cause: Why the last frame was no good one; "" after a good one.
    """

    def __init__(
        self,
        name: str,
        sensor: Sensor,
        sink: Callable[[Frame], None],
        reconnect: float = 10.0,
        silence: float = 3.0,
    ) -> None:
        self.name, self.sensor, self.sink = name, sensor, sink
        self.reconnect, self.silence = reconnect, silence
        self.counts = Counts()
        self.health = Health(sensor.spec)
        self.changes = PictureChanges(sensor.spec)
        self.lag = ClockLag()
        self.error: TactileForgeError | None = None
        self.ended = False
        self.is_lost = False
        self.latest = -math.inf
        self.cause = ""
        self._good = self._opened = CLOCK.now()  # the last good frame, and open()
        self._lost: float | None = None  # when it was; None while frames come
        self._call: tuple[str, float] | None = None  # of the driver, that has not returned
        self._recent: deque[float] = deque(maxlen=_RATE_OVER)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"capture-{name}", daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        CLOCK.start()
        self._good = self._opened = CLOCK.now()
        self._thread.start()

    def stop(self) -> None:
        """Ends the thread; a second call does nothing."""
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
        """Frames per second, over the latest; it sinks while none comes, and is 0 when lost."""
        times = list(self._recent)
        span = times[-1] - times[0] if len(times) > 1 else 0.0
        if span <= 0 or self.is_lost:
            return 0.0
        quiet = CLOCK.now() - self._good
        is_late = not self.is_done and quiet > 3 * span / (len(times) - 1)
        return (len(times) - 1) / (span + quiet * is_late)

    def drops(self) -> dict[str, int]:
        """Frames that were dropped, by reason; with those its driver counts (``sensor.drops``)."""
        counts = self.counts
        own = {key: getattr(counts, key) for key in ("backwards", "untimed", "frozen")}
        both = counts.bad_values + Counter(getattr(self.sensor, "drops", {}))
        return own | dict.fromkeys(getattr(self.sensor, "drops", {}), 0) | both

    def noticed(self) -> dict[str, str]:
        """What is odd about frames that were kept, in words, by ``clock`` or a change."""
        found = {key: CHANGES[key] for key in list(self.changes.counts)}
        clock = self.lag.trouble()
        return found | ({"clock": clock} if clock else {})

    def watch(self) -> None:
        """Notices what the thread that reads cannot: that it hangs, or has ended.

        Another thread calls it now and then.
        """
        call = self._call
        if self.is_done or self._stop.is_set():
            return
        if not self._thread.is_alive():
            self.error = SensorError(f"{self.name}: the thread that reads it has ended")
        elif call is not None and (took := CLOCK.now() - call[1]) > self.silence:
            self.counts.stalled += not self.is_lost
            self.is_lost = True
            if took > self.silence + self.reconnect:
                self.error = SensorError(
                    f"{self.name}: {call[0]}() of its driver has not returned for {took:.1f} s; it "
                    "is left behind: plug the device out and in"
                )

    @contextmanager
    def _calls(self, what: str) -> Iterator[None]:
        self._call = (what, CLOCK.now())
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
        except BaseException as error:  # a driver may raise anything, and exit as well
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
        if not self._is_timed(frame):
            self._miss("its times do not go on")
            return
        check_frame(frame, self.sensor.spec)
        if reason := bad_values(frame, self.sensor.spec):
            self.counts.bad_values[reason] += 1
            self._miss(BAD_VALUES[reason])
        else:
            self._accept(frame)

    def _miss(self, cause: str) -> None:
        """No good frame came: after a while the sensor is opened again, and then given up."""
        now, self.cause = CLOCK.now(), cause
        if now - self._good > self.silence + self.reconnect:
            raise SensorError(f"{cause} (for {now - self._good:.1f} s)")
        if now - max(self._good, self._opened) > self.silence:
            self._reopen(cause)

    def _reopen(self, cause: str) -> None:
        self.is_lost, self.cause = True, cause
        with self._calls("close"), suppress(Exception):  # what is gone may not close either
            self.sensor.close()
        if self._lost is None:
            self._lost = CLOCK.now()
        # one without a zero to keep is opened as at first
        reopen = getattr(self.sensor, "reopen", self.sensor.open)
        while not self._stop.wait(_RETRY):
            if CLOCK.now() > self._lost + self.reconnect:
                raise SensorError(f"{cause} (it has not come back within {self.reconnect:g} s)")
            try:
                with self._calls("open"):
                    reopen()
            except ConfigError:
                raise
            except Exception:  # a driver has its own words for what is not there yet
                continue
            self.counts.reopened += 1
            self._opened = CLOCK.now()
            return

    def _is_timed(self, frame: Frame) -> bool:
        if not math.isfinite(frame.time):
            self.counts.untimed += 1
            return False
        if not frame.time > self.latest:
            self.counts.backwards += 1
            return False
        return True

    def _accept(self, frame: Frame) -> None:
        behind = CLOCK.since(frame.time)
        self.lag.add(frame.time, frame.time + behind)
        if not -_AHEAD < behind < _BEHIND:
            raise SensorError(
                f"a frame is {abs(behind):.1f} s {'behind' if behind > 0 else 'ahead of'} the "
                "clock: its times must be those of time.monotonic(), and a replay or simulation "
                "needs realtime=true"
            )
        self.latest, self.cause = frame.time, ""
        self._good = CLOCK.now()
        self.is_lost, self._lost = False, None
        self._recent.append(frame.time)
        if self.health.look(frame) == "frozen":
            self.counts.frozen += 1
            return
        self.changes.look(frame)
        self.counts.frames += 1
        self.sink(frame)


def check(captures: Sequence[Capture], at_end: bool = False) -> None:
    """Looks after sensors that are read.

    Args:
        captures: Of each.
        at_end: Whether this was all; then a sensor that is lost will not come back.

    Raises:
        SensorError: One has ended with an error, hangs for too long, or is lost at the end.
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
