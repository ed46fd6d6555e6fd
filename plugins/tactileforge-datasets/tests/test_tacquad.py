from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.tacquad import TacQuad

from tactileforge.errors import DataError

Make = Callable[..., Any]


@pytest.fixture
def root(tmp_path: Path, make_images: Make, write: Make) -> Path:
    for item in ("indoor/cup", "indoor/shuttlecock", "outdoor/tree_bark"):
        area, name = item.split("/")
        for sensor in ("gelsight", "digit", "duragel"):
            make_images(f"data_{area}/{name}/{sensor}/{{}}.png", range(12))
    make_images("data_indoor/cup/img_digit/{}.png", range(6), (60, 80))
    write("contact_indoor.csv", "cup,4,9,0,11,5,8\nyumaoqiu,4,9,4,9,4,9\n")
    write("contact_outdoor.csv", "tree_bark,4,9,4,9,4,9\n")
    return tmp_path


def test_contacts(root: Path, levels: Make) -> None:
    by_key = {
        recording.key: recording for recording in TacQuad(str(root), val=0).recordings("train")
    }
    assert len(by_key) == 9
    recording = by_key["tacquad/indoor/0_cup/gelsight"]
    assert (recording.sensor, recording.object, recording.text) == (
        "gelsight_mini",
        "indoor/0_cup",
        "{action} cup",
    )
    assert levels(recording.frames) == [4, 5, 6, 7, 8, 9], "both ends are contact"
    assert levels(recording.no_contact) == [0, 1, 2]
    np.testing.assert_allclose(np.diff(recording.times), 1 / 18)
    digit = by_key["tacquad/indoor/0_cup/digit"]
    assert digit.no_contact is None, "the contact begins with the first frame"
    assert digit.object == recording.object, "one object for all sensors"
    assert levels(digit.image) == [t * 6 // 12 for t in range(12)]
    assert recording.image is None
    assert by_key["tacquad/outdoor/0_tree_bark/duragel"].text == "{action} tree bark"


def test_the_item_with_two_names(root: Path, levels: Make) -> None:
    by_key = {
        recording.key: recording for recording in TacQuad(str(root), val=0).recordings("train")
    }
    recording = by_key["tacquad/indoor/1_shuttlecock/digit"]
    assert (recording.object, recording.text) == ("indoor/1_shuttlecock", "{action} shuttlecock")
    assert levels(recording.frames) == [4, 5, 6, 7, 8, 9]
    (root / "data_indoor/shuttlecock").rename(root / "data_indoor/yumaoqiu")
    assert len(list(TacQuad(str(root), val=0).recordings("train"))) == 9


def test_an_item_without_a_folder_is_named(root: Path, write: Make) -> None:
    write("contact_outdoor.csv", "tree_bark,4,9,40,90,4,9\nbench,4,9,4,9,4,9\n")
    data = TacQuad(str(root), val=0)
    assert len(list(data.recordings("train"))) == 6 + 2
    assert "tree_bark/digit: no image from 40 to 90" in data.skipped[0]
    assert "data_outdoor/bench: no such folder" in data.skipped[1]
    write("contact_outdoor.csv", "tree_bark,4,9\n")
    with pytest.raises(DataError, match=r"contact_outdoor\.csv, line 1"):
        list(data.recordings("train"))


def test_a_share_of_the_items_is_held_out(root: Path, write: Make, make_images: Make) -> None:
    sides = {
        side: {recording.object for recording in TacQuad(str(root), val=0.5).recordings(side)}
        for side in ("train", "val")
    }
    assert not sides["train"] & sides["val"], "an item is on one side with all its sensors"
    assert len(sides["train"] | sides["val"]) == 3


def test_of_few_items_one_is_held_out(root: Path) -> None:
    share = 0.001
    assert not any(one.object is None for one in TacQuad(str(root), val=0).recordings("train"))
    sides = {
        side: {recording.object for recording in TacQuad(str(root), val=share).recordings(side)}
        for side in ("train", "val")
    }
    assert (len(sides["train"]), len(sides["val"])) == (2, 1)
    assert not sides["train"] & sides["val"]


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(TacQuad, root=str(root), val=0.0)


def test_an_index_that_is_no_table_is_not_left_out(root: Path) -> None:
    index = root / "contact_outdoor.csv"
    index.write_bytes(b"")
    with pytest.raises(DataError, match=r"contact_outdoor\.csv: empty"):
        list(TacQuad(str(root)).recordings("train"))
    index.unlink()
    index.mkdir()
    with pytest.raises(DataError, match=r"contact_outdoor\.csv: cannot be read"):
        list(TacQuad(str(root)).recordings("train"))
    index.rmdir()
    index.symlink_to("elsewhere.csv")
    with pytest.raises(DataError, match=r"contact_outdoor\.csv: cannot be read"):
        list(TacQuad(str(root)).recordings("train"))
