"""Displacements as images: decoding inverts coding, and a mirrored touch is a mirrored image."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactileforge.data.labels import displacement

MOVED = arrays(np.float32, (5, 6, 3), elements=st.floats(-0.5, 0.5, width=32))


@given(MOVED)
def test_decode_is_within_half_a_level_of_what_was_encoded(moved: np.ndarray) -> None:
    result = displacement.decode_displacement(displacement.encode_displacement(moved))
    # half a level of the root r is 1/254 of it: 2 r / 254 of the range, and (1/254)**2 at 0
    share = np.sqrt(np.abs(moved) / displacement.RANGE_MM)
    bound = np.asarray(displacement.RANGE_MM) * (2 * share + 1 / 254) / 254
    assert (np.abs(result - moved) <= bound + 1e-6).all()


def test_encode_clips_at_the_range() -> None:
    image = displacement.encode_displacement(np.array([[9.0, -9.0, 0.0]], np.float32))
    assert image.tolist() == [[255, 1, 128]]


@pytest.mark.parametrize("axis", [0, 1])
def test_mirrored_is_the_image_of_the_mirrored_displacement(axis: int) -> None:
    moved = np.random.default_rng(0).normal(0, 0.1, (4, 6, 3)).astype(np.float32)
    turned = np.flip(moved, 1 - axis).copy()
    turned[..., axis] *= -1
    given, want = (
        torch.from_numpy(displacement.encode_displacement(field)).movedim(-1, 0)
        for field in (moved, turned)
    )
    assert torch.equal(displacement.mirror_displacement(given, axis), want)


def test_cells_keep_the_aspect() -> None:
    assert displacement.grid_shape(240, 320) == (32, 43)
    assert displacement.grid_shape(320, 240) == (43, 32)
