"""Plain data to objects: every key is known, present and of its type."""

from dataclasses import dataclass, field
from typing import Literal

import pytest

from tactileforge.errors import ConfigError
from tactileforge.util import strict


@dataclass(frozen=True)
class Part:
    length: float
    codes: tuple[int, int] = (1, 2)


@dataclass(frozen=True)
class Whole:
    name: str = field(metadata={"example": "ball"})
    part: Part | None = None
    parts: dict[str, Part] = field(default_factory=dict)
    mode: Literal["a", "b"] | None = "a"
    rows: list[list[float]] = field(default_factory=list)


def test_plain_data_becomes_what_the_fields_say() -> None:
    data = {
        "name": "x",
        "part": {"length": 2},
        "parts": {"left": {"length": 0.5, "codes": [3, 4]}},
        "mode": None,
        "rows": [[1, 2]],
    }
    whole = strict.build(Whole, "here", data)
    assert whole == Whole("x", Part(2.0), {"left": Part(0.5, (3, 4))}, None, [[1.0, 2.0]])
    assert isinstance(whole.part, Part)
    assert type(whole.part.length) is float


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({}, r"a/b\.yaml: 'name' is missing; for example name: ball$"),
        ({"name": "???"}, "'name' is missing"),
        ({"nam": "x"}, r"unknown key of a/b\.yaml 'nam'; did you mean 'name'"),
        ({"name": 3}, r"a/b\.yaml: name is 3, which is not of type str"),
        ({"name": "x", "mode": "c"}, r"^a/b.yaml: unknown mode 'c'\. Known: a, b$"),
        ({"name": "x", "part": {}}, r"a/b\.yaml: part: 'length' is missing$"),
        ({"name": "x", "part": {"length": True}}, r"b\.yaml: part\.length is True, .* type float"),
        ({"name": "x", "parts": {"l": {"lenth": 1}}}, r"key of a/b\.yaml: parts\.l 'lenth'"),
        ({"name": "x", "parts": {"l": {"length": 1, "codes": [1]}}}, r"parts\.l\.codes is \[1\]"),
        ({"name": "x", "rows": [[1], ["2"]]}, r"rows is \[\[1\], \['2'\]\], .* list\[list\[float"),
        ("x", r"a/b\.yaml: expected names and values, found str"),
    ],
)
def test_what_is_wrong_is_named(data: object, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        strict.build(Whole, "a/b.yaml", data)


def test_the_command_line_is_told_what_to_give() -> None:
    with pytest.raises(ConfigError, match=r"^give name=\.\.\.$"):
        strict.build(Whole, "", {"part": None})


def test_an_error_repeats_no_page_of_values() -> None:
    with pytest.raises(ConfigError, match=r"\.\.\., which is not of type") as told:
        strict.build(Whole, "here", {"name": list(range(99))})
    assert len(str(told.value)) < 160


def test_types_in_errors_have_no_modules() -> None:
    with pytest.raises(ConfigError, match=r"which is not of type Part \| None$"):
        strict.build(Whole, "here", {"name": "x", "part": 3})


@pytest.mark.parametrize(
    "hint", [Literal["huber", "mse"], Literal["huber"] | Literal["mse"] | None]
)
def test_one_of_a_few_words_is_named_with_the_nearest(hint: object) -> None:
    said = r"^unknown force\.loss 'huberr'; did you mean 'huber'\? Known: huber, mse$"
    with pytest.raises(ConfigError, match=said):
        strict.typed("force.loss", "huberr", hint)
    with pytest.raises(ConfigError, match="not of type"):  # other types are possible
        strict.typed("force.loss", "huberr", Literal["huber"] | int)
