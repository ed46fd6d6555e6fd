"""Every key of every format is of one vocabulary; run as a script, this writes the page's table."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from tactileforge.errors import ConfigError
from tactileforge.reading import NOTIONS, parse_layout
from tactileforge.reading.layout_keys import LayoutKeys
from tactileforge.reading.vocabulary import RENAMED

PAGE = Path(__file__).parents[2] / "docs/data.md"
#: Options of data sets that are not keys of what is in files.
OPTIONS = {"root", "val"}


def nested(hint: Any) -> Iterator[type]:
    """Dataclasses in a type; the names of splits are not keys."""
    if is_dataclass(hint) and isinstance(hint, type):
        yield hint
    for inner in get_args(hint):
        yield from nested(inner)


def keys_of(schema: type) -> set[str]:
    """Keys of a schema, at any depth."""
    found, rest = set(), [schema]
    while rest:
        kind = rest.pop()
        found |= {one.name for one in fields(kind)}
        hints = get_type_hints(kind)
        for one in fields(kind):
            if one.name != "splits":
                rest += nested(hints[one.name])
    return found


def lerobot_keys() -> set[str]:
    """Options of LeRobot sets; ``force_unit`` is ``unit`` of ``force``."""
    from tactileforge_lerobot.dataset import LeRobot

    given = {*inspect.signature(LeRobot).parameters} - OPTIONS
    return {name.removeprefix("force_") for name in given}


def schemas() -> dict[str, set[str]]:
    """Keys by format."""
    datasets = pytest.importorskip("tactileforge_datasets.samples.layout")
    episodes = pytest.importorskip("tactileforge_episodes.map_keys")
    rosbags = pytest.importorskip("tactileforge_rosbags.map_keys")
    pytest.importorskip("tactileforge_lerobot")
    return {
        "folders": keys_of(LayoutKeys),
        "tars": keys_of(datasets.SampleLayout),
        "arrays": keys_of(episodes.EpisodeMap),
        "bags": keys_of(rosbags.BagMap),
        "LeRobot": lerobot_keys(),
    }


def table() -> str:
    """The vocabulary as a table of the page."""
    found = schemas()
    rows = ["| key | meaning | of |", "|---|---|---|"]
    for name, meaning in NOTIONS.items():
        there = [form for form, keys in found.items() if name in keys]
        rows.append(f"| `{name}` | {meaning} | {'all' if len(there) == 5 else ', '.join(there)} |")
    return "\n".join(rows)


def test_every_key_is_of_the_vocabulary_and_every_notion_is_a_key() -> None:
    found = schemas()
    unknown = {name: sorted(keys - {*NOTIONS}) for name, keys in found.items()}
    assert unknown == {name: [] for name in found}
    assert sorted({*NOTIONS} - {name for keys in found.values() for name in keys}) == []


def test_what_formats_share_has_one_meaning_and_one_check() -> None:
    """`channels`, `rotate` and `mirror`, and `unit` and `sign` of force, are of one class."""
    found = schemas()
    for name in ("channels", "rotate", "mirror", "unit", "sign", "tracks", "camera"):
        assert all(name in keys for keys in found.values()), name
    old = {"colours", "exchanged", "turns", "lag", "split", "force_unit", "time", "image", "wrench"}
    assert {name: sorted(keys & old) for name, keys in found.items()} == {
        name: [] for name in found
    }


@pytest.mark.parametrize("old", RENAMED)
def test_new_names_are_of_the_vocabulary(old: str) -> None:
    assert {*RENAMED[old]} <= {*NOTIONS}


LAYOUT = {"videos": "*.mp4", "sensor": "digit", "background": "none"}
FORCE = {"file": "f.csv", "columns": ["x", "y", "z"]}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"split": "object"}, r"'split' is now called 'hold_out' \(train is none, val is all\)"),
        ({"image": "{stem}.png"}, "'image' is now called 'camera'"),
        ({"colours": "bgr"}, r"'colours' is now called 'channels' \(rgb or bgr\)"),
        ({"turns": 1}, r"'turns' is now called 'rotate' \(degrees, clockwise: one turn is 270\)"),
        ({"force": FORCE | {"force_unit": "mN"}}, "force: 'force_unit' is now called 'unit'"),
        ({"force": FORCE | {"time": "t"}}, "force: 'time' is now called 'times'"),
        ({"force": FORCE | {"unit": "ms"}}, "unit is that of the force, and ms is one of time"),
        ({"rotat": 90}, "unknown key of layout 'x' 'rotat'; did you mean 'rotate'"),
    ],
)
def test_a_former_name_is_an_error_that_says_the_name_of_today(
    change: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        parse_layout("x", LAYOUT | change)


def test_the_table_of_the_page_is_that_of_the_schemas() -> None:
    assert table() in PAGE.read_text("utf-8"), "run python tests/reading/test_vocabulary.py"


if __name__ == "__main__":
    text = PAGE.read_text("utf-8")
    PAGE.write_text(
        re.sub(r"\| key \| meaning \|.*?(?=\n\n)", lambda _: table(), text, count=1, flags=re.S)
    )
