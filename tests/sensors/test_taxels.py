import numpy as np
import pytest

from tactileforge.errors import ConfigError
from tactileforge.sensors.taxels import REST, TaxelLayout


def test_a_grid_is_drawn_row_by_row_around_the_baseline():
    layout = TaxelLayout((2, 3), channels=[0], span=127.0)
    baseline = np.full((6, 1), 20.0)
    values = baseline + np.array([[0.0], [1], [-1], [127], [-127], [500]])
    picture = layout.draw(values, baseline)
    assert picture.shape == (2, 3, 3)
    assert picture[..., 2].tolist() == [[128, 129, 127], [255, 1, 255]]
    assert (picture[..., :2] == REST).all()  # one value alone is z


def test_x_y_and_z_are_red_green_and_blue_each_with_its_span():
    layout = TaxelLayout((1, 1), channels=[1, 2, 3], span=[127.0, 254.0, 63.5])
    picture = layout.draw(np.array([[25.0, 10.0, 10.0, 10.0]]), np.zeros((1, 4)))
    assert picture.tolist() == [[[138, 133, 148]]]


def test_between_taxels_is_the_mean_by_the_inverse_square_of_the_distance():
    layout = TaxelLayout((1, 4), positions=[[0, 0], [0, 3]], channels=[0], span=127.0)
    row = layout.draw(np.array([[100.0], [0.0]]), np.zeros((2, 1)))[0, :, 2]
    near, far = 1 / 1, 1 / 4
    expected = [100, 100 * near / (near + far), 100 * far / (near + far), 0]
    assert row.tolist() == [round(REST + value) for value in expected]


def test_nothing_is_wasted_and_nothing_invented():
    """A change common to all taxels is the same everywhere, wherever they lie."""
    places = [[0, 2.2], [1.5, 0], [2, 2], [2.5, 4], [5, 1.7]]
    layout = TaxelLayout((6, 5), positions=places, span=50.0)
    baseline = np.random.default_rng(0).normal(size=(5, 3))
    picture = layout.draw(baseline + np.array([5.0, -10.0, 20.0]), baseline)
    step = 127 / 50
    want = np.round(REST + step * np.array([5, -10, 20]))
    assert (picture == want).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"shape": (0, 3)}, "0 x 3 taxels"),
        ({"channels": [0, 1]}, r"channels=\[0, 1\]: give one value \(z\), or three"),
        ({"span": 0.0}, "span=0.0: give values above 0"),
        ({"positions": [[0, 1, 2]]}, "a row and a column for each taxel"),
        ({"positions": [[2, 0]]}, "outside the picture of 2 x 2 pixels"),
    ],
)
def test_layouts_that_cannot_be(given, message):
    with pytest.raises(ConfigError, match=message):
        TaxelLayout(**{"shape": (2, 2), **given})
