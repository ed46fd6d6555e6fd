"""Pipes, devices and links to elsewhere are refused without waiting."""

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from tactileforge.data.frames.film_streams import count_streams
from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.data.frames.stacks import load_array
from tactileforge.errors import DataError
from tactileforge.reading.pickles import load_pickle, load_pickled_array
from tactileforge.reading.sheets import read_sheet
from tactileforge.util.regular import open_regular, read_regular, stays_inside


def test_a_pipe_a_socket_and_a_device_are_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(tmp_path / "socket"))
        for path in (tmp_path / "pipe", tmp_path / "socket", "/dev/zero"):
            with pytest.raises(DataError, match="no regular file"):
                read_regular(path, 10)


def test_a_folder_and_an_absent_file_are_errors_of_the_system(tmp_path):
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)
    with pytest.raises(FileNotFoundError):
        open_regular(tmp_path / "absent", tmp_path)


def test_links_may_stay_inside_but_not_leave_or_loop(tmp_path):
    root = tmp_path / "set"
    root.mkdir()
    (tmp_path / "secret").write_bytes(b"outside")
    (root / "file").write_bytes(b"inside")
    (root / "good").symlink_to("file")
    (root / "bad").symlink_to(tmp_path / "secret")
    (root / "loop").symlink_to("loop")
    assert read_regular(root / "good", 10, root) == b"inside"
    for name in ("bad", "loop"):
        with pytest.raises(DataError, match="a link that loops, or leads out"):
            read_regular(root / name, 10, root)
    assert read_regular(root / "bad", 10) == b"outside"  # what a user names is followed


def test_links_of_a_hugging_face_cache_lead_to_its_blobs(tmp_path):
    home = tmp_path / "datasets--lab--touch"
    folder = home / "snapshots/abc/x.zarr"
    folder.mkdir(parents=True)
    (home / "blobs").mkdir()
    (home / "blobs/1f").write_bytes(b"chunk")
    (folder / "0.0").symlink_to("../../../blobs/1f")
    assert stays_inside(folder / "0.0", folder)
    assert read_regular(folder / "0.0", 10, folder) == b"chunk"


def test_more_than_the_limit_is_refused(tmp_path):
    (tmp_path / "file").write_bytes(b"12345")
    assert read_regular(tmp_path / "file", 5) == b"12345"
    with pytest.raises(DataError, match="more than 4 bytes"):
        read_regular(tmp_path / "file", 4)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("a.png", lambda path: ImageFrames([str(path)]).shape),
        ("a.npy", load_array),
        ("a.npy", load_pickled_array),
        ("a.pkl", load_pickle),
        ("a.npz", read_sheet),
    ],
)
def test_no_reader_waits_for_a_pipe(
    name: str, read: Callable[[Path], object], tmp_path: Path
) -> None:
    path = tmp_path / name
    os.mkfifo(path)
    with pytest.raises(DataError, match=rf"{path}: .*no regular file but a pipe") as said:
        read(path)
    assert "\n" not in str(said.value)
    assert count_streams(path) == 1, "its decoder names it"
