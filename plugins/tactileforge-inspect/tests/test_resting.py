from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tactileforge_inspect.scan import scan_dataset

from tactileforge.checks.resting import Resting, odd_pictures
from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.sensors.resting_colours import colour_agreement, colour_grid, known_colours

from .conftest import Listed


def still(sensor: str, seed: int = 0, noise: float = 0.4) -> NDArray[np.float32]:
    """The resting picture of some unit, upright: float32 (64, 48, 3)."""
    known = known_colours(sensor)
    assert known is not None
    rng = np.random.default_rng(seed)
    grid = known / np.sqrt((known**2).mean()) + noise * rng.normal(size=known.shape)
    return np.kron(100 + 20 * grid, np.ones((16, 12, 1))).clip(0, 255).astype(np.float32)


def of_layer(seed: int) -> NDArray[np.float32]:
    """The resting picture of a sensor with unknown lights: red above, blue below."""
    rng = np.random.default_rng(seed)
    rows = np.linspace(-40, 40, 32)[:, None]
    picture = np.stack([120 - rows, 110 + 0 * rows, 115 + 0.8 * rows], -1) + np.zeros((32, 40, 1))
    return (picture + rng.normal(0, 3, picture.shape)).astype(np.float32)


def lines(pictures: list[Any], sensor: str, has_layout: bool = True) -> list[str]:
    seen = [Resting(f"x/{i}", sensor, p.shape[:2], p) for i, p in enumerate(pictures)]
    return [odd.line for odd in odd_pictures(seen, has_layout)]


@pytest.mark.parametrize("sensor", ["digit", "gelsight_mini"])
def test_half_a_set_with_blue_first(sensor: str) -> None:
    pictures = [still(sensor, i)[..., :: -1 if i % 2 else 1] for i in range(6)]
    upright = [p if sensor == "digit" else np.ascontiguousarray(p[:48]) for p in pictures]
    (line,) = lines(upright, sensor)
    assert line.startswith(f"{sensor}: 3 of 6 look as if red and blue were swapped (channels: bgr")
    assert line.endswith(": x/1, x/3, x/5")


@pytest.mark.parametrize("sensor", ["digit", "gelsight_mini"])
@pytest.mark.parametrize("order", [(1, 2, 0), (2, 0, 1)])
def test_channels_in_yet_another_order(sensor: str, order: tuple[int, ...]) -> None:
    pictures = [still(sensor, i)[:48] for i in range(4)]
    mixed = [p[..., list(order)] if i in (0, 3) else p for i, p in enumerate(pictures)]
    (line,) = lines(mixed, sensor)
    assert line.startswith(f"{sensor}: 2 of 4 look as if their channels were neither RGB nor BGR")
    assert line.endswith(": x/0, x/3")


def test_a_whole_set_with_blue_first() -> None:
    (line,) = lines([still("digit", i)[..., ::-1] for i in range(4)], "digit")
    assert line.startswith("digit: 4 of 4 look as if red and blue were swapped")


def test_keys_of_a_layout_are_named_only_where_there_is_one() -> None:
    turned = [np.rot90(still("digit", i), i == 1)[..., :: -1 if i == 0 else 1] for i in range(3)]
    for line in lines([np.ascontiguousarray(p) for p in turned], "digit", has_layout=False):
        assert "in the layout" not in line
        assert " in the map or options of the data set puts " in line


def test_a_sensor_whose_colours_are_not_known_is_compared_with_itself() -> None:
    pictures = [of_layer(i)[..., :: -1 if i == 2 else 1] for i in range(5)]
    (line,) = lines(pictures, "lab_finger")
    assert line.startswith("lab_finger: 1 of 5 look as if red and blue were swapped")
    assert line.endswith(": x/2")
    assert lines([of_layer(i) for i in range(5)], "lab_finger") == []


@pytest.mark.parametrize("sensor", ["digit", "gelsight_mini"])
@pytest.mark.parametrize(("quarters", "fix"), [(1, 90), (3, 270)])
def test_a_sensor_that_lies_on_its_side(sensor: str, quarters: int, fix: int) -> None:
    pictures = [np.rot90(still(sensor, i)[:48], quarters * (i == 1)) for i in range(3)]
    square = [np.ascontiguousarray(p) for p in pictures]
    (line,) = lines(square, sensor)
    assert line.startswith(f"{sensor}: 1 of 3 look as if lying on its side (rotate: {fix} in")
    assert line.endswith(": x/1")


def test_a_picture_of_several_panels_does_not_lie_on_its_side() -> None:
    turned = np.ascontiguousarray(np.rot90(still("gelsight_mini")[:48]))
    assert lines([turned], "gelsight_mini")
    assert lines([np.tile(turned, (3, 1, 1))], "gelsight_mini") == []


@pytest.mark.parametrize("sensor", ["digit", "gelsight_mini"])
def test_a_part_of_a_set_that_is_upside_down(sensor: str) -> None:
    height = 64 if sensor == "digit" else 48
    turned = [np.rot90(still(sensor, i)[:height], 2 * (i in (1, 4))) for i in range(6)]
    (line,) = lines([np.ascontiguousarray(p) for p in turned], sensor)
    assert line.startswith(f"{sensor}: 2 of 6 are upside down beside the others (rotate: 180 in")
    assert line.endswith(": x/1, x/4")
    assert lines([np.ascontiguousarray(turned[i]) for i in (1, 4)], sensor) == [], "a whole set"


def test_upside_down_under_lights_that_differ_from_the_usual() -> None:
    known = known_colours("digit")
    assert known is not None
    upright = [still("digit", i, noise=1.1) for i in range(6)]
    fits = [colour_agreement(colour_grid(picture), known) for picture in upright]
    assert max(fits) < 0.85, "none is sure by itself"
    turned = [np.rot90(picture, 2 * (i in (1, 4))) for i, picture in enumerate(upright)]
    (line,) = lines([np.ascontiguousarray(picture) for picture in turned], "digit")
    assert line.startswith("digit: 2 of 6 are upside down beside the others")
    assert line.endswith(": x/1, x/4")


def test_sides_that_differ_within_a_set() -> None:
    pictures = [of_layer(i) if i else np.ascontiguousarray(np.rot90(of_layer(0))) for i in range(4)]
    (line,) = lines(pictures, "lab_finger")
    assert "1 of 4 look as if lying on its side (rotate: 90 or 270" in line


def test_grey_pictures_of_a_sensor_with_colours() -> None:
    grey = np.full((64, 48, 3), 90, np.float32)
    (line,) = lines([still("digit"), grey], "digit")
    assert line == "digit: 1 of 2 are grey, where the sensor is lit in colours: x/1"
    assert lines([grey], "dm") == []


@pytest.mark.parametrize("sensor", ["digit", "gelsight_mini"])
def test_sane_sets_raise_nothing(sensor: str) -> None:
    height = 64 if sensor == "digit" else 36
    assert lines([still(sensor, i)[:height] for i in range(30)], sensor) == []


def test_inspect_prints_and_counts_them() -> None:
    def recording(i: int) -> Recording:
        picture = still("digit", i)[..., :: -1 if i % 2 else 1].astype(np.uint8)
        frames = ArrayFrames(np.stack([picture] * 3))
        times = np.arange(3) / 30
        return Recording(
            key=f"x/{i}", sensor="digit", frames=frames, times=times, no_contact=frames
        )

    found = scan_dataset(Listed([recording(i) for i in range(6)]), 10, progress=False).findings
    assert found.counts["colours_swapped"] == 3
    assert "digit: 3 of 6 look as if red and blue were swapped" in str(found)
    assert {suspect.key for suspect in found.worst["colours_swapped"]} == {"x/1", "x/3", "x/5"}
