"""An impossible rate is an error; a contradiction of header and stamps is said."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from tactileforge.data.frames.video import VideoFrames
from tactileforge.data.frames.video_clock import rate_doubt, video_times
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataError

av = pytest.importorskip("av")


def write(path: Path, rate: int, stamps: list[int] | None = None) -> Path:
    """A video of 20 frames; ``stamps`` are milliseconds."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("mjpeg" if path.suffix == ".avi" else "ffv1", rate=rate)
        stream.height = stream.width = 32
        stream.pix_fmt = "yuvj420p" if path.suffix == ".avi" else "bgr0"
        for i in range(20):
            frame = av.VideoFrame.from_ndarray(np.full((32, 32, 3), 9 * i, np.uint8), "rgb24")
            if stamps:
                stream.codec_context.time_base = frame.time_base = Fraction(1, 1000)
                frame.pts = stamps[i]
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return path


@pytest.mark.parametrize("rate", [1000, 90000])
@pytest.mark.parametrize("ending", ["avi", "mkv"])
def test_a_rate_that_no_camera_has(tmp_path: Path, rate: int, ending: str) -> None:
    path = write(tmp_path / f"a.{ending}", rate)
    with pytest.raises(DataError, match=r"frames a second \(its header says .*; slower"):
        video_times(VideoFrames(path), "slower")
    layout = {"videos": path.name, "sensor": "digit", "background": "none"}
    data = Recordings(str(tmp_path), {"a": layout}, val=0)
    with pytest.raises(DataError, match=r"a\.[a-z]+: by its time stamps.*layout 'a' .*fps: 30"):
        list(data.recordings("train"))
    (recording,) = Recordings(str(tmp_path), {"a": layout | {"fps": 30}}, val=0).recordings("train")
    np.testing.assert_allclose(recording.times, np.arange(20) / 30)


def test_a_header_that_contradicts_the_stamps(tmp_path: Path) -> None:
    video = VideoFrames(write(tmp_path / "a.mkv", 30, [200 * i for i in range(20)]))
    np.testing.assert_allclose(video_times(video, ""), 0.2 * np.arange(20))
    assert rate_doubt(video).startswith("its header says 30 frames a second, its time stamps 5;")


@pytest.mark.parametrize("rate", [2, 10, 25, 30, 60, 120])
@pytest.mark.parametrize("ending", ["avi", "mkv"])
def test_sane_rates_pass(tmp_path: Path, rate: int, ending: str) -> None:
    video = VideoFrames(write(tmp_path / f"a.{ending}", rate))
    assert len(video_times(video, "")) == 20
    assert rate_doubt(video) == ""


def test_a_rate_that_varies_is_no_contradiction(tmp_path: Path) -> None:
    steps = np.random.default_rng(0).choice([33, 34, 66, 100], 19, p=[0.4, 0.3, 0.2, 0.1])
    stamps = [0, *np.cumsum(steps).tolist()]
    assert rate_doubt(VideoFrames(write(tmp_path / "a.mkv", 30, stamps))) == ""
    gap = [33 * i + 5000 * (i > 9) for i in range(20)]
    assert rate_doubt(VideoFrames(write(tmp_path / "b.mkv", 30, gap))) == ""
