from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tactileforge.data.frames.film_streams import count_streams
from tactileforge.data.frames.lazy import VideoFrames
from tactileforge.data.frames.stamp import stamp_of
from tactileforge.datasets import Recordings
from tactileforge.errors import ConfigError, DataError

av = pytest.importorskip("av")

#: Height and width of the pictures of each stream.
SIZES = [(48, 64), (64, 80)]
FRAMES = 24


def film(path: Path, codec: str, pixels: str, count: int = 2) -> NDArray[np.uint8]:
    """A film of several streams of known pictures; those of the last stream."""
    rng = np.random.default_rng(0)
    with av.open(str(path), "w") as out:
        streams = [out.add_stream(codec, rate=30) for _ in range(count)]
        for stream, (height, width) in zip(streams, SIZES, strict=False):
            stream.height, stream.width, stream.pix_fmt = height, width, pixels
        pictures = [rng.integers(0, 255, (FRAMES, s.height, s.width, 3), np.uint8) for s in streams]
        for number in range(FRAMES):
            for stream, frames in zip(streams, pictures, strict=True):
                out.mux(stream.encode(av.VideoFrame.from_ndarray(frames[number], format="rgb24")))
        for stream in streams:
            out.mux(stream.encode())
    return pictures[-1]


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, NDArray[np.uint8]]:
    path = tmp_path_factory.mktemp("films") / "press.mkv"
    return path, film(path, "ffv1", "bgr0")


def test_the_second_stream_is_read_to_the_bit(pair: tuple[Path, NDArray[np.uint8]]) -> None:
    path, pictures = pair
    first, second = VideoFrames(path), VideoFrames(path, stream=1)
    assert (first.shape, second.shape) == (SIZES[0], SIZES[1])
    assert len(second) == FRAMES
    np.testing.assert_allclose(second.times, np.arange(FRAMES) / 30, atol=1e-3)
    for rows in ([23, 0, 7], [7, 8], range(FRAMES)):  # in turn, as clips of both are read
        assert first.read([0]).shape[1:3] == SIZES[0]
        np.testing.assert_array_equal(second.read(rows), pictures[list(rows)])
    assert stamp_of(first) != stamp_of(second)


@pytest.mark.parametrize(
    ("name", "codec", "pixels"),
    [
        ("a.mkv", "ffv1", "bgr0"),
        ("a.avi", "mjpeg", "yuvj420p"),
        ("a.mp4", "mpeg4", "yuv420p"),
        ("a.mov", "mjpeg", "yuvj420p"),
        ("a.webm", "libvpx", "yuv420p"),
    ],
)
@pytest.mark.parametrize("count", [1, 2])
def test_streams_are_counted_in_the_header(
    tmp_path: Path, name: str, codec: str, pixels: str, count: int
) -> None:
    film(tmp_path / name, codec, pixels, count)
    assert count_streams(tmp_path / name) == count
    with (tmp_path / name).open("rb+") as file:
        file.truncate(150)  # its decoder says so
    assert count_streams(tmp_path / name) in (1, count)


def test_a_layout_chooses_a_stream_or_takes_both(pair: tuple[Path, NDArray[np.uint8]]) -> None:
    layout = {"videos": "*.mkv", "sensor": "digit", "background": "none", "hold_out": "none"}

    def found(**keys: object) -> tuple[list[tuple[str, tuple[int, int]]], Recordings]:
        data = Recordings(str(pair[0].parent), {"x": {**layout, **keys}})
        shapes = [(one.key, one.frames.shape) for one in data.recordings("train")]
        return shapes, data

    shapes, data = found()
    assert shapes == [("x/press.mkv", SIZES[0])]
    assert "2 streams of video, of which the first is read; stream: 1" in data.notes[0]
    assert found(stream=1)[0] == [("x/press.mkv", SIZES[1])]
    shapes, data = found(stream={"left": 0, "right": 1}, hold_out="trial")
    assert shapes == [("x/press.mkv#left", SIZES[0]), ("x/press.mkv#right", SIZES[1])]
    assert "2 recordings of 1 trials" in data.held_out[0]
    assert not data.notes


@pytest.mark.parametrize("stream", [-1, {}, {"left": 0, "right": 0}])
def test_streams_that_are_none_are_refused(tmp_path: Path, stream: object) -> None:
    layout = {"videos": "*.mkv", "sensor": "digit", "background": "none", "stream": stream}
    with pytest.raises(ConfigError, match=r"stream is .*; give the number of a stream of videos"):
        Recordings(str(tmp_path), {"x": layout})
    images = {**layout, "images": "*.png", "each": "touch", "videos": None, "stream": 1}
    with pytest.raises(ConfigError, match="stream is 1; give the number"):
        Recordings(str(tmp_path), {"x": images})


def test_a_stream_that_is_not_there_is_named(
    pair: tuple[Path, NDArray[np.uint8]], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DataError, match=r"stream: 2, where the file has 2 of video"):
        VideoFrames(pair[0], stream=2)
    monkeypatch.setattr("tactileforge.data.frames.pyav.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"stream: 1 needs PyAV: pip install .*-map 0:v:1"):
        VideoFrames(pair[0], stream=1)
