"""The conformance test of containers: a good one passes, and each fault is named."""

import numpy as np
import pytest

from tactileforge.data import ArrayFrames
from tactileforge.errors import DataError
from tactileforge.reading import Facts
from tactileforge.testing import check_container


class Rows:
    def __init__(self, values, dtype=None):
        self.values, self.facts = values, Facts(values.shape, dtype or values.dtype)

    def rows(self, rows):
        if len(rows) and max(rows) >= len(self.values):
            raise DataError(f"no row {max(rows)}")
        return self.values[np.asarray(rows, np.int64)]


class Memory:
    """A container of arrays in memory."""

    def __init__(self):
        pixels = np.arange(4 * 8 * 6 * 3).astype(np.uint8)
        self.arrays = {"b/touch": pixels.reshape(4, 8, 6, 3), "b/x": np.array([[1.0, np.nan]] * 4)}

    def keys(self):
        return sorted(self.arrays)

    def array(self, key):
        if key not in self.arrays:
            raise DataError(f"no {key}")
        return Rows(self.arrays[key])

    def times(self, key):
        self.array(key)
        return np.arange(4) / 30

    def frames(self, key):
        values = self.array(key).values
        return ArrayFrames(values) if values.ndim == 4 else None


def failed(container):
    return {one.name: one.detail for one in check_container(container) if one.status == "failed"}


def test_a_good_container_passes():
    results = check_container(Memory())
    assert {one.status for one in results} == {"ran"}
    assert len(results) == 6


class Unsorted(Memory):
    def keys(self):
        return sorted(self.arrays)[::-1]


class Silent(Memory):
    def array(self, key):
        return Rows(self.arrays.get(key, np.zeros((4, 1))))


class OtherType(Memory):
    def array(self, key):
        super().array(key)
        return Rows(self.arrays[key], np.dtype("f4"))


class Backwards(Memory):
    def array(self, key):
        found = super().array(key)
        found.rows = lambda rows: Rows(self.arrays[key]).rows(sorted(rows))
        return found


class Falling(Memory):
    def times(self, key):
        return super().times(key)[::-1]


class TooFew(Memory):
    def frames(self, key):
        found = super().frames(key)
        return None if found is None else ArrayFrames(found.read([0, 1]))


@pytest.mark.parametrize(
    ("kind", "name", "said"),
    [
        (Unsorted, "keys are names in order", "not sorted"),
        (Silent, "what is not there is a data error", r"array\('no/such/array'\)"),
        (OtherType, "arrays are as described", "uint8, where float32 is said"),
        (Backwards, "arrays are as described", "differs once it is read by itself"),
        (Falling, "times rise", "b/touch: times fall"),
        (TooFew, "frames are pictures", "2 frames of its rows"),
    ],
)
def test_a_fault_is_named(kind, name, said):
    found = failed(kind())
    assert name in found, found
    with pytest.raises(AssertionError, match=said):
        raise AssertionError(found[name])
