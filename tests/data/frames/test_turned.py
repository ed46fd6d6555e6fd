import numpy as np
import pytest

from tactileforge.contracts import FrameSubset
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.frames.turned import TurnedFrames, turned

FRAMES = np.random.default_rng(0).integers(0, 255, (3, 4, 6, 3)).astype(np.uint8)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_quarter_turns_are_clockwise(turns: int) -> None:
    frames = TurnedFrames(ArrayFrames(FRAMES), False, turns)
    assert frames.shape == ((6, 4) if turns % 2 else (4, 6))
    read = frames.read([2, 0])
    assert (read.shape, read.flags["C_CONTIGUOUS"]) == ((2, *frames.shape, 3), True)
    corner = {0: (0, 0), 1: (0, 3), 2: (3, 5), 3: (5, 0)}[turns]  # of the upper left pixel
    np.testing.assert_array_equal(read[0][corner], FRAMES[2, 0, 0])


def test_blue_comes_last() -> None:
    frames = turned(FrameSubset(ArrayFrames(FRAMES), [1]), True, 0)
    np.testing.assert_array_equal(frames.read([0])[0], FRAMES[1][..., ::-1])
    plain = ArrayFrames(FRAMES)
    assert turned(plain, False, 0) is plain
