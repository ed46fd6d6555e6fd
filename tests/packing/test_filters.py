import itertools
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data.batches.clips import Clips
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.labels.align import nearest
from tactileforge.data.shards import shards
from tactileforge.data.shards.index import Index
from tactileforge.packing import Filter, PackOptions, filters, pack
from tactileforge.packing.filters import Numbered

Packed = Callable[..., tuple[Index, dict[str, Recording]]]


def by_formula(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> float:
    """Variance of the Laplacian of the difference of two frames, written out."""
    weights = np.array([0.299, 0.587, 0.114])
    difference = np.rint(after @ weights) - np.rint(before @ weights)
    d = np.pad(difference, 1, mode="reflect")
    laplacian = d[:-2, 1:-1] + d[2:, 1:-1] + d[1:-1, :-2] + d[1:-1, 2:] - 4 * difference
    return float(laplacian.var())


def disk(x: float) -> NDArray[np.uint8]:
    """A bright disk on grey, with its centre at a column."""
    v, u = np.mgrid[:40, :60]
    inside = np.clip(8 - np.hypot(v - 20, u - x), 0, 1)[..., None]
    return (90 + inside * np.array([120, 80, 40])).astype(np.uint8)


@pytest.fixture
def slide() -> Recording:
    """Two seconds at 30 Hz: still, a slide from frame 20 to frame 39, and still again."""
    x = 10 + np.clip(np.arange(60) - 19, 0, 20) * 1.5
    return Recording(
        key="slide",
        sensor="digit",
        frames=ArrayFrames(np.stack([disk(each) for each in x])),
        times=np.arange(60) / 30,
        no_contact=ArrayFrames(disk(-50)[None]),
        force=np.arange(180, dtype=np.float32).reshape(60, 3),
        action=np.arange(60) % 8,
        image=ArrayFrames(np.stack([disk(5 * each) for each in range(6)])),
    )


def numbered(recording: Recording) -> list[Numbered]:
    rows = range(len(recording.frames))
    return list(zip(rows, recording.frames.read(rows), strict=True))


def test_score_is_the_variance_of_the_laplacian_of_the_difference(slide: Recording) -> None:
    values = filters.laplacian_scores(numbered(slide))
    assert np.isnan(values[0])
    frames = slide.frames.read(range(60))
    wanted = [by_formula(*pair) for pair in itertools.pairwise(frames)]
    np.testing.assert_allclose(values[1:], wanted, rtol=1e-5)
    assert {i for i, value in enumerate(values) if value > 0} == set(range(20, 40))
    noise = np.random.default_rng(0).integers(0, 256, (4, 5, 6, 3), np.uint8)  # mean is not 0
    _, *found = filters.laplacian_scores(enumerate(noise))
    np.testing.assert_allclose(found, [by_formula(*pair) for pair in itertools.pairwise(noise)])


def test_all_frames_of_clips_with_a_lively_frame_are_kept() -> None:
    times = np.arange(100) / 30
    scores = np.zeros(100)
    scores[[40, 70]] = 5.0
    clips = [range(end - 6, end + 1, 2) for end in range(6, 100)]  # four frames, 1/15 s apart
    wanted = {row for clip in clips if {40, 70} & set(clip) for row in range(clip[0], clip[-1] + 1)}
    kept = filters.peaks(times, scores.tolist(), span=0.2) >= 5.0
    assert set(np.flatnonzero(kept)) == wanted


@pytest.mark.parametrize("span", [0.0, 0.1, 0.2, 5.0])
def test_frames_are_judged_as_they_come(span: float) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        times = np.cumsum(rng.uniform(0.01, 0.1, 40))
        moves = rng.random(40) < 0.1
        value = np.cumsum(moves) * 9 % 250
        frames = [np.pad(np.full((2, 2, 3), v, np.uint8), ((2, 2), (2, 2), (0, 0))) for v in value]
        stream = list(enumerate(frames))
        wanted = filters.peaks(times, filters.laplacian_scores(stream), span) >= 1.0
        kept = [number for number, _ in filters.select_lively(stream, times, 1.0, span)]
        assert kept == np.flatnonzero(wanted).tolist()


def test_no_more_frames_are_held_than_a_clip_has() -> None:
    alive: list[weakref.ref[NDArray[np.uint8]]] = []
    held = []

    def stream() -> Iterator[Numbered]:
        for number in range(200):
            frame = np.zeros((4, 4, 3), np.uint8)
            alive.append(weakref.ref(frame))
            yield number, frame
            held.append(sum(each() is not None for each in alive))

    assert not list(filters.select_lively(stream(), np.arange(200) / 30, 1.0, 0.2))
    assert 6 <= max(held) <= 6 + 2


def test_sampling_takes_the_frames_nearest_to_the_ticks() -> None:
    steady = np.arange(90) / 30
    np.testing.assert_array_equal(filters.sample_in_time(steady, 0.1), np.arange(0, 90, 3))
    np.testing.assert_array_equal(filters.sample_in_time(steady + 5, 1 / 15), np.arange(0, 90, 2))
    np.testing.assert_array_equal(filters.sample_in_time(steady, 1e-3), np.arange(90))
    for start in (0.05, 7.02, -3.31):  # ticks begin with the recording, whatever its clock says
        found = filters.sample_in_time(steady + start, 0.1)
        np.testing.assert_array_equal(found, np.arange(0, 90, 3))
    jittered = steady + np.random.default_rng(0).uniform(-0.01, 0.01, 90)
    jittered[0] = 0
    np.testing.assert_array_equal(filters.sample_in_time(jittered, 0.1), np.arange(0, 90, 3))
    gap = np.concatenate([steady[:10], steady[:10] + 60])
    assert filters.sample_in_time(gap, 0.1).tolist() == [0, 3, 6, 9, 10, 13, 16, 19]
    assert filters.sample_in_time(np.array([7.0]), 0.1).tolist() == [0]
    assert filters.sample_in_time(np.array([]), 0.1).tolist() == []


@pytest.fixture
def packed(packable: ModuleType, tmp_path: Path) -> Packed:
    """Packs recordings, and reads them again."""

    def run(chosen: Filter, *recordings: Recording) -> tuple[Index, dict[str, Recording]]:
        made = pack(
            packable.Given(*recordings), "x", tmp_path, PackOptions(codec="png", filter=chosen)
        )
        return made, {
            recording.key: recording
            for path in tmp_path.glob("*.tar")
            for recording in shards.read_shard(path)
        }

    return run


@pytest.mark.parametrize("rate", [7, 10, 18, 25, 30, 60, 90])
def test_reach_is_the_length_of_the_clips_that_are_cut(rate: int) -> None:
    times = np.arange(5 * rate) / rate
    recording = Recording(
        key="a",
        sensor="digit",
        frames=ArrayFrames(np.zeros((len(times), 2, 2, 3), np.uint8)),
        times=times,
        no_contact=None,
    )
    clips = Clips([recording], frames=4, spacing=1 / 15, hop=0.1, size=(2, 2))
    rows = clips.rows(3)
    assert filters.reach(times, 0.2) == pytest.approx(times[rows[-1]] - times[rows[0]])


def test_the_moving_part_is_packed_with_its_labels(slide: Recording, packed: Packed) -> None:
    made, by_key = packed(Filter(laplacian=0.5), slide)
    recording = by_key["slide"]
    rows = np.arange(14, 46)  # the slide, and 0.2 s on both sides
    np.testing.assert_array_equal(recording.times, rows / 30)
    np.testing.assert_array_equal(
        recording.frames.read(range(32)), slide.frames.read(rows.tolist())
    )
    np.testing.assert_array_equal(recording.force, slide.force[rows])  # type: ignore[index]
    np.testing.assert_array_equal(recording.action, slide.action[rows])  # type: ignore[index]
    assert recording.no_contact is not None
    statistics = made.statistics["train"]
    assert (statistics["read"], statistics["frames"], statistics["emptied"]) == (60, 32, 0)


def test_camera_views_stay_with_the_frames_they_belong_to(slide: Recording, packed: Packed) -> None:
    _, by_key = packed(Filter(laplacian=0.5), slide)
    recording = by_key["slide"]
    assert recording.image is not None
    assert recording.image_times is not None
    np.testing.assert_array_equal(recording.image.read(range(6)), slide.image.read(range(6)))  # type: ignore[union-attr]
    before = [row * 6 // 60 for row in range(14, 46)]
    assert nearest(recording.image_times, recording.times).tolist() == before


def test_what_never_moves_is_left_out_and_counted(slide: Recording, packed: Packed) -> None:
    still = slide.part(0, 15)
    photo = replace(slide.part(0, 1), key="photo")
    made, by_key = packed(Filter(laplacian=0.5), slide, still, photo)
    assert set(by_key) == {"slide", "photo"}  # a photo has no frame before it
    assert made.statistics["train"]["emptied"] == 1


def test_sampling_comes_before_scores(slide: Recording, packed: Packed) -> None:
    _, by_key = packed(Filter(laplacian=0.5, every=0.1), slide)
    rows = np.arange(0, 60, 3)
    frames = slide.frames.read(rows.tolist())
    moving = [i for i in range(1, 20) if by_formula(frames[i - 1], frames[i]) >= 0.5]
    wanted = rows[moving[0] - 3 : moving[-1] + 4]  # four frames 0.1 s apart are a clip
    np.testing.assert_array_equal(by_key["slide"].times, wanted / 30)


def test_thresholds_may_differ_by_sensor(slide: Recording, packed: Packed) -> None:
    other = replace(slide, key="other", sensor="gelsight")
    _, by_key = packed(Filter(laplacian={"digit": 0.5}), slide, other)
    assert {key: len(recording.times) for key, recording in by_key.items()} == {
        "slide": 32,
        "other": 60,
    }
