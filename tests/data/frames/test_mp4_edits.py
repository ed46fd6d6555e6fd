"""Videos cut without encoding them anew: an edit list hides the rest."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tactileforge.data.frames.mp4_edits import shown_share
from tactileforge.data.frames.video import VideoFrames
from tactileforge.data.frames.video_index import video_inside

av = pytest.importorskip("av")


def levels(video: VideoFrames, rows: list[int]) -> list[int]:
    """Numbers of the frames as encoded: frame ``i`` has grey level 4 i."""
    return [round(float(frame.mean()) / 4) for frame in video.read(rows)]


def whole(path: Path, b_frames: int = 0) -> Path:
    """60 frames at 30 a second, in one group of pictures."""
    frames: NDArray[np.uint8] = np.zeros((60, 32, 32, 3), np.uint8)
    frames += (4 * np.arange(60, dtype=np.uint8))[:, None, None, None]
    out = av.open(str(path), "w")
    stream = out.add_stream("libx264", rate=30, options={"bf": str(b_frames), "g": "60"})
    stream.height, stream.width, stream.pix_fmt = 32, 32, "yuv420p"
    for frame in frames:
        out.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
    out.mux(stream.encode())
    out.close()
    return path


def cut(path: Path, at: float, to: Path) -> Path:
    """The packets as they are, with times from ``at`` seconds on (negative: later)."""
    source, out = av.open(str(path)), av.open(str(to), "w")
    stream = source.streams.video[0]
    copy = out.add_stream_from_template(stream)
    ticks = round(at / stream.time_base)
    for packet in source.demux(stream):
        if packet.dts is not None:
            packet.pts, packet.dts, packet.stream = packet.pts - ticks, packet.dts - ticks, copy
            out.mux(packet)
    out.close()
    source.close()
    return to


@pytest.mark.parametrize("ending", [".mp4", ".mov"])
def test_hidden_frames_are_no_frames(tmp_path: Path, ending: str) -> None:
    path = cut(whole(tmp_path / "whole.mp4"), 0.5, tmp_path / f"cut{ending}")
    assert shown_share(path) == pytest.approx(0.75, abs=0.01)
    video = VideoFrames(path)
    assert len(video) == 45
    np.testing.assert_allclose(video.times, np.arange(45) / 30, atol=2e-3)
    assert levels(video, [0, 44, 1, 20]) == [15, 59, 16, 35], "also back and forth"


def test_a_cut_video_within_another_file(tmp_path: Path) -> None:
    content = cut(whole(tmp_path / "whole.mp4"), 0.5, tmp_path / "cut.mp4").read_bytes()
    (tmp_path / "a.tar").write_bytes(b"\0" * 512 + content + b"\0" * 512)
    video = VideoFrames(video_inside(str(tmp_path / "a.tar"), 512, len(content)))
    assert (len(video), levels(video, [0, 44])) == (45, [15, 59])


@pytest.mark.parametrize("b_frames", [0, 2])
def test_a_whole_video_keeps_its_frames(tmp_path: Path, b_frames: int) -> None:
    path = whole(tmp_path / "whole.mp4", b_frames)
    assert shown_share(path) == pytest.approx(1, abs=1e-3)
    video = VideoFrames(path)
    assert (len(video), levels(video, [0, 59])) == (60, [0, 59])


def test_a_video_that_begins_later_keeps_its_frames(tmp_path: Path) -> None:
    path = cut(whole(tmp_path / "whole.mp4"), -0.7, tmp_path / "late.mp4")
    video = VideoFrames(path)
    np.testing.assert_allclose(video.times, np.arange(60) / 30, atol=2e-3)
    assert levels(video, [0, 59]) == [0, 59]


def test_a_damaged_table_of_contents_is_left_to_the_decoder(tmp_path: Path) -> None:
    content = whole(tmp_path / "whole.mp4").read_bytes()
    for kind in (b"moov", b"mvhd", b"mdhd", b"elst", b"trak"):
        place = content.index(kind) - 4
        path = tmp_path / f"{kind.decode()}.mp4"
        path.write_bytes(content[:place] + b"\0\0\0\1" + content[place + 4 :])
        assert shown_share(path) == 1
    assert shown_share(tmp_path / "gone.mp4") == 1
