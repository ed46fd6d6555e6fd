import numpy as np
import pytest
from tactileforge_sim.sensors.sim import SimSensor

from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.testing import check
from tactileforge.testing.clock import FakeTime


@pytest.mark.slow
def test_conformance() -> None:
    results = check("sensor", SimSensor("digit", size=32))
    assert [one for one in results if one.status == "failed"] == []


@pytest.mark.slow
def test_touches_follow_each_other_with_their_forces() -> None:
    with SimSensor("digit", "small_sphere", "slide_left", size=32, realtime=False) as sensor:
        assert (sensor.spec.height, sensor.spec.width, sensor.spec.fps) == (43, 32, 30)
        frames, forces = [], []
        for _ in range(140):
            frames.append(sensor.read())
            forces.append(sensor.force)
    normal = np.array(forces)[:, 2]
    contact = np.diff((normal > 0).astype(int))
    assert (contact == 1).sum() >= 2
    assert (contact == -1).sum() >= 1
    np.testing.assert_allclose(np.diff([frame.time for frame in frames]), 1 / 30, atol=1e-6)
    # A viscous gel is dented for some frames more after the last force.
    loaded = np.convolve(normal > 0, np.ones(13))[: len(normal)] > 0
    still = np.array([f.array for f, one in zip(frames, loaded, strict=True) if not one])
    assert len(still) > 8
    assert np.abs(still.astype(int) - still[0]).max() < 15


@pytest.mark.slow
def test_a_late_reader_gets_the_newest_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = FakeTime()
    monkeypatch.setattr("tactileforge_sim.sensors.sim.time", clock)
    with SimSensor("gelsight_mini", size=16) as sensor:
        first = sensor.read()
        clock.sleep(0.6)
        second = sensor.read()
        assert second.time - first.time > 0.4


def test_mistakes_are_named() -> None:
    with pytest.raises(TactileForgeError, match="not open"):
        SimSensor().read()
    with pytest.raises(ConfigError, match="unknown motion 'dance'"):
        SimSensor(motions="dance").open()
    with pytest.raises(ConfigError, match="sensor"):
        SimSensor("digitt")
