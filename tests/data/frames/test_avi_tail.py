"""Bytes behind the end of an AVI are counted, and many are refused."""

import os

import pytest

from tactileforge.data.frames import video_index
from tactileforge.data.frames.avi_tail import avi_tail
from tactileforge.errors import DataError


def part(size, said=None):
    return b"RIFF" + (size if said is None else said).to_bytes(4, "little") + bytes(size)


@pytest.mark.parametrize(
    ("raw", "tail"),
    [
        (part(20), 0),
        (part(20) + part(10), 0),  # of OpenDML
        (part(21) + b"\0", 0),  # padded to an even size
        (part(20) + bytes(30), 30),
        (part(20) + part(10) + bytes(7), 7),
        (part(20, 0), 0),  # never finished
        (part(20, 0xFFFFFFFF), 0),
        (part(20, 90), 0),  # cut off
        (b"RIFX" + bytes(30), 0),
        (b"", 0),
    ],
)
def test_the_tail_of_an_avi(raw, tail, tmp_path):
    (tmp_path / "a.avi").write_bytes(raw)
    assert avi_tail(tmp_path / "a.avi") == tail
    (tmp_path / "b.tar").write_bytes(b"tar" + raw + b"more")
    assert avi_tail(tmp_path / "b.tar", 3, len(raw)) == tail
    assert avi_tail(tmp_path / "none.avi") == 0


def test_a_long_tail_is_refused_before_it_is_searched(monkeypatch, tmp_path):
    monkeypatch.setattr(video_index, "_MAX_TAIL", 29)
    (tmp_path / "a.avi").write_bytes(part(20) + bytes(30))
    with pytest.raises(DataError, match=r"a.avi: 30 bytes behind its end; download it again"):
        video_index.open_video(str(tmp_path / "a.avi"))
    inside = video_index.video_inside(str(tmp_path / "a.avi"), 0, 58)
    with pytest.raises(DataError, match="30 bytes behind its end"):
        video_index.open_video(inside)
    with pytest.raises(DataError, match="not a video"):
        video_index.open_video(video_index.video_inside(str(tmp_path / "a.avi"), 0, 57))


def test_a_video_of_a_name_that_is_not_utf_8(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path) + b"/\xff.avi")
    with pytest.raises(DataError, match=r"udcff.avi': its name is not UTF-8; rename the file"):
        video_index.open_video(path)
