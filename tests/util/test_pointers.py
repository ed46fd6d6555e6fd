from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tactileforge.data.frames.lazy import ImageFrames, VideoFrames
from tactileforge.data.frames.video_index import video_inside
from tactileforge.datasets.recognition import recognise
from tactileforge.datasets.shards import Shards
from tactileforge.errors import DataError
from tactileforge.hub.classify import read_class_head
from tactileforge.hub.header import read_header
from tactileforge.reading import load_pickle, read_cells, read_text
from tactileforge.runs.checkpoint_file import read_checkpoint
from tactileforge.util.pointers import check_pointer, pointer_words
from tactileforge.util.regular import open_regular
from tactileforge.util.untrusted import load_json

LFS = f"version https://git-lfs.github.com/spec/v1\noid sha256:{'4d' * 32}\nsize 12345678\n"
WORDS = "a pointer of Git LFS, not the file: git lfs pull, or download it again"


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("a.mkv", VideoFrames),
        ("a.mp4", VideoFrames),
        ("0.png", lambda path: ImageFrames([path])),
        ("labels.csv", lambda path: read_cells(path, ["file"])),
        ("tactileforge.yaml", read_text),
        ("a.hdf5", open_regular),
        ("a.pkl", load_pickle),
        ("model.safetensors", read_header),
        ("head.safetensors", read_class_head),
        ("last.ckpt", read_checkpoint),
    ],
)
def test_a_pointer_is_named_by_whatever_reads_it(
    tmp_path: Path, name: str, read: Callable[[Path], Any]
) -> None:
    path = tmp_path / name
    path.write_text(LFS)
    with pytest.raises(DataError) as caught:
        read(path)
    assert str(caught.value) == f"{path}: {WORDS}"


def test_a_pointer_in_place_of_a_shard_or_an_unknown_file(tmp_path: Path) -> None:
    path = tmp_path / "train-000000.tar"
    path.write_text(LFS)
    shards = Shards(str(tmp_path))
    assert [*shards.recordings("train")] == []
    assert shards.skipped == [f"{path}: {WORDS}"]
    path.rename(tmp_path / "a.xyz")
    with pytest.raises(DataError, match=r"a\.xyz: a pointer of Git LFS"):
        recognise(tmp_path)


def test_a_pointer_within_another_file(tmp_path: Path) -> None:
    path = tmp_path / "a.tar"
    path.write_bytes(b"\0" * 512 + LFS.encode())
    with pytest.raises(DataError, match="a pointer of Git LFS"):
        VideoFrames(video_inside(str(path), 512, len(LFS)))


def test_other_contents_are_no_pointers(tmp_path: Path) -> None:
    assert pointer_words(b"version 1") == ""
    assert pointer_words(b"/annex/objects/SHA256E-s9--0").startswith("a pointer of git-annex")
    check_pointer(tmp_path / "gone")
    check_pointer(tmp_path)
    with pytest.raises(ValueError, match="pointer of Git LFS"):
        load_json(LFS)
    with pytest.raises(ValueError, match="Expecting value"):
        load_json("x")
