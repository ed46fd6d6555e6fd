from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tactileforge_datasets.touchd_sim import TouchdSim

from tactileforge.contracts import ACTIONS

Make = Callable[..., Any]


@pytest.fixture
def root(tmp_path: Path, make_images: Make, make_image: Make) -> Path:
    for place in (
        "blue_cup/rotate_cw/digit_2",
        "blue_cup/slide_left-2/gelsight_mini",
        "pen/press/dm",
    ):
        make_images(f"{place}/{{}}.png", range(12))
    make_image("blue_cup/rotate_cw/digit_2/background.png", 30, (24, 32))
    return tmp_path


def test_motions(root: Path, levels: Make) -> None:
    data = TouchdSim(str(root), val=0)
    first, other = data.recordings("train")
    assert (first.sensor, other.sensor, first.object) == ("digit", "gelsight_mini", "blue_cup")
    assert levels(first.frames) == list(range(12)), "the background is not a frame"
    assert (levels(first.no_contact), other.no_contact) == ([30], None)
    assert first.text == "{action} blue cup"
    for found, name in ((first, "rotate_cw"), (other, "slide_left")):
        assert found.action is not None
        assert set(found.action) == {ACTIONS.index(name)}
    (line,) = data.skipped
    assert "unknown sensor 'dm'" in line


def test_a_slip_in_a_name_is_named(root: Path) -> None:
    (root / "blue_cup/rotate_cw").rename(root / "blue_cup/rotate_cv")
    data = TouchdSim(str(root), val=0)
    assert len(list(data.recordings("train"))) == 1
    assert "unknown action 'rotate_cv'; did you mean 'rotate_cw'?" in data.skipped[0]


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(TouchdSim, root=str(root), val=0.0)
