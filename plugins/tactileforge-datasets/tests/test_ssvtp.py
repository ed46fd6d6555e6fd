from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tactileforge_datasets.ssvtp import Ssvtp

Make = Callable[..., Any]


@pytest.fixture
def root(tmp_path: Path, make_images: Make, write: Make) -> Path:
    make_images("ssvtp/images_tac/image_{}_tac.jpg", (2, 10, 3))
    make_images("ssvtp/images_rgb/image_{}_rgb.jpg", (2, 10, 77), (60, 60))
    write("ssvtp/text/labels_2.txt", "fabric, ridged, soft\n")
    write("ssvtp/text/labels_10.txt", "\n")
    write("ssvtp/test.csv", 'images_rgb/image_3_rgb.jpg,"smooth"\n')
    return tmp_path


def test_presses(root: Path, levels: Make) -> None:
    first, other = Ssvtp(str(root), val=0).recordings("train")
    assert (first.key, other.key) == ("ssvtp/2", "ssvtp/10")
    assert (levels(first.frames), levels(first.image), first.text) == (
        [2],
        [2],
        "fabric, ridged, soft",
    )
    assert first.no_contact is None
    assert other.text is None
    assert first.times.tolist() == [0]


def test_the_list_of_the_authors_is_the_test(root: Path) -> None:
    (test,) = Ssvtp(str(root)).recordings("test")
    assert test.key == "ssvtp/3"
    assert test.image is None, "press 3 was not photographed"
    everything = Ssvtp(str(root), split="all", val=0).recordings("train")
    assert [recording.key for recording in everything] == ["ssvtp/2", "ssvtp/3", "ssvtp/10"]


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(Ssvtp, root=str(root / "ssvtp"), val=0.0)
