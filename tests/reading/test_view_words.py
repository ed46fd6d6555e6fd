"""Words of names: touch, views of a scene, sides, and owners of forces."""

from pathlib import Path

import pytest

from tactileforge.reading import force_of_touch, scene_among, touch_among, touch_of
from tactileforge.reading.guessing.view_words import scenes
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


@pytest.mark.parametrize(
    ("names", "left_out"),
    [
        (("images/0", "masks/0"), ["masks/0"]),
        (("train/input/0", "train/target/0"), ["train/target/0"]),
        (("a/0_rgb", "a/0_depth", "a/0_mask"), ["a/0_depth", "a/0_mask"]),
        (("a/rgb_0", "a/depth_0"), ["a/depth_0"]),
        (("digit0_color/0", "digit0_depth/0"), ["digit0_depth/0"]),
        (("a/rectify", "a/difference", "a/depth"), ["a/difference", "a/depth"]),
        (("OG01_rectify", "OG01_depth"), ["OG01_depth"]),
        (("trial_0_cropped", "trial_0_diff"), ["trial_0_diff"]),
        (("trial_0", "trial_0_overlay"), ["trial_0_overlay"]),
        (("gelsight_frame/0", "video_frame/0"), ["video_frame/0"]),
        (("gelsight/0", "d435i/0"), ["d435i/0"]),
        (("mug/0", "rs_d435/0"), ["rs_d435/0"]),
        (("ab/1f455e", "ab/0d455a"), []),  # names without words
        (("data/mug/0", "plots/0", "results/x"), ["plots/0", "results/x"]),
        # objects, and the only pictures there are
        (("mug/0", "target/0", "mask/0"), []),
        (("1/0", "mask/0"), []),
        (("rectify/0", "mug/0"), []),
        (("basement/0", "flat_screw/0", "figure/0"), []),
        (("results/a/0", "results/b/0"), []),
        (("video/0",), []),
        (("depth/0",), []),
        (("mug/vis/0", "mug/video/0"), []),
    ],
)
def test_pictures_of_something_else(names: tuple[str, ...], left_out: list[str]) -> None:
    found = scenes([Path(f"{name}.png") for name in names], Path())
    assert [path.with_suffix("").as_posix() for path in found] == left_out
