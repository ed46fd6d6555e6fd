"""Options read from source equal those of the imported class."""

from inspect import Parameter
from typing import Any

import pytest

from tactileforge.plugins import registry
from tactileforge.plugins.source_options import read_attribute, read_hints, read_options
from tactileforge.util import strict

PLUGINS = [
    (one.kind, one.name, one.target)
    for one in registry.list_plugins()
    if one.kind in registry.KINDS and one.status == "ok"
]


def test_they_are_the_same_as_those_of_the_class_for_every_plugin():
    read = 0
    for kind, name, target in PLUGINS:
        plugin = registry.get(kind, name)
        expected = registry.parameters(plugin)
        assert registry.options(kind, name) == expected, name
        assert list(registry.options(kind, name)) == list(expected), name
        said, found = strict.arguments(plugin), registry.meanings(kind, name)
        assert {key: found.get(key) for key in expected} == {k: said.get(k) for k in expected}
        read += read_options(target) is not None
    assert read > len(PLUGINS) / 2, "most are plain"


SOURCE = """
from elsewhere import FAR
SIZE = 3
TWICE = 1
TWICE = 2

class Plain:
    def __init__(self, a, b=SIZE, *, c=(1, -2), d=1 / 4, e=None, **more): ...

class Below(Plain):
    pass

class Bare:
    pass

class Computed:
    def __init__(self, a=max(1, 2)): ...

class Unclear:
    def __init__(self, a=TWICE): ...

@decorated
class Decorated:
    def __init__(self, a=1): ...

class Wrapped:
    @wrap
    def __init__(self, a=1): ...
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "of_source.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    return "of_source"


def test_literals_and_names_of_literals_are_read_without_an_import(module):
    found = read_options(f"{module}:Plain")
    assert found is not None
    assert found.pop("a") is Parameter.empty
    assert found == {"b": 3, "c": (1, -2), "d": 0.25, "e": None}
    assert read_options(f"{module}:Below") == read_options(f"{module}:Plain")
    assert read_hints(f"{module}:Below") == dict.fromkeys(("self", *"abcde"), Any)
    assert read_hints(f"{module}:Bare") == {}


@pytest.mark.parametrize("name", ["Computed", "Unclear", "Decorated", "Wrapped", "Absent"])
def test_all_else_is_left_to_an_import(module, name):
    assert read_options(f"{module}:{name}") is None


@pytest.mark.slow
def test_help_and_a_configuration_are_shown_without_torch(lightly):
    assert "max_steps" in lightly(["train", "--help"], "torch lightning")
    assert "tactile_vit" in lightly(["train", "--cfg", "job"], "torch lightning")
    assert "train" in lightly(["--help"], "torch numpy hydra")


def test_an_attribute_of_a_class_is_read_by_its_name():
    where = "tactileforge.objectives.match:Match"
    assert read_attribute(where, "head") == "match"
    assert read_attribute(where, "pairs") is True
    assert read_attribute(where, "needs") is None, "no literal"
    assert read_attribute(where, "absent") is None
    assert read_hints(where) == {"self": Any, "of_object": float, "of_action": float}
