"""Limits of containers, each on both sides of its edge."""

import numpy as np
import pytest

from tactileforge.errors import DataError
from tactileforge.reading.container import MOST_KEYS, check_keys, check_size, check_unpacked


@pytest.mark.parametrize(
    ("shape", "dtype", "block", "wanted"),
    [
        ((70_000, 224, 224, 3), "u1", (10, 224, 224, 3), ""),
        ((0, 3), "f4", (1, 3), ""),
        ((), "f8", (), ""),
        ((40, 3), "f4", (0, 3), "chunks of (0, 3)"),
        ((40, -3), "f4", (), "shape (40, -3)"),
        ((40, 10**8, 3), "f4", (1, 10**6, 3), "1144 MB at once"),
        ((2**31, 2**31), "f8", (1, 1), "more than any disk"),
        ((4,), "U500000000", (1,), "MB at once"),
        ((1, 2**28), "u1", (), ""),
        ((1, 2**28 + 1), "u1", (), "256 MB at once, where 256 MB are the limit"),
    ],
)
def test_sizes_of_arrays(shape, dtype, block, wanted):
    said = check_size("chunks", shape, np.dtype(dtype), block)
    assert wanted in said
    assert bool(said) == bool(wanted)


def test_what_a_compressed_file_may_hold():
    assert not check_unpacked(1_000, 1 << 26)  # small is always fine
    assert not check_unpacked(100 << 20, 5_000 << 20)  # 50 times
    assert "no data compress so well" in check_unpacked(100 << 20, (5_000 << 20) + 1)
    assert "are the limit" in check_unpacked(1 << 40, (1 << 33) + 1)


def test_the_number_of_arrays():
    check_keys("x", MOST_KEYS)
    with pytest.raises(DataError, match=r"x: more than 100000 arrays"):
        check_keys("x", MOST_KEYS + 1)
