import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tactileforge.data import encode_image
from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.data.frames.picture_index import PictureIndex
from tactileforge.datasets import Recordings
from tactileforge.errors import DataError

PICTURES = 120
LAYOUT = {"images": "*/*.png", "each": "sequence", "fps": 30, "sensor": "digit"}
LAYOUT |= {"background": {"first": 1}, "hold_out": "none"}


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """Paths of the pictures that Pillow opens; files count as written long ago."""
    paths: list[str] = []
    open_, clock = Image.open, time.time

    def counted(file: str) -> Image.Image:
        paths.append(str(file))
        return open_(file)

    monkeypatch.setattr(Image, "open", counted)
    monkeypatch.setattr(time, "time", lambda: clock() + 60)
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "cache"))
    return paths


def write(path: Path, size: tuple[int, int] = (6, 8)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encode_image(np.zeros((*size, 3), np.uint8), "png"))


def start(root: Path) -> list[tuple[str, int, tuple[int, int]]]:
    """Name, number of frames and size of each recording, as another process would find them."""
    data = Recordings(str(root), {"x": LAYOUT})
    found = [(one.key, len(one.frames), one.frames.shape) for one in data.recordings("train")]
    assert not list(data.recordings("val"))
    return found


@pytest.fixture
def root(tmp_path: Path) -> Path:
    root = tmp_path / "touches"
    for number in range(PICTURES):
        write(root / f"trial_{number // 60}" / f"{number % 60:04d}.png")
    return root


def test_a_second_start_opens_no_picture(root: Path, opened: list[str]) -> None:
    first = start(root)
    assert len(opened) == PICTURES
    opened.clear()
    assert start(root) == first == [(f"x/trial_{i}", 60, (6, 8)) for i in (0, 1)]
    assert opened == []


def test_changed_new_and_removed_pictures_are_seen(root: Path, opened: list[str]) -> None:
    start(root)
    opened.clear()
    changed, added = root / "trial_0/0007.png", root / "trial_1/0060.png"
    before = changed.stat()
    changed.write_bytes(changed.read_bytes()[:-1] + b"?")  # as many, at the same time by its file
    os.utime(changed, ns=(before.st_atime_ns, before.st_mtime_ns))
    write(added)
    (root / "trial_0/0059.png").unlink()
    assert changed.stat().st_size == before.st_size
    assert start(root) == [("x/trial_0", 59, (6, 8)), ("x/trial_1", 61, (6, 8))]
    assert sorted(opened) == [str(changed), str(added)]


def test_a_picture_of_another_size_is_an_error_at_the_next_start(
    root: Path, opened: list[str]
) -> None:
    start(root)
    write(root / "trial_0/0007.png", (12, 8))
    assert [name for name, *_ in start(root)] == ["x/trial_1"]


@pytest.mark.parametrize(
    "damage", [lambda raw: raw[:-40], lambda raw: b"", lambda raw: raw.replace(b"\6", b"\7")]
)
def test_a_damaged_index_is_written_anew(
    root: Path, opened: list[str], damage: Callable[[bytes], bytes]
) -> None:
    first = start(root)
    [file] = (root.parent / "cache/pictures").iterdir()
    file.write_bytes(damage(file.read_bytes()))
    opened.clear()
    assert start(root) == first
    assert len(opened) == PICTURES
    opened.clear()
    assert start(root) == first
    assert opened == []


def test_pictures_written_a_moment_ago_are_not_kept(
    root: Path, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = time.time
    monkeypatch.setattr(time, "time", lambda: clock() - 60)  # a change might leave no trace
    start(root)
    assert not (root.parent / "cache").exists()


def test_without_a_cache_pictures_are_read_each_time(
    root: Path, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (root.parent / "taken").touch()
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(root.parent / "taken"))
    assert start(root) == start(root)
    assert len(opened) == 2 * PICTURES


def test_processes_that_write_at_once_keep_what_each_read(root: Path, opened: list[str]) -> None:
    paths = [str(path) for path in sorted(root.glob("*/*.png"))]
    for number in range(100):
        write(root / f"trial_2/{number:04d}.png")
    more = [str(path) for path in sorted(root.glob("trial_2/*.png"))]
    one, other = PictureIndex(root), PictureIndex(root)
    ImageFrames(paths, index=one)
    ImageFrames(more, index=other)
    one.save()
    other.save()
    opened.clear()
    ImageFrames([*paths, *more], index=PictureIndex(root))
    assert opened == []


def test_all_indices_have_a_limit(
    root: Path, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactileforge.data.frames.picture_index._MOST_BYTES", 6000)
    for name in ("trial_0", "trial_1"):
        for number in range(60, 140):
            write(root / name / f"{number:04d}.png")
    names = []
    for folder in (root, root / "trial_0", root / "trial_1"):
        index = PictureIndex(folder)
        ImageFrames([str(path) for path in folder.rglob("*.png")], index=index)
        index.save()
        names.append({path.name for path in (root.parent / "cache/pictures").iterdir()})
    assert len(names[0]) == 1
    assert not names[0] & names[2]  # the longest unused goes first
    assert sum(path.stat().st_size for path in (root.parent / "cache/pictures").iterdir()) <= 6000


def test_what_decoding_finds_counts(root: Path, opened: list[str]) -> None:
    index, path = PictureIndex(root), root / "trial_0/0007.png"
    frames = ImageFrames(sorted(str(each) for each in root.glob("*/*.png")), index=index)
    write(path, (12, 8))
    with pytest.raises(DataError, match=r"0007\.png: its size has changed to 8x12 pixels"):
        frames.read([7])
