"""Words of names: touch, views of a scene, sides, and whose a force is."""

from pathlib import Path

import pytest

from tactileforge.reading import force_of_touch, scene_among, touch_among, touch_of
from tactileforge.reading.series import series_of
from tactileforge.reading.sides import SIDE_NAMES, SIDE_WORDS, SIDES
from tactileforge.reading.trials import trial_of


@pytest.mark.parametrize("side", sorted(SIDES))
def test_each_side_is_known_to_all_readers(side: str) -> None:
    assert trial_of(f"mug_3_{side}") == "mug_3"
    assert SIDE_WORDS.fullmatch(side)
    assert side in SIDE_NAMES
    paths = [Path(f"{name}_{i}.png") for name in (side, "other") for i in range(4)]
    assert [*series_of(paths)] == [side, "other"]
    other = "right" if SIDES[side] != "right" else "left"
    touch = [f"{SIDES[side]}/digit", f"{other}/digit"]
    assert touch_of(f"{side}_force", touch) == touch[:1]


def test_takes_are_no_sides() -> None:
    assert trial_of("mug_a") == "mug_a"
    assert trial_of("mug_first") == "mug_first"


def test_a_force_of_another_side_is_not_of_the_only_touch() -> None:
    assert force_of_touch(["left/digit"], ["right_force"]) == {}
    assert force_of_touch(["left/digit"], ["force"]) == {"left/digit": "force"}
    assert force_of_touch(["left/digit"], ["force"], only=False) == {}


def test_pictures_without_contact_are_neither_touch_nor_scene() -> None:
    assert touch_among(["digit", "digit_background"]) == ["digit"]
    assert touch_among(["digit_background"]) == []
    assert scene_among(["rgb_background", "rgb"]) == "rgb"


def test_a_fixed_view_comes_before_that_of_the_wrist() -> None:
    assert scene_among(["a_wrist", "front", "tactile"]) == "front"
    assert scene_among(["a_wrist", "tactile"]) == "a_wrist"
    assert scene_among(["tactile"]) == ""
