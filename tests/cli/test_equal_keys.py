"""Two classes of one name in a list: each key is of one of them, so the other would be lost."""

import re

import pytest

from tactileforge import cli, compose
from tactileforge.errors import ConfigError, PluginError
from tactileforge.verbs import words

GOAL = """
from lightning.pytorch.callbacks import Callback


class Pixel:
    head, needs = "pixel", frozenset()

    def forward(self, prediction, batch): ...


class Goal(Pixel): ...


class Say(Callback): ...


class Dust:
    def __call__(self, batch):
        return batch
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with both modules, the same for all tests: a module is imported once."""
    made = tmp_path_factory.mktemp("equal")
    (made / "equal_one.py").write_text(GOAL)
    (made / "equal_two.py").write_text(GOAL)
    return made


@pytest.fixture(autouse=True)
def _here(folder, monkeypatch):
    monkeypatch.chdir(folder)


@pytest.mark.parametrize(
    ("word", "key", "fix"),
    [
        (
            "objective=[pixel,./equal_one.py:Goal,./equal_two.py:Goal]",
            "objective.goal",
            "+objective@objective.second=./equal_two.py:Goal",
        ),
        (
            "objective=[pixel,equal_one:Goal,./equal_one.py:Goal]",
            "objective.goal",
            "+objective@objective.second=./equal_one.py:Goal",
        ),
        (
            "objective=[pixel,equal_one:Pixel]",
            "objective.pixel",
            "+objective@objective.second=equal_one:Pixel",
        ),
        (
            "callbacks=[equal_one:Say,./equal_two.py:Say]",
            "callbacks.say",
            "+callbacks@callbacks.second=./equal_two.py:Say",
        ),
        (
            "augment.also=[equal_one:Dust,equal_two:Dust]",
            "augment.also.dust",
            "augment.also={dust: {name: equal_one:Dust}, second: {name: equal_two:Dust}}",
        ),
        (
            "augment.also=[equal_one:Dust,equal_one:Dust]",
            "augment.also.dust",
            "augment.also={dust: {name: equal_one:Dust}, second: {name: equal_one:Dust}}",
        ),
    ],
)
def test_two_classes_with_one_key_are_refused(word, key, fix):
    with pytest.raises(PluginError, match=re.escape(f"would both be {key}: ")) as error:
        compose("mae", ["scale=demo", word])
    assert str(error.value).endswith(fix)
    # what it says to type is taken
    first = word.rpartition(",")[0] + "]"
    compose("mae", ["scale=demo", *([fix] if "also" in word else [first, fix])])


def test_a_list_in_yaml_too(tmp_path):
    (tmp_path / "own" / "recipe").mkdir(parents=True)
    (tmp_path / "own" / "recipe" / "two.yaml").write_text(
        "# @package _global_\ndefaults: [mae, "
        '{override /objective: ["equal_one:Goal", "equal_two:Goal"]}, _self_]\n'
    )
    place = f"hydra.searchpath=[file://{(tmp_path / 'own').as_posix()}]"
    with pytest.raises(PluginError, match=r"would both be objective\.goal"):
        compose("two", [place])


@pytest.mark.parametrize("shown", [["--cfg", "job"], ["hydra.run.dir=run"]])
def test_the_command_line_says_so_in_one_line(shown, capsys):
    goals = "objective=[pixel,equal_one:Goal,equal_two:Goal]"
    assert cli.run(["train", "scale=demo", "debug=steps", goals, *shown]) == 1
    said = capsys.readouterr().err
    assert "would both be objective.goal" in said
    assert "\n" not in said.strip()


def test_one_callback_twice_is_refused():
    with pytest.raises(ConfigError, match=r"early_stopping twice.*\+callbacks@callbacks.second="):
        cli._words.read(["callbacks=[early_stopping,early_stopping]"])
    assert words([], {"callbacks": ["a", "a"]}) == ["callbacks=[a,a]"]
