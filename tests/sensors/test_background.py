import numpy as np
import pytest
from tactileforge_sim.sensors.sim import SimSensor

from tactileforge.errors import SensorError
from tactileforge.sensors.background import check_background, spread_frames, variation
from tactileforge.sensors.opening import unit_of


def pictures(count=20, noise=4, seed=0):
    rng = np.random.default_rng(seed)
    return [
        (120 + noise * rng.standard_normal((96, 128, 3))).clip(0, 255).astype(np.uint8)
        for _ in range(count)
    ]


def test_noise_is_no_touch():
    """The mean of 8 x 8 pixels has an eighth of the noise; three of those are seldom passed."""
    assert 0.5 < variation(pictures()) < 4 / 8 * 4.5
    assert variation(pictures(1)) == 0
    check_background("left", pictures(), 4.0)


def test_a_small_touch_in_one_of_many_frames_is_found():
    seen = pictures()
    seen[12][30:54, 40:64] += 12
    with pytest.raises(SensorError, match=r"left: something touches it.*Lift everything off"):
        check_background("left", seen, 4.0)


def test_a_simulated_finger_is_told_from_one_that_rests():
    with SimSensor("digit", size=64, realtime=False, rest=1.0) as sensor:
        rest = [sensor.read().array for _ in range(30)]
        assert not sensor.force.any()
        touch = [sensor.read().array for _ in range(30)]
        assert sensor.force.any()
    check_background("sim", rest, 4.0)
    with pytest.raises(SensorError, match="something touches"):
        check_background("sim", touch, 4.0)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ([], "left: no frame came for its background"),
        ([np.zeros((16, 16, 3), np.uint8)], "left: its background is black: .*exposure="),
        ([np.full((16, 16, 3), 255, np.uint8)], "left: its background is saturated"),
    ],
)
def test_what_is_no_background(frames, message):
    with pytest.raises(SensorError, match=message):
        check_background("left", frames, 4.0)


def test_the_frames_that_are_kept_are_spread_evenly():
    frames = [np.full((1, 1, 3), i, np.uint8) for i in range(31)]
    assert [int(f[0, 0, 0]) for f in spread_frames(frames, 4)] == [0, 10, 20, 30]
    assert len(spread_frames(frames[:2], 5)) == 2
    assert spread_frames([], 5) == []
    assert len(spread_frames(frames, 1)) == 1


def test_taxels_are_compared_one_by_one():
    rest = [np.full((4, 4, 3), 128, np.uint8)] * 9
    touched = rest[0].copy()
    touched[1, 2] = 160
    assert variation([*rest, touched]) < 4
    with pytest.raises(SensorError, match="something touches it"):
        check_background("array", [*rest, touched], 4.0, camera=False)


@pytest.mark.parametrize(
    ("address", "unit", "known"),
    [
        ("/dev/video0", "D20001", "D20001"),
        ("/dev/video0", "", ""),
        ("udp:10.0.0.2:49152", "", "udp:10.0.0.2:49152"),
        ("", "", ""),
    ],
)
def test_a_unit_is_known_by_what_stays_with_it(scripted, address, unit, known):
    sensor = scripted(address=address)
    sensor.unit = unit
    assert unit_of(sensor) == known


def test_odd_first_frames_are_left_out_and_touch_is_not():
    rng = np.random.default_rng(0)
    still = [rng.integers(100, 104, (48, 64, 3)).astype(np.uint8) for _ in range(30)]
    green = [frame * np.array([0, 1, 0], np.uint8) for frame in still[:3]]
    assert list(check_background("a", [*green, *still[3:]], 4.0)) == still[3:]
    assert list(check_background("a", still, 4.0)) == still
    pressed = [frame.copy() for frame in still]
    for frame in pressed[4:]:
        frame[10:40, 10:40] += 30  # a third of it: somebody presses
    with pytest.raises(SensorError, match=r"something touches it.* warmup= of the camera"):
        check_background("a", pressed, 4.0)
    with pytest.raises(SensorError, match="something touches it"):  # green for too long
        check_background("a", [*(green * 5), *still[15:]], 4.0)
