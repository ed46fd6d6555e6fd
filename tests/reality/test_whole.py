"""Whole pictures: sources and scenes of one kind are not told apart, and others are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from reality.whole import SIDES, VIEWS, WholePictures, statistics, told_apart


def pictures(seed: int, count: int, framed: bool = False) -> WholePictures:
    """Pictures of smooth noise, with or without a dark frame."""
    rng = np.random.default_rng(seed)
    change = rng.normal(0, 60, (count, *SIDES, 3)).astype(np.float32)
    change = np.stack([cv2.GaussianBlur(one, (0, 0), 3) for one in change])
    raw = 100 + change
    if framed:
        for side in (raw[:, :3], raw[:, -3:], raw[:, :, :3], raw[:, :, -3:]):
            side *= 0.3
    return WholePictures(raw, change)


@pytest.mark.slow
@pytest.mark.parametrize("view", VIEWS)
def test_a_frame_tells_raw_pictures_apart_and_no_changes(view: str) -> None:
    train = [pictures(0, 20, framed=True), pictures(1, 50, framed=True)], pictures(2, 60)
    test = pictures(3, 60, framed=True), pictures(4, 60)
    assert told_apart(train, test, "raw", view, steps=60) > 0.95
    assert told_apart(train, test, "change", view, steps=60) == pytest.approx(0.5, abs=0.15)


def test_statistics_do_not_depend_on_the_side_of_a_border() -> None:
    raw = pictures(0, 4, framed=True).raw
    np.testing.assert_allclose(statistics(raw), statistics(raw[:, ::-1, ::-1]), atol=1e-3)
