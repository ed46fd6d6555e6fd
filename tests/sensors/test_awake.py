"""The clock stands still while the process does."""

import pytest

from tactileforge.sensors import awake


class Time:
    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now


@pytest.fixture
def time(monkeypatch):
    made = Time()
    monkeypatch.setattr(awake, "time", made)
    return made


def test_a_process_that_was_stopped_for_a_minute_has_waited_for_a_second(time):
    clock = awake.AwakeClock()
    start = clock.now()
    for _ in range(10):
        time.now += 0.1
        clock.beat()
    assert clock.now() - start == pytest.approx(1.0)
    time.now += 60.0  # stopped; whoever runs first asks before the next beat
    assert clock.now() - start == pytest.approx(2.0)
    clock.beat()
    assert clock.now() - start == pytest.approx(2.0)
    time.now += 0.1
    assert clock.now() - start == pytest.approx(2.1)


def test_a_frame_from_before_the_stop_is_not_late(time):
    clock = awake.AwakeClock()
    taken = time.now
    time.now += 60.0
    assert clock.since(taken) == pytest.approx(1.0)
    clock.beat()
    assert clock.since(taken) == pytest.approx(1.0)
    assert clock.since(time.now - 30) == pytest.approx(0.0)
    assert clock.since(time.now + 2) == pytest.approx(-2.0)
    time.now += 0.5
    assert clock.since(taken) == pytest.approx(1.5)
