from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from tactileforge_inspect.frame_stats import STRIP, amplify, frame_stats

from tactileforge.checks import copies as duplicates
from tactileforge.checks.sample import FRAMES, background_of, changes, evenly
from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.frames.small import shrink

Touch = Callable[..., Recording]


def test_evenly_has_both_ends_and_no_number_twice() -> None:
    assert evenly(1, 24).tolist() == [0]
    assert evenly(5, 24).tolist() == [0, 1, 2, 3, 4]
    assert evenly(101, 3).tolist() == [0, 50, 100]


def test_the_frame_of_contact_is_found(touch: Touch) -> None:
    seen = frame_stats(touch(), strip=True)
    assert len(seen.rows) == FRAMES
    assert seen.rows[seen.change.argmax()] / 30 == pytest.approx(0.8, abs=0.1)
    assert seen.contact == pytest.approx(50, rel=0.25), "near the top of the bump"
    assert seen.ground < 2
    assert seen.saturated == 0
    assert len(seen.strip) == len(seen.strip_difference) == len(seen.strip_rows) == STRIP
    assert seen.strip_rows[0] == 0
    assert seen.strip_rows[-1] == 89
    assert not len(frame_stats(touch()).strip)


def test_a_difference_is_around_mid_grey(touch: Touch) -> None:
    seen = frame_stats(touch())
    assert seen.difference is not None
    assert np.median(seen.difference) == pytest.approx(128, abs=3)
    assert seen.difference.max() == 255
    assert amplify(np.zeros((4, 4, 3), np.float32)).tolist() == np.full((4, 4, 3), 128).tolist()
    assert frame_stats(touch(no_contact=None)).difference is None


def test_few_frames_are_decoded_at_a_time(touch: Touch) -> None:
    base, asked = touch(), list[int]()

    class Spy:
        shape = base.frames.shape

        def __len__(self) -> int:
            return 90

        def read(self, indices: Any) -> Any:
            asked.append(len(indices))
            return base.frames.read(indices)

    frame_stats(touch(frames=Spy(), no_contact=FrameSubset(Spy(), range(90))))
    assert max(asked) <= 8
    assert sum(asked) == 2 * FRAMES - 1 + 15, "each with the next"


def test_large_frames_are_averaged_down() -> None:
    frame = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    small = shrink(frame)
    assert small.shape == (96, 128, 3)
    np.testing.assert_allclose(small, frame.reshape(96, 5, 128, 5, 3).mean((1, 3)), atol=0.51)


def test_the_background_is_the_median(touch: Touch) -> None:
    array = np.full((5, 4, 4, 3), 7, np.uint8)
    array[2] = 200
    still = background_of(touch(frames=ArrayFrames(array), no_contact=ArrayFrames(array)))
    assert still is not None
    assert (still == 7).all()
    assert background_of(touch(no_contact=None)) is None


def test_changes_are_those_of_all_frames(touch: Touch) -> None:
    recording = touch()
    assert recording.no_contact is not None
    pictures = recording.frames.read(range(90)).astype(np.float64)
    still = np.median(recording.no_contact.read(range(3)), axis=0)
    change = pictures - still
    first, last = (
        np.median(change[rows], axis=(1, 2)).mean(0) for rows in (range(5), range(85, 90))
    )
    drift = np.linspace(first, last, 90)[:, None, None]  # of light, which is no touch
    want = np.abs(change - drift).mean((1, 2, 3))
    np.testing.assert_allclose(changes(recording, range(90)), want, rtol=1e-4)


def reencoded(array: Any) -> None:
    for frame in array:
        done, data = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 90])
        assert done
        frame[:] = cv2.imdecode(data, cv2.IMREAD_COLOR)


def test_copies_are_the_same_and_reencoded_ones_nearly(touch: Touch) -> None:
    looks = [
        frame_stats(recording)
        for recording in (
            touch(0),
            touch(1),
            touch(0, key="copy"),
            touch(1, edit=reencoded),
            touch(2),
        )
    ]
    assert duplicates.identical_groups(looks) == [[0, 2]]
    ((i, j, level),) = duplicates.similar_pairs(looks)
    assert (i, j) == (1, 3)
    assert level < duplicates.SIMILAR


def test_recordings_without_contact_are_not_nearly_the_same(touch: Touch) -> None:
    looks = [frame_stats(touch(seed, height=0.0)) for seed in range(3)]
    assert duplicates.similar_pairs(looks) == duplicates.identical_groups(looks) == []
    stills = [frame_stats(touch(seed, count=1)) for seed in (0, 1, 0)]
    assert duplicates.identical_groups(stills) == [[0, 2]]
    assert duplicates.similar_pairs(stills) == []
