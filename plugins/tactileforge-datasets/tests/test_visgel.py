from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tactileforge_datasets.visgel import VisGel

Make = Callable[..., Any]


@pytest.fixture
def root(tmp_path: Path, make_images: Make) -> Path:
    make_images("images/touch/object_1/rec_2/frame{:04d}.jpg", range(6))
    make_images("images/vision/object_1/rec_2/frame{:04d}.jpg", range(0, 6, 2), (30, 40))
    make_images("images/touch/rec_3/frame{:04d}.jpg", range(3))
    return tmp_path


def test_sequences(root: Path, levels: Make) -> None:
    first, other = VisGel(str(root), val=0, fps=60).recordings("train")
    assert (first.key, other.key) == ("visgel/object_1/rec_2", "visgel/rec_3")
    assert levels(first.frames) == list(range(6))
    assert first.times[-1] == pytest.approx(5 / 60)
    assert levels(first.no_contact) == [0]
    assert levels(first.image) == [0, 0, 2, 2, 4, 4], "three views of six touches"
    assert other.image is None


def test_a_damaged_sequence_is_named(root: Path) -> None:
    (root / "images/touch/rec_3/frame0001.jpg").write_bytes(b"no image")
    (root / "images/touch/rec_3/._frame0002.jpg").write_bytes(b"left by a file browser")
    data = VisGel(str(root), val=0)
    assert [recording.key for recording in data.recordings("train")] == ["visgel/object_1/rec_2"]
    (line,) = data.skipped
    assert "frame0001.jpg" in line


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(VisGel, root=str(root), val=0.0)
