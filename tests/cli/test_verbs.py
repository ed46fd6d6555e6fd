"""Verbs of installed packages."""

import json
import sys

import pytest

from tactileforge.cli import run
from tactileforge.cli._complete import complete
from tactileforge.cli._verbs import summary
from tactileforge.testing import check

VERB = '''"""Counts to a number.

More about it.
"""
from dataclasses import dataclass
from tactileforge.plugin import Command

@dataclass(frozen=True, kw_only=True)
class Keys:
    """Numbers.

    Attributes:
        to: Last number.
    """
    to: int = 3

def count(keys, config):
    """Counts, aloud."""
    print(*range(1, keys.to + 1))

COMMANDS = {"": Command(run=count, keys=Keys)}
'''
POINTS = "[tactileforge.verbs]\ncount = counting.verb"
FILES = {"counting/__init__.py": "raise SystemExit('imported')", "counting/verb.py": VERB}


@pytest.fixture(autouse=True)
def _imported_anew():
    yield
    for name in ("counting", "counting.verb"):
        sys.modules.pop(name, None)


@pytest.fixture
def count(installed):
    installed("counting", POINTS, {**FILES, "counting/__init__.py": ""})


def test_its_help_line_is_read_without_importing_it(installed, capsys):
    installed("counting", POINTS, FILES)
    assert run(["--help"]) == 0
    assert "\n  count      Counts to a number.\n" in capsys.readouterr().out


def test_it_runs_and_takes_keys(count, capsys):
    assert run(["count"]) == 0
    assert run(["count", "--to", "2"]) == 0
    assert run(["count", "-m", "to=1,2"]) == 0
    assert capsys.readouterr().out.splitlines() == ["1 2 3", "1 2", "1", "1 2"]


def test_help_cfg_explain_and_completion_know_it(count, capsys):
    assert run(["count", "--help"]) == 0
    assert "Last number" in capsys.readouterr().out
    assert run(["count", "--cfg", "job"]) == 0
    assert "to: 3" in capsys.readouterr().out
    assert run(["count", "--explain", "to"]) == 0
    assert "3" in capsys.readouterr().out
    assert complete("tactileforge cou") == ["count "]
    assert complete("tactileforge count t") == ["to="]


def test_slips_are_named(count, capsys):
    assert run(["coutn"]) == 1
    assert run(["count", "too=3"]) == 1
    said = capsys.readouterr().err
    assert "unknown verb 'coutn'; did you mean 'count'?" in said
    assert "did you mean 'to'?" in said


def test_it_is_listed_and_checked(count, capsys):
    assert run(["plugins", "list", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    row = {"name": "count", "kind": "verb", "target": "counting.verb"}
    assert {**row, "distribution": "counting", "version": "1.0", "status": "ok"} in rows
    assert {result.status for result in check("verb", "count")} == {"ran"}


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("1 / 0", "verb 'count' (counting.verb, from counting 1.0) cannot be loaded: ZeroDivision"),
        ("import sys; sys.exit(3)", "cannot be loaded: SystemExit: 3"),
        ("def (", "cannot be loaded: SyntaxError"),
        ("import no_such_package", "No module named 'no_such_package'"),
        ("", "the module has no COMMANDS"),
        ("COMMANDS = 3", "COMMANDS is not a dict"),
    ],
)
def test_one_that_is_broken_is_named_and_the_others_work(source, said, installed, capsys):
    installed("counting", POINTS, {**FILES, "counting/__init__.py": "", "counting/verb.py": source})
    assert run(["--help"]) == 0
    assert run(["count"]) == 1
    assert said in capsys.readouterr().err
    assert run(["plugins", "list"]) == 0
    assert [result for result in check("verb", "count") if result.status == "failed"]


def test_two_packages_that_claim_one_verb(count, installed, capsys):
    installed("other-counting", POINTS, {})
    assert run(["count"]) == 1
    said = capsys.readouterr().err
    assert "from counting 1.0" in said
    assert "from other-counting 1.0" in said
    assert run(["--help"]) == 0
    assert "count      claimed by several packages" in capsys.readouterr().out


def test_a_built_in_verb_is_not_replaced(installed, capsys):
    modules = {**FILES, "counting/__init__.py": ""}
    installed("counting", "[tactileforge.verbs]\nzoo = counting.verb", modules)
    assert run(["zoo", "list"]) == 0
    assert "anytouch2.tiny" in capsys.readouterr().out
    assert run(["plugins", "list", "--json"]) == 0
    rows = [row for row in json.loads(capsys.readouterr().out) if row["name"] == "zoo"]
    assert [row["status"] for row in rows] == ["conflict"]


def test_a_module_without_source_has_no_line():
    assert summary("no_such_package.verb") == ""
    assert summary("sys") == ""


#: An action of ``data``, by a name with a dot.
ACTION = "[tactileforge.verbs]\ndata.count = counting.verb"


def test_an_action_of_a_verb_is_listed_without_importing_it(installed, capsys):
    installed("counting", ACTION, FILES)
    assert run(["data", "--help"]) == 0
    assert "\n  tactileforge data count      Counts to a number.\n" in capsys.readouterr().out
    assert complete("tactileforge data cou") == ["count "]
    assert run(["--help"]) == 0
    assert "Counts to a number" not in capsys.readouterr().out


@pytest.mark.slow
def test_an_action_of_a_verb_runs_and_its_slips_are_named(installed, capsys):
    installed("counting", ACTION, {**FILES, "counting/__init__.py": ""})
    assert run(["data", "count", "to=2"]) == 0
    assert run(["data", "count", "-m", "to=1,2"]) == 0
    assert run(["data", "count", "--cfg", "job"]) == 0
    assert capsys.readouterr().out.splitlines() == ["1 2", "1", "1 2", "to: 3"]
    assert complete("tactileforge data count t") == ["to="]
    assert run(["data", "cuont"]) == 1
    assert run(["data", "count", "too=3"]) == 1
    said = capsys.readouterr().err
    assert "unknown action of tactileforge data 'cuont'; did you mean 'count'?" in said
    assert "did you mean 'to'?" in said
    assert {result.status for result in check("verb", "data.count")} == {"ran"}


def test_an_action_that_is_broken_is_named_and_the_others_work(installed, capsys):
    installed("counting", ACTION, {"counting/__init__.py": "", "counting/verb.py": "1 / 0"})
    assert run(["data", "count"]) == 1
    said = capsys.readouterr().err
    assert "'data.count' (counting.verb, from counting 1.0) cannot be loaded: ZeroDivision" in said
    assert run(["data", "inspect", "--help"]) == 0
    assert run(["data", "--help"]) == 0


def test_an_action_that_is_there_already_is_not_replaced(installed, capsys):
    installed("counting", ACTION.replace("count =", "pack ="), FILES)
    assert run(["data", "--help"]) == 0
    assert "data pack       Packs recordings into shards" in capsys.readouterr().out
    assert run(["data", "pack", "--help"]) == 0
    assert "Counts" not in capsys.readouterr().out
    assert run(["plugins", "list", "--json"]) == 0
    rows = [row for row in json.loads(capsys.readouterr().out) if row["name"] == "data.pack"]
    assert [row["status"] for row in rows] == ["conflict"]
