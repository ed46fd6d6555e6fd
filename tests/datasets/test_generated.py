import pickle
from time import perf_counter

import numpy as np
import pytest

from tactileforge.contracts import ACTIONS, Dataset, Recording
from tactileforge.data.actions import label_actions
from tactileforge.datasets.generated import Generated
from tactileforge.errors import ConfigError
from tactileforge.testing import check


@pytest.fixture(scope="module")
def touches() -> list[Recording]:
    return list(Generated(recordings=54).recordings("train"))


def test_conformance() -> None:
    assert isinstance(Generated(), Dataset)
    assert [one for one in check("dataset", "generated") if one.status == "failed"] == []


def test_the_sets_that_matching_needs(touches: list[Recording]) -> None:
    assert len({one.key for one in touches}) == 54
    assert {one.sensor for one in touches} == {"digit", "gelsight", "gelsight_mini"}
    by_object: dict[str | None, set[str]] = {}
    for one in touches:
        by_object.setdefault(one.object, set()).add(one.sensor)
    assert all(len(sensors) == 3 for sensors in by_object.values())
    seen = {ACTIONS[i] for one in touches if one.action is not None for i in set(one.action) - {-1}}
    assert seen == set(ACTIONS)


def test_the_same_numbers_draw_the_same_frames() -> None:
    first, again = (list(Generated(recordings=3).recordings("train"))[2] for _ in range(2))
    rows = [30, 0, 88]
    want = first.frames.read(rows)
    np.testing.assert_array_equal(again.frames.read(rows), want)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(first)).frames.read(rows), want)
    np.testing.assert_array_equal(first.frames.read([0, 30])[1], want[0])
    other = list(Generated(recordings=3, seed=1).recordings("train"))[2]
    assert (other.frames.read(rows) != want).mean() > 0.5


def test_validation_does_not_depend_on_the_number_of_recordings() -> None:
    small, large = (list(Generated(recordings=n, val=3).recordings("val")) for n in (3, 60))
    assert [one.key for one in small] == [one.key for one in large]
    np.testing.assert_array_equal(small[0].frames.read([40]), large[0].frames.read([40]))


def test_forces_obey_their_laws(touches: list[Recording]) -> None:
    for one in touches:
        assert one.force is not None
        shear, normal = np.linalg.norm(one.force[:, :2], axis=1), one.force[:, 2]
        assert (normal >= 0).all()
        assert 1 < normal.max() < 10
        assert (shear <= 0.6 * normal + 1e-5).all(), "Coulomb"
        assert normal[0] == normal[-1] == 0


def test_shear_points_where_the_slide_goes(touches: list[Recording]) -> None:
    signs = {"left": (0, -1), "right": (0, 1), "up": (1, -1), "down": (1, 1)}
    seen = set()
    for one in touches:
        assert one.force is not None
        assert one.action is not None
        motion = next(ACTIONS[i] for i in one.action if i >= ACTIONS.index("slide_left"))
        kind, _, way = motion.partition("_")
        end = one.force[np.flatnonzero(one.action == ACTIONS.index(motion))[-1]]
        if kind == "rotate":
            np.testing.assert_array_equal(one.force[:, :2], 0)
            continue
        axis, sign = signs[way]
        np.testing.assert_allclose(end[axis], sign * 0.6 * end[2], rtol=1e-5)
        assert abs(end[1 - axis]) < 1e-6
        seen.add(way)
    assert seen == set(signs)


def test_actions_agree_with_those_read_from_the_force(touches: list[Recording]) -> None:
    for one in touches:
        assert one.force is not None
        assert one.action is not None
        read = label_actions(one.times, one.force)
        both = (read >= 0) & (one.action >= 0)
        assert both.sum() > 20
        np.testing.assert_array_equal(read[both], one.action[both])


def test_frames_show_the_motion(touches: list[Recording]) -> None:
    """The imprint moves to the side that the action names, on every sensor."""
    ways = {"slide_left": (-1, 0), "slide_right": (1, 0), "slide_up": (0, -1), "slide_down": (0, 1)}
    for one in touches[:12]:
        assert one.action is not None
        assert one.no_contact is not None
        motion = next(ACTIONS[i] for i in one.action if i >= ACTIONS.index("slide_left"))
        if motion not in ways:
            continue
        rows = np.flatnonzero(one.action == ACTIONS.index(motion))[[0, -1]]
        still = one.no_contact.read([0]).astype(float)
        change = np.abs(one.frames.read(rows.tolist()) - still).sum(axis=-1)
        change[change < 30] = 0
        down, right = np.mgrid[:112, :112]
        centre = np.array(
            [[(c * right).sum() / c.sum(), (c * down).sum() / c.sum()] for c in change]
        )
        moved = (centre[1] - centre[0]) * 16 / 112
        np.testing.assert_allclose(moved, 3 * np.array(ways[motion]), atol=0.5)


def test_first_frame_is_without_contact(touches: list[Recording]) -> None:
    for one in touches[:3]:
        first, pressed = one.frames.read([0, len(one.frames) // 2]).astype(int)
        second = one.frames.read([1])[0].astype(int)
        assert np.abs(first - second).mean() < 3, "noise only"
        assert np.abs(first - pressed).max() > 30


def test_size_and_length() -> None:
    (one,) = Generated(recordings=1, size=64, seconds=2).recordings("train")
    assert one.frames.shape == (64, 64)
    assert len(one.frames) == len(one.times) == 60
    assert one.image is not None
    assert one.image.read([0]).shape == (1, 64, 64, 3)


def test_a_frame_takes_about_a_millisecond(touches: list[Recording]) -> None:
    start = perf_counter()
    touches[0].frames.read(range(40))
    assert (perf_counter() - start) / 40 < 0.01


def test_wrong_numbers_are_named() -> None:
    with pytest.raises(ConfigError, match="recordings, size and seconds are positive"):
        Generated(size=0)
    with pytest.raises(ConfigError, match="unknown split 'test'"):
        list(Generated().recordings("test"))
