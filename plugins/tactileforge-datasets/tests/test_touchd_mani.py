import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.touchd_mani import TouchdMani

from tactileforge.errors import DataError

Make = Callable[..., Any]
EPISODE = {
    "task": "insert a usb plug",
    "object": "usb_plug",
    "fps": 15,
    "fingers": {"left": "digit", "right": "gelsight_mini"},
}


@pytest.fixture
def root(tmp_path: Path, make_images: Make, make_image: Make, write: Make) -> Path:
    make_images("usb/7/left/{}.png", range(5))
    make_images("usb/7/right/{}.png", range(3))
    make_images("usb/7/camera/{}.png", range(4), (60, 80))
    make_image("usb/7/left_background.png", 30, (24, 32))
    write("usb/7/episode.json", json.dumps(EPISODE))
    return tmp_path


def test_episodes(root: Path, levels: Make) -> None:
    left, right = TouchdMani(str(root), val=0).recordings("train")
    assert (left.key, left.sensor, right.sensor) == (
        "touchd_mani/usb/7/left",
        "digit",
        "gelsight_mini",
    )
    assert (left.text, left.object, left.tier) == ("insert a usb plug", "usb_plug", 2)
    assert (levels(left.frames), levels(left.image)) == ([0, 1, 2, 3, 4], [0, 1, 2, 3])
    np.testing.assert_allclose(left.times, np.arange(5) / 15)
    assert levels(left.no_contact) == [30]
    assert right.no_contact is None


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"fingers": None}, "fingers is None"),
        ({"fps": 0}, "fps is 0"),
        ({"task": 3}, "task is 3"),
    ],
)
def test_a_bad_episode_is_named(root: Path, write: Make, change: dict[str, Any], what: str) -> None:
    write("usb/8/episode.json", json.dumps(EPISODE | change))
    write("usb/9/episode.json", "no JSON")
    data = TouchdMani(str(root), val=0)
    assert len(list(data.recordings("train"))) == 2
    assert what in data.skipped[0]
    assert "usb/9/episode.json: not JSON" in data.skipped[1]


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(TouchdMani, root=str(root), val=0.0)


def test_a_folder_in_the_place_of_an_episode_is_named(root: Path) -> None:
    path = next(root.rglob("episode.json"))
    path.unlink()
    path.mkdir()
    data = TouchdMani(str(root), val=0)
    with pytest.raises(DataError):
        list(data.recordings("train"))
    assert "episode.json: cannot be read (Is a directory)" in data.skipped[0]
