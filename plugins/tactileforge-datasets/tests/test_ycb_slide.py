from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tactileforge_datasets.ycb_slide import YcbSlide

from tactileforge.errors import DataError

Make = Callable[..., Any]


@pytest.fixture
def root(tmp_path: Path, make_images: Make) -> Path:
    for i in range(2):
        place = f"real/035_power_drill/dataset_{i}"
        make_images(place + "/frames/frame_{:07d}.jpg", range(9))
    make_images("real/035_power_drill/dataset_0/webcam_frames/frame_{:07d}.jpg", range(4), (60, 80))
    return tmp_path


def test_recordings(root: Path, levels: Make) -> None:
    first, other = YcbSlide(str(root), val=0).recordings("train")
    assert first.key == "ycb_slide/035_power_drill/dataset_0"
    assert (first.object, first.sensor, first.tier) == ("035_power_drill", "digit", 4)
    assert levels(first.frames) == list(range(9))
    assert levels(first.no_contact) == list(range(9)), "the median over the recording"
    assert levels(first.image) == [0, 1, 2, 3], "the camera has fewer frames, all are kept"
    assert other.image is None
    assert levels(first.part(6, 9).image) == [2, 3, 3]


def test_the_backgrounds_of_sparsh(root: Path, make_image: Make, levels: Make) -> None:
    make_image("real/bgs/bg_0.jpg", 25, (24, 32))
    recording = next(iter(YcbSlide(str(root), val=0).recordings("train")))
    assert levels(recording.no_contact) == [25]
    make_image("real/bgs/bg_0.jpg", 25, (30, 32))
    data = YcbSlide(str(root), val=0)
    with pytest.raises(DataError, match="no recording of ycb_slide for train"):
        list(data.recordings("train"))
    assert "bg_0.jpg: the background has 32x30 pixels" in data.skipped[0]


def test_an_empty_recording_is_named(root: Path) -> None:
    (root / "real/035_power_drill/dataset_9/frames").mkdir(parents=True)
    data = YcbSlide(str(root / "real"), val=0)
    assert len(list(data.recordings("train"))) == 2
    assert "dataset_9/frames: no image" in data.skipped[0]


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(YcbSlide, root=str(root))
