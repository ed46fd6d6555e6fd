from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from tactileforge.contracts import NEUTRAL_BACKGROUND, Recording
from tactileforge.data.batches.clips import Clips, collate, object_id
from tactileforge.errors import ConfigError, DataError


class Counted:
    """Frames with their number as pixels; remembers the decoded ones."""

    def __init__(self, count: int, broken: bool = False, size: tuple[int, int] = (12, 16)) -> None:
        self.count, self.broken, self.size = count, broken, size
        self.decoded: list[int] = []

    def __len__(self) -> int:
        return self.count

    @property
    def shape(self) -> tuple[int, int]:
        return self.size

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        if self.broken:
            raise DataError("broken.mp4: cannot be decoded")
        self.decoded += indices
        frames = [np.full((*self.size, 3), i % 256, np.uint8) for i in indices]
        return np.stack(frames)


def recording(count: int = 40, fps: float = 30.0, **options) -> Recording:
    values = {
        "key": "r",
        "sensor": "digit",
        "frames": Counted(count),
        "times": np.arange(count) / fps,
        "no_contact": None,
    }
    return Recording(**(values | options))


def clips(*recordings: Recording, **options) -> Clips:
    values = {"frames": 4, "spacing": 1 / 15, "hop": 0.2, "size": (8, 8)}
    return Clips(recordings, **(values | options))


@pytest.mark.parametrize(
    ("fps", "stride"), [(30, 2), (18, 1), (18.75, 1), (25, 2), (60, 4), (10, 1), (90, 6)]
)
def test_clips_are_cut_by_time(fps: float, stride: int) -> None:
    """The paper: every second frame at 30 Hz, every frame at about 18 Hz."""
    cut = clips(recording(200, fps))
    rows = cut.rows(len(cut) - 1)
    assert np.diff(rows).tolist() == [stride] * 3
    assert cut.rows(0).tolist() == [0, stride, 2 * stride, 3 * stride]


def test_neighbouring_clips_are_a_hop_apart() -> None:
    cut = clips(recording(61, 30.0), hop=0.5)
    assert cut.index[:, 1].tolist() == [6, 21, 36, 51]


@pytest.mark.parametrize("rates", [(30, 30, 15), (15, 30, 15)])
def test_clips_last_as_long_where_the_rate_varies(rates: tuple[int, ...]) -> None:
    """As with a camera of automatic exposure in the dark."""
    steps = np.concatenate([np.full(5 * rate, 1 / rate) for rate in rates])
    times = np.concatenate([[0.0], np.cumsum(steps)])
    cut = clips(recording(len(times), times=times))
    rows = np.stack([cut.rows(i) for i in range(len(cut))])
    starts, ends = times[rows[:, 0]], times[rows[:, -1]]
    np.testing.assert_allclose(ends - starts, 0.2, atol=1 / 30 + 1e-9)
    assert ends[0] < 0.5
    assert np.diff(ends).max() < 0.5
    assert ends[-1] > 14.5


def test_no_clip_spans_a_gap() -> None:
    times = np.arange(60) / 30
    times[30:] += 5.0
    cut = clips(recording(60, times=times), hop=1 / 30)
    for clip in range(len(cut)):
        rows = cut.rows(clip)
        assert times[rows[-1]] - times[rows[0]] < 0.3
    assert cut.index[:, 1].max() == 59


def test_a_recording_shorter_than_a_clip_repeats_its_first_frame() -> None:
    cut = clips(recording(4, 30.0), recording(1, key="still"))
    assert [cut.rows(i).tolist() for i in range(len(cut))] == [[0, 0, 1, 3], [0, 0, 0, 0]]


def test_a_clip_carries_everything_its_recording_has() -> None:
    force = np.arange(120, dtype=np.float32).reshape(40, 3)
    action = np.zeros(40, np.int64)
    action[20:] = 1
    given = recording(
        force=force,
        action=action,
        object="ball",
        text="{action} a ball",
        image=Counted(4, size=(20, 30)),
    )
    cut = clips(given, image_size=10)
    row = cut[2]  # ends at frame 18
    assert row["frames"].shape == (4, 3, 8, 8)
    assert row["frames"][:, 0, 0, 0].tolist() == [12, 14, 16, 18]
    np.testing.assert_array_equal(row["force"], force[[12, 14, 16, 18]])
    assert row["force_valid"].tolist() == [True] * 3
    assert row["force_scale"].tolist() == pytest.approx([5.25, 10.61, 14.14])
    assert (row["action"], row["text"]) == (0, "{action} a ball")
    assert row["object"] == object_id("ball") == cut[0]["object"] >= 0
    assert object_id("bell") != object_id("ball")
    assert row["image"].shape == (3, 10, 10)
    assert row["image"][0, 0, 0] == 1  # frame 18 of 40 is 1 of 4
    assert cut[3]["action"] == -1  # ends at 24, begins at 18: two actions
    assert (row["background"] == NEUTRAL_BACKGROUND).all()


def test_the_camera_view_is_the_nearest_in_time() -> None:
    times = np.array([0.0, 0.1, 0.5, 0.59, 1.3])
    cut = clips(recording(image=Counted(5), image_times=times))
    ends = [cut.rows(clip)[-1] / 30 for clip in range(len(cut))]  # 0.2, 0.4, 0.6, ...
    seen = [int(cut[clip]["image"][0, 0, 0]) for clip in range(len(cut))]
    assert seen == [int(np.abs(times - end).argmin()) for end in ends]
    assert seen[:3] == [1, 2, 3]


def test_an_unlabelled_recording_says_so() -> None:
    row = clips(recording())[0]
    assert row["force_valid"].tolist() == [False] * 3
    assert not row["image_valid"]
    assert (row["action"], row["object"], row["text"]) == (-1, -1, "")


def test_one_unlabelled_frame_makes_a_clip_unlabelled() -> None:
    force = np.zeros((40, 3), np.float32)
    force[12] = np.nan
    cut = clips(recording(force=force))
    assert [cut[i]["force_valid"].all().item() for i in range(4)] == [True, False, False, True]


def test_a_force_along_one_axis_is_a_label_of_that_axis() -> None:
    force = np.ones((40, 3), np.float32)
    force[:, :2] = np.nan
    row = clips(recording(force=force))[0]
    assert row["force_valid"].tolist() == [False, False, True]
    assert row["force"].tolist() == [[0, 0, 1]] * len(row["force"])


def test_the_background_is_the_median_of_the_no_contact_frames() -> None:
    assert (clips(recording(no_contact=Counted(5)))[0]["background"] == 2).all()


def test_a_background_of_another_size_is_named_and_skipped() -> None:
    bad = recording(no_contact=Counted(1, size=(3, 3)), key="bad")
    row = clips(bad, recording(key="good"))[0]
    assert "bad: the background is (3, 3), the frames are (12, 16)" in row["skipped"]["bad"][0]


def test_a_corrupt_recording_is_replaced_and_listed() -> None:
    cut = clips(recording(frames=Counted(40, broken=True)), recording(frames=Counted(40)))
    batch = collate([cut[(0, 3)], cut[(7, 3)]])
    assert batch["skipped"] == {"r": ("broken.mp4: cannot be decoded", 1)}
    assert batch["group"].tolist() == [-1, 3]  # the replacement is not what was paired
    assert batch["frames"].shape == (2, 4, 3, 8, 8)


def test_when_nothing_can_be_read_it_is_an_error() -> None:
    cut = clips(*[recording(frames=Counted(40, broken=True))] * 30)
    with pytest.raises(DataError, match=r"20 recordings in a row.*broken\.mp4"):
        cut[0]


def test_nothing_is_decoded_that_no_clip_asks_for() -> None:
    frames = Counted(400)
    cut = clips(recording(400, frames=frames))
    cut.labels()
    assert frames.decoded == []
    cut[5], cut[5], cut[9]
    assert frames.decoded == sorted({*cut.rows(5).tolist(), *cut.rows(9).tolist()})


def test_arrays_of_one_kind_are_dropped_alone() -> None:
    cut = clips(recording())
    for kind in ("image", "frames"):
        cut._cache.put((kind, 0), np.zeros(10, np.uint8))
    cut._cache.clear("image")
    assert list(cut._cache.items) == [("frames", 0)]
    assert cut._cache.size == 10


def test_the_cache_is_bounded() -> None:
    frames = Counted(4000)
    limit = 100 * 8 * 8 * 3
    cut = clips(recording(4000, frames=frames), cache_mb=limit / 2**20)
    for clip in range(len(cut)):
        cut[clip]
    assert cut._cache.size <= limit
    assert sum(item.nbytes for item in cut._cache.items.values()) == cut._cache.size


def test_an_unknown_sensor_is_named() -> None:
    with pytest.raises(ConfigError, match="did you mean 'digit'"):
        clips(recording(sensor="digitt"))


def test_nothing_to_cut_is_an_error() -> None:
    with pytest.raises(DataError, match="no recording"):
        clips()
