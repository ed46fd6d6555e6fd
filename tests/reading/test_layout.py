from typing import Any

import pytest

from tactileforge.errors import ConfigError
from tactileforge.reading.layout import BackgroundRule, Tile, parse_layout
from tactileforge.reading.layout_keys import FrameTable

VIDEO = {"videos": "*.mp4", "sensor": "digit", "background": {"first": 3}}


def test_the_smallest_layout() -> None:
    layout = parse_layout("cups", VIDEO)
    assert (layout.name, layout.path, layout.globs, layout.each) == (
        "cups",
        ".",
        ("*.mp4",),
        "video",
    )
    assert layout.background == BackgroundRule(None, 3, 0, False)
    assert layout.force is layout.action is layout.object is layout.camera is None
    assert (layout.hold_out, layout.tier, layout.provides) == ("trial", 5, frozenset())


def test_everything_that_it_provides() -> None:
    layout = parse_layout(
        "all",
        VIDEO
        | {
            "force": {"file": "{stem}.csv", "columns": ["a", "b", "c"], "sign": [1, -1, 1]},
            "object": "cup",
            "text": ["{action}", "a cup"],
            "camera": "{stem}.jpg",
        },
    )
    assert layout.provides == {"force", "action", "object", "text", "image"}
    assert layout.action == "force", "actions come from the force where nothing else is said"
    assert layout.force == FrameTable("{stem}.csv", None, ("a", "b", "c"), (1, -1, 1), 0.0)
    assert layout.text == ("{action}", "a cup")


def test_crops_have_sensors_of_their_own() -> None:
    crops = {"l": {"box": [0, 0, 8, 9], "sensor": "gelsight"}, "r": {"box": [8, 0, 8, 9]}}
    layout = parse_layout("grid", VIDEO | {"crops": crops})
    assert layout.crops == {
        "l": Tile((0, 0, 8, 9), "gelsight"),
        "r": Tile((8, 0, 8, 9), "digit"),
    }


@pytest.mark.parametrize(
    ("value", "want"),
    [
        ("none", None),
        ({"first": 2}, BackgroundRule(None, 2, 0, False)),
        ({"last": 2}, BackgroundRule(None, 0, 2, False)),
        ({"median": True}, BackgroundRule(None, 0, 0, True)),
        ({"file": "b.png"}, BackgroundRule("b.png", 0, 0, False)),
        ({"file": "b.mp4", "last": 4}, BackgroundRule("b.mp4", 0, 4, False)),
    ],
)
def test_backgrounds(value: Any, want: BackgroundRule | None) -> None:
    assert parse_layout("x", VIDEO | {"background": value}).background == want


FORCE = {"file": "f.csv", "columns": ["x", "y", "z"]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"videos": None}, r"layout 'x': give one of videos: .* and images"),
        ({"images": "*.png"}, "give one of videos"),
        ({"video": "*.mp4"}, "unknown key of layout 'x' 'video'; did you mean 'videos'"),
        ({"videos": 3}, "videos is 3, which is not of type str"),
        (
            {"background": None},
            r"layout 'x': 'background' is missing; for example background: \{first",
        ),
        ({"background": {}}, "background: .* must be one of"),
        ({"background": {"first": 3, "median": True}}, "background: .* must be one of"),
        ({"background": {"file": "b.png", "median": True}}, "background: .* must be one of"),
        ({"background": {"first": -1}}, "background: .* must be one of"),
        ({"background": {"median": False}}, "background: .* must be one of"),
        ({"background": {"frist": 3}}, "unknown key of layout 'x': background 'frist'.*'first'"),
        ({"background": "first"}, "background: first must be one of"),
        ({"sensor": None}, "layout 'x': sensor is missing"),
        ({"sensor": "digitt"}, "layout 'x', key sensor: unknown sensor 'digitt'.*'digit'"),
        ({"crops": {"a": {"box": [0, 0, 4]}}}, "crops.a.box is .* not of type tuple"),
        ({"crops": {"a": {"box": [0, 0, 4, 4], "sensor": "gelsite"}}}, "unknown sensor 'gelsite'"),
        ({"fps": 0}, "fps is 0.0; give frames per second"),
        ({"tier": 6}, "tier is 6, but must be 1 to 5"),
        ({"licence": "cc by 4.0"}, "layout 'x': licence: .* did you mean 'CC-BY-4.0'"),
        ({"tier": True}, "tier is True, which is not of type int"),
        ({"hold_out": "objects"}, "unknown hold_out 'objects'; did you mean 'object'"),
        ({"hold_out": "{split"}, r"template '\{split'.*write \{column\}"),
        ({"action": "pres"}, "layout 'x': action: unknown action 'pres'; did you mean 'press'"),
        ({"action": "force"}, "force is not given"),
        ({"action": [{"frames": [0, 5], "action": "pull"}]}, "unknown action 'pull'"),
        ({"action": [{"frames": [0], "action": "press"}]}, "frames is .* not of type tuple"),
        ({"action": {"file": "a.csv"}}, "action: 'column' is missing; for example column: action"),
        ({"force": {"file": "f.csv"}}, "force: 'columns' is missing"),
        ({"force": {"columns": ["x", "y", "z"]}}, "force: 'file' is missing"),
        ({"force": FORCE | {"columns": ["z"]}}, "columns are those of x, y and z"),
        (
            {"force": FORCE | {"columns": [None] * 3}},
            r"null to an axis .* \[null, null, fz\]",
        ),
        ({"force": FORCE | {"columns": ["z", "z", None]}}, "give each axis a column of its own"),
        ({"force": FORCE | {"sign": [1, 1]}}, "sign is .* not of type tuple"),
        ({"force": FORCE | {"lag": 1}}, "force: 'lag' is now called 'lag_s'"),
        ({"labels": {"csv": "l.csv"}}, "unknown key of layout 'x': labels 'csv'"),
        ({"labels": "l.csv"}, "labels: expected names and values, found str"),
    ],
)
def test_what_is_wrong_is_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_layout("x", VIDEO | change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({}, "each is missing; give each: touch"),
        ({"each": "frame"}, "unknown each 'frame'"),
        ({"each": "sequence"}, "fps is None; give frames per second"),
    ],
)
def test_images_say_what_each_is(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_layout("x", {"images": "*.png", "sensor": "digit", "background": "none"} | change)


def test_a_layout_is_a_mapping() -> None:
    with pytest.raises(ConfigError, match="layout 'x': expected names and values, found str"):
        parse_layout("x", "videos")


def test_a_slip_in_action_names_the_words_that_are_no_actions() -> None:
    with pytest.raises(ConfigError, match=r"'forces'; did you mean 'force'\? Known:.*none, press"):
        parse_layout("x", VIDEO | {"action": "forces"})


def test_an_unknown_sensor_names_types_alone_and_the_way_to_an_own_one() -> None:
    with pytest.raises(ConfigError, match="tactileforge plugins new sensor NAME") as told:
        parse_layout("x", VIDEO | {"sensor": "softpad"})
    known = str(told.value).partition("Known: ")[2].partition(". ")[0].split(", ")
    assert {"digit", "gelsight_mini"} <= set(known)
    assert not {"replay", "camera", "sim"} & set(known), "they open sensors of any type"
