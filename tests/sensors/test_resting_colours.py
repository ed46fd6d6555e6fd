import numpy as np
import pytest

from tactileforge.sensors.resting_colours import (
    colour_agreement,
    colour_grid,
    has_colours,
    is_grey,
    is_swapped,
    known_colours,
    turn_of,
)

SENSORS = ("digit", "gelsight_mini")


def lit(sensor: str, noise: float, seed: int = 0) -> np.ndarray:
    """A picture of another unit of a sensor: its lights differ by a share of its colours."""
    known = known_colours(sensor)
    assert known is not None
    rng = np.random.default_rng(seed)
    grid = known / np.sqrt((known**2).mean()) + noise * rng.normal(size=known.shape)
    fine = np.kron(100 + 20 * grid, np.ones((16, 16, 1)))
    return fine.clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("gain", [0.5, 1.0, 1.5])
def test_swapped_colours_are_told_whatever_the_exposure(sensor: str, gain: float) -> None:
    known = known_colours(sensor)
    assert known is not None
    for seed in range(10):
        picture = gain * lit(sensor, 0.5, seed)
        assert not is_swapped(colour_grid(picture), known)
        assert is_swapped(colour_grid(picture[..., ::-1]), known)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("quarters", range(4))
def test_turns_are_clockwise(sensor: str, quarters: int) -> None:
    known = known_colours(sensor)
    assert known is not None
    grid = colour_grid(lit(sensor, 0.2))
    assert turn_of(np.rot90(grid, quarters), known) == 90 * quarters, "rot90 turns the other way"


def test_a_picture_that_tells_nothing_is_neither() -> None:
    known = known_colours("digit")
    assert known is not None
    noise = colour_grid(np.random.default_rng(0).integers(0, 255, (64, 64, 3)))
    grey = np.full((64, 64, 3), 120, np.uint8)
    for grid in (noise, colour_grid(grey)):
        assert not is_swapped(grid, known)
        assert turn_of(grid, known) is None
    assert is_grey(grey)
    assert not is_grey(lit("digit", 0))
    assert has_colours(colour_grid(lit("digit", 0)))
    assert not has_colours(colour_grid(grey))
    assert colour_agreement(known, known) == pytest.approx(1)
    assert known_colours("gelslim") is None
