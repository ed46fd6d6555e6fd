import pickle
from pathlib import Path

import numpy as np
import pytest
from videos import greys, write_video

from tactileforge.contracts import Frames, FrameSubset, Recording
from tactileforge.data.frames.encoded import Blob, EncodedFrames
from tactileforge.data.frames.lazy import ArrayFrames, ImageFrames, VideoFrames
from tactileforge.data.shards import shards
from tactileforge.errors import DataError
from tactileforge.packing import PackOptions
from tactileforge.packing.plan import plan_pack
from tactileforge.packing.work import ShardNote, make_shard, packed_job


@pytest.fixture
def pixels() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (6, 16, 24, 3), np.uint8)


def lazy_frames(folder: Path, pixels: np.ndarray) -> list[Frames]:
    """The same pictures in every kind of frames of readers."""
    encoded = [shards.encode_image(frame, "png") for frame in pixels]
    paths = [folder / f"{i}.png" for i in range(len(pixels))]
    for path, picture in zip(paths, encoded, strict=True):
        path.write_bytes(picture)
    blobs = [Blob(str(path), 0, path.stat().st_size) for path in paths]
    head = shards.describe_recording(
        Recording(
            key="a",
            sensor="digit",
            frames=ArrayFrames(pixels),
            times=np.arange(6) / 30,
            no_contact=None,
        )
    )
    shards.write_shard(folder / "a.tar", [shards.Packed(head, "png", encoded, [], [])])
    (packed,) = shards.read_shard(folder / "a.tar")
    return [
        ArrayFrames(pixels),
        ImageFrames(paths),
        EncodedFrames("a", blobs),
        packed.frames,
        FrameSubset(ImageFrames(paths), range(6)),
    ]


def test_frames_of_every_kind_travel_to_other_processes(tmp_path: Path, pixels: np.ndarray) -> None:
    for frames in lazy_frames(tmp_path, pixels):
        there = pickle.loads(pickle.dumps(frames))
        np.testing.assert_array_equal(there.read([5, 0]), pixels[[5, 0]])


def test_a_video_travels_while_it_is_open(tmp_path: Path) -> None:
    frames = VideoFrames(write_video(tmp_path / "a.avi", greys(9, 25, (32, 32)), 30))
    seen = frames.read(range(4))
    there = pickle.loads(pickle.dumps(frames.crop((8, 8, 16, 16))))
    np.testing.assert_array_equal(there.read(range(4)), seen[:, 8:24, 8:24])


class OneTouch:
    provides: frozenset[str] = frozenset()

    def __init__(self, frames: Frames) -> None:
        self.frames = frames
        self.skipped: list[str] = []

    def recordings(self, split: str) -> list[Recording]:
        if split == "val":
            return []
        return [
            Recording(
                key="a",
                sensor="digit",
                frames=self.frames,
                times=np.arange(len(self.frames)) / 30,
                no_contact=None,
            )
        ]

    def plot(self, recording: Recording) -> None:
        raise NotImplementedError


def test_every_kind_gives_the_same_shard(tmp_path: Path, pixels: np.ndarray) -> None:
    made = set()
    for number, frames in enumerate(lazy_frames(tmp_path, pixels)):
        out = tmp_path / str(number)
        (job,) = plan_pack(OneTouch(frames), out, PackOptions(codec="png")).jobs  # type: ignore[arg-type]
        ticks: list[tuple[int, int]] = []
        note = make_shard(job, lambda number, done, ticks=ticks: ticks.append((number, done)))
        assert ticks[-1] == (0, 6)
        again = ShardNote.of(job)
        assert again is not None
        assert again.entry is not None
        assert note.entry is not None
        assert again.entry.to_json() == note.entry.to_json()
        assert again.statistics.to_json() == note.statistics.to_json()
        made.add(job.path.read_bytes())
    assert len(made) == 1


def test_frames_that_cannot_travel_are_an_error_that_says_what_to_do(tmp_path: Path) -> None:
    frames = ArrayFrames(np.zeros((2, 4, 4, 3), np.uint8))
    frames.hook = lambda: None  # type: ignore[attr-defined]
    (job,) = plan_pack(OneTouch(frames), tmp_path, PackOptions()).jobs  # type: ignore[arg-type]
    with pytest.raises(DataError, match=r"train-000000\.tar cannot be handed .*processes=1"):
        packed_job(job)


def test_an_error_in_a_reader_names_the_recording(tmp_path: Path) -> None:
    class Broken(ArrayFrames):
        def read(self, indices: object) -> np.ndarray:
            raise ZeroDivisionError

    (job,) = plan_pack(
        OneTouch(Broken(np.zeros((2, 4, 4, 3), np.uint8))), tmp_path, PackOptions()
    ).jobs  # type: ignore[arg-type]
    with pytest.raises(ZeroDivisionError) as caught:
        make_shard(job)
    assert caught.value.__notes__ == [f"while packing a for {job.path}"]
    assert not list(tmp_path.iterdir())
