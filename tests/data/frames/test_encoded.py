import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactileforge.data.frames.encoded import EncodedFrames
from tactileforge.errors import DataError
from tactileforge.reading.pickles import load_pickle

Make = Callable[..., Any]


def test_frames_of_a_pickle(tmp_path: Path, encoded: Make, levels: Make) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps([encoded(i) for i in range(5)], 4))
    frames = EncodedFrames("a", load_pickle(path))
    assert (len(frames), frames.shape) == (5, (24, 32))
    assert levels(frames) == [0, 1, 2, 3, 4]
    assert levels(pickle.loads(pickle.dumps(frames))) == [0, 1, 2, 3, 4]
    assert frames.read([3, 3, 1])[:, 0, 0, 0].tolist() == [21, 21, 7]


def test_channels_and_turns(encoded: Make) -> None:
    blue = encoded(0, colour=(200, 10, 20))
    assert EncodedFrames("a", [blue], bgr=True).read([0])[0, 0, 0].tolist() == [20, 10, 200]
    picture = np.zeros((2, 3, 3), np.uint8)
    picture[0, 2] = 255  # the upper right corner goes to the upper left
    turned = EncodedFrames("a", [picture], turns=1)
    assert turned.shape == (3, 2)
    assert turned.read([0])[0, :, :, 0].tolist() == [[255, 0], [0, 0], [0, 0]]


def test_damage(encoded: Make) -> None:
    frames = EncodedFrames("a", [encoded(0), b"no image", encoded(0, (8, 8)), np.zeros((4, 4))])
    for i, what in ((1, "not a readable image"), (2, "8x8 pixels, where"), (3, "float64")):
        with pytest.raises(DataError, match=f"a, frame {i}: .*{what}"):
            frames.read([0, i])
    with pytest.raises(DataError, match="a: a recording without frames"):
        EncodedFrames("a", [])
    with pytest.raises(IndexError):
        frames.read([4])
