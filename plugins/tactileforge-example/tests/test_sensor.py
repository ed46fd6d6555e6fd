import numpy as np
from tactileforge_example.sensor import Dummy

from tactileforge.testing import check


def test_conformance():
    results = check("sensor", "dummy")
    assert {result.status for result in results} == {"ran"}, results


def test_gain_scales_contrast():
    def contrast(gain):
        sensor = Dummy(gain, rest=0.0)
        return np.ptp(sensor._draw(0.5).astype(int))

    assert contrast(0.0) == 20  # the gel's own colour
    assert contrast(0.5) < contrast(1.0)


def test_it_rests_for_a_background_and_is_never_frozen():
    with Dummy(rest=600.0) as sensor:  # a busy machine may read late
        first, second = (sensor.read().array.astype(int) for _ in range(2))
    sensor = Dummy(rest=0.2)
    gel = sensor._draw(0.0).astype(int)
    assert abs(first - gel).max() == abs(second - gel).max() == 1
    assert (first != second).any()
    assert (sensor._draw(0.7) != gel).any()
    for after in (1.2, 1.3, 2.4):  # lifted off between presses, for the background of the next take
        assert (sensor._draw(after) == gel).all()
    assert (sensor._draw(1.9) != gel).any()
