from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.touch_and_go import MATERIALS, SOFT, TouchAndGo

from tactileforge.errors import DataError

Make = Callable[..., Any]
TOUCH = "dataset/20220410_031604/gelsight_frame/{:010d}.jpg"
VIEW = "dataset/20220410_031604/video_frame/{:010d}.jpg"


def rows(numbers: range, label: int, more: str = "") -> str:
    return "".join(f"20220410_031604/{i:010d}.jpg,{label}{more}\n" for i in numbers)


@pytest.fixture
def root(tmp_path: Path, make_images: Make, write: Make) -> Path:
    make_images(TOUCH, range(12))
    make_images(VIEW, range(0, 8))  # the film of the camera ends earlier
    write("label.txt", rows(range(2), -1) + rows(range(2, 6), 5) + rows(range(6, 9), 9) + "\n")
    return tmp_path


def test_runs_of_one_label_are_recordings(root: Path, levels: Make) -> None:
    first, second = TouchAndGo(str(root), val=0).recordings("train")
    assert first.key == "touch_and_go/20220410_031604/0000000002"
    assert levels(first.frames) == [2, 3, 4, 5]
    np.testing.assert_allclose(first.times, np.arange(4) / 30)
    assert (first.text, first.labels["label"], first.sensor) == ("touching brick", 5, "gelsight")
    assert levels(second.frames) == [6, 7, 8]
    assert first.no_contact is None, "label.txt names no frame without contact"
    assert levels(first.image) == [2, 3, 4, 5]
    assert levels(second.image) == [6, 7, 7], "the nearest view, where the film is shorter"
    assert len(MATERIALS) == 20


def test_a_gap_in_the_numbers_ends_a_run(root: Path, write: Make) -> None:
    write("label.txt", rows(range(2, 4), 5) + rows(range(6, 9), 5))
    recordings = list(TouchAndGo(str(root), val=0).recordings("train"))
    assert [len(recording.frames) for recording in recordings] == [2, 3]


def test_the_lists_of_anytouch2_name_the_background(root: Path, write: Make, levels: Make) -> None:
    write("train_bg.txt", rows(range(4, 6), 5, ",0000000000.jpg"))
    write("test_bg.txt", rows(range(6, 8), 9, ",0000000099.jpg"))
    data = TouchAndGo(str(root), split="anytouch2-material", val=0)
    (train,), (test,) = data.recordings("train"), data.recordings("test")
    assert (levels(train.no_contact), levels(train.frames)) == ([0], [4, 5])
    assert test.no_contact is None, "a background that is missing is not invented"
    assert levels(test.frames) == [6, 7]


def test_five_materials_are_soft(root: Path, write: Make) -> None:
    assert [MATERIALS.index(name) for name in SOFT] == [7, 8, 9, 11, 13]
    write("label.txt", rows(range(2, 6), 5) + rows(range(6, 9), 9))
    recordings = TouchAndGo(str(root), val=0).recordings("train")
    assert [recording.labels["hardness"] for recording in recordings] == ["hard", "soft"]


def test_rough_lists_have_classes_and_no_caption(root: Path, write: Make) -> None:
    write("train_rough.txt", rows(range(3), 1))
    write("test_rough.txt", rows(range(4, 6), 0))
    data = TouchAndGo(str(root), split="tag-rough", val=0)
    assert data.provides == {"image"}
    (recording,) = data.recordings("train")
    assert (recording.labels, recording.text) == ({"rough": 1.0}, None)


def test_damage(root: Path, write: Make) -> None:
    (root / TOUCH.format(7)).write_bytes(b"no image")
    (root / TOUCH.format(3)).unlink()
    data = TouchAndGo(str(root), val=0)
    with pytest.raises(DataError, match="no recording of touch_and_go for train"):
        list(data.recordings("train"))
    assert "0000000003.jpg" in data.skipped[0]
    assert "0000000007.jpg" in data.skipped[1]
    write("label.txt", "20220410_031604/0000000002.jpg\n")
    with pytest.raises(DataError, match=r"label\.txt, line 1"):
        list(data.recordings("train"))


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(TouchAndGo, root=str(root))
