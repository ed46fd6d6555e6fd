"""Loss of contact, on changes made by hand."""

import numpy as np
import pytest
from tactileforge_bench.tasks import contact

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames

#: Ten frames at rest, 70 of contact, 20 at rest.
CHANGE = np.concatenate([np.full(10, 0.8), np.full(70, 6.0), np.full(20, 0.8)])
TIMES = np.arange(100) / 25


def test_the_last_contact_is_found() -> None:
    assert contact.last_contact(CHANGE) == (10, 79)
    twice = CHANGE.copy()
    twice[40:45] = 0.5
    assert contact.last_contact(twice) == (45, 79)


def test_a_recording_that_ends_in_contact_or_has_none_says_nothing() -> None:
    assert contact.last_contact(CHANGE[:70]) is None
    assert contact.last_contact(np.full(50, 0.8)) is None


@pytest.mark.parametrize(
    ("frame", "state"),
    [(5, None), (30, None), (39, "held"), (59, "held"), (60, None), (70, None),
     (71, "losing"), (79, "losing"), (80, None), (95, None)],
)  # fmt: skip
def test_states_are_by_seconds_before_the_loss(frame: int, state: str | None) -> None:
    assert contact.contact_state((10, 79), frame, TIMES) == state


def test_every_recording_has_as_many_of_each_whatever_its_length() -> None:
    """So the length of a recording cannot tell a state."""
    for start, stop in ((10, 60), (10, 90), (20, 79)):
        states = [contact.contact_state((start, stop), i, TIMES) for i in range(100)]
        assert states.count("losing") == 9
        assert states.count("held") == 21
    assert {contact.contact_state((50, 79), i, TIMES) for i in range(100)} == {None}, (
        "held too briefly"
    )


def test_energy_is_the_mean_change() -> None:
    frames = np.full((6, 30, 40, 3), 100, np.uint8)
    frames[3:, :15] += 10
    recording = Recording(
        key="a",
        sensor="digit",
        frames=ArrayFrames(frames),
        times=np.arange(6) / 25,
        no_contact=ArrayFrames(frames[:2]),
    )
    assert contact.contact_energy(recording) == pytest.approx([0, 0, 0, 5, 5, 5])
