import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tactileforge_datasets.tvl import Tvl

from tactileforge.errors import DataError

Make = Callable[..., Any]
HEADER = "url,tactile,tactile_background,caption\n"


def row(i: int, caption: str, background: str = "rec_1/bg/0.jpg") -> str:
    return f'rec_1/vision/{i}-0.03.jpg,rec_1/tactile/{i}-0.03.jpg,{background},"{caption}"\n'


@pytest.fixture
def root(tmp_path: Path, make_images: Make, make_image: Make, write: Make) -> Path:
    make_images("hct/data1/rec_1/tactile/{}-0.03.jpg", range(12))
    make_images("hct/data1/rec_1/vision/{}-0.03.jpg", range(12), (60, 80))
    make_image("hct/data1/rec_1/bg/0.jpg", 20, (24, 32))
    make_image("hct/data1/digit_background.png", 30, (24, 32))
    train = "".join(row(i, "smooth, hard" if i < 11 else "soft") for i in (10, 9, 11, 4, 5))
    write("hct/data1/train.csv", HEADER + train)
    write("hct/data1/test.csv", HEADER + row(7, "rough", "rec_1/bg/9.jpg"))
    return tmp_path


def test_runs_of_one_caption(root: Path, levels: Make) -> None:
    recordings = list(Tvl(str(root), val=0).recordings("train"))
    assert [levels(recording.frames) for recording in recordings] == [[4, 5], [9, 10], [11]], (
        "9 before 10"
    )
    assert [recording.text for recording in recordings] == ["smooth, hard", "smooth, hard", "soft"]
    assert recordings[0].key == "tvl/data1/rec_1/train_4"
    assert levels(recordings[1].no_contact) == [20]
    assert recordings[1].image is not None
    assert recordings[1].image.shape == (60, 80)


def test_a_missing_background_is_that_of_the_part(root: Path, levels: Make) -> None:
    (test,) = Tvl(str(root)).recordings("test")
    assert levels(test.no_contact) == [30]
    (root / "hct/data1/digit_background.png").unlink()
    (test,) = Tvl(str(root)).recordings("test")
    assert test.no_contact is None


def test_swapped_folders(root: Path, levels: Make) -> None:
    folder = root / "hct/data1/rec_1"
    (folder / "tactile").rename(folder / "other")
    (folder / "vision").rename(folder / "tactile")
    (folder / "other").rename(folder / "vision")
    recording = next(iter(Tvl(str(root), val=0).recordings("train")))
    assert recording.frames.shape == (24, 32)
    assert recording.image is not None
    assert recording.image.shape == (60, 80)
    assert levels(recording.frames) == levels(recording.image) == [4, 5]


def test_views_as_large_as_touches_are_no_swapped_folders(root: Path, make_images: Make) -> None:
    make_images("hct/data1/rec_1/vision/{}-0.03.jpg", range(12), (24, 32))
    for recording in Tvl(str(root), split="all", val=0).recordings("train"):
        assert "/tactile/" in recording.frames.paths[0]
        assert "/vision/" in recording.image.paths[0]


def test_without_captions(root: Path, write: Make, levels: Make) -> None:
    for name in ("train.csv", "test.csv"):
        (root / "hct/data1" / name).unlink()
    names = [f"{i}-0.03.jpg" for i in (1, 2, 3)]
    lists = {k: [f"rec_1/{k}/{name}" for name in names] for k in ("tactile", "vision")}
    write("hct/data1/contact.json", json.dumps(lists))
    (recording,) = Tvl(str(root), split="all", val=0).recordings("train")
    assert (levels(recording.frames), recording.text) == ([1, 2, 3], None)
    write("hct/data1/contact.json", json.dumps({"tactile": ["rec_1/tactile/1-0.03.jpg"]}))
    with pytest.raises(DataError, match=r"contact\.json: not lists of equal length"):
        list(Tvl(str(root)).recordings("train"))


def test_a_row_that_is_cut_off(root: Path, write: Make) -> None:
    write("hct/data1/train.csv", HEADER + "rec_1/vision/1-0.03.jpg,rec_1/tac\n")
    with pytest.raises(DataError, match=r"train\.csv, line 2: 2 cells"):
        list(Tvl(str(root)).recordings("train"))


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(Tvl, root=str(root), val=0.0)
