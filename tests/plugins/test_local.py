"""Names of the user's own: imports, refusals, and places of faults."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tactileforge.errors import PluginError
from tactileforge.plugins import local

_TWO = """\
class Tiny:
    pass


class Wide:
    class Inner:
        pass
"""


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory of its own; modules and paths are as before afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(local, "_known", {})
    monkeypatch.setattr(local, "_files", {})
    monkeypatch.setattr(sys, "modules", dict(sys.modules))
    return tmp_path


def test_two_names_of_one_file_are_of_one_module(here: Path) -> None:
    (here / "own_net.py").write_text(_TWO)
    tiny = local.resolve("./own_net.py:Tiny")
    wide = local.resolve(f"{here}/own_net.py:Wide")
    assert sys.modules[tiny.__module__] is sys.modules[wide.__module__]
    assert local.resolve("own_net.py:Wide.Inner") is wide.Inner
    assert local.resolve("own_net:Tiny") is tiny


def test_a_module_of_the_working_directory_is_found(here: Path) -> None:
    (here / "own_package").mkdir()
    (here / "own_package" / "nets.py").write_text(
        "from own_helper import SIZE\nclass Net: n = SIZE"
    )
    (here / "own_helper.py").write_text("SIZE = 3")
    assert local.resolve("own_package.nets:Net").n == 3


def test_a_file_finds_its_neighbours_and_has_a_name_of_its_own(here: Path) -> None:
    for folder, size in (("a", 1), ("b", 2)):
        (here / folder).mkdir()
        (here / folder / "random.py").write_text(f"class Net: n = {size}")
    assert [local.resolve(f"{x}/random.py:Net").n for x in "ab"] == [1, 2]
    assert "seed" in dir(sys.modules["random"])  # Python's own is still in its place
    (here / "a" / "own_side.py").write_text("N = 5")
    (here / "a" / "own_main.py").write_text("from own_side import N\nclass Net: n = N")
    assert local.resolve("a/own_main.py:Net").n == 5


def test_a_file_that_changed_is_read_again(here: Path) -> None:
    (here / "own_net.py").write_text("class Net: n = 1")
    assert local.resolve("./own_net.py:Net").n == 1
    (here / "own_net.py").write_text("class Net: n = 2")
    assert local.resolve("./own_net.py:Net").n == 2


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("own_nett:Tiny", r"encoder=own_nett:Tiny: there is no module 'own_nett' in .*'own_net'\?"),
        ("./own_nett.py:Tiny", r"there is no file ./own_nett.py in .*'own_net.py'\?"),
        (
            "./own_net.py:Tinny",
            r"own_net.py has no 'Tinny'; did you mean 'Tiny'\? Known: Tiny, Wide",
        ),
        ("./own_net.py", r"name a class after a colon: ./own_net.py:MyClass"),
        ("own_net:", r"name a class after a colon: own_net:MyClass"),
        ("./own_bad.py:Net", r"own_bad.py:2: ZeroDivisionError: division by zero"),
        ("own_bad:Net", r"own_bad.py:2: ZeroDivisionError: division by zero"),
        ("own_slip:Net", r"own_slip.py:1: SyntaxError: "),
        ("own_wants:Net", r"own_wants.py:1: ModuleNotFoundError: No module named 'not_there'"),
        ("own_exits:Net", r"own_exits.py:2: SystemExit: 3"),
        ("own_calls:Net", r"own_calls.py:2: JSONDecodeError: "),
    ],
)
def test_a_slip_is_one_line_with_its_place(here: Path, name: str, said: str) -> None:
    (here / "own_net.py").write_text(_TWO)
    (here / "own_bad.py").write_text("x = 1\ny = x / 0\n")
    (here / "own_slip.py").write_text("class Net(:\n")
    (here / "own_wants.py").write_text("import not_there\n")
    (here / "own_exits.py").write_text("import sys\nsys.exit(3)\n")
    (here / "own_calls.py").write_text("import json\njson.loads('{')\n")
    with pytest.raises(PluginError, match=said) as caught:
        local.resolve(name, "encoder")
    assert "\n" not in str(caught.value)


def test_find_imports_nothing(here: Path) -> None:
    (here / "own_net.py").write_text("raise SystemExit('imported')")
    with pytest.raises(KeyError):
        local.find("own_net:Tiny")
    (here / "own_net.py").write_text(_TWO)
    tiny = local.resolve("./own_net.py:Tiny")
    assert local.find("elsewhere/own_net.py:Tiny") is tiny  # the file moved
    local.keep("other:Tiny", object)
    with pytest.raises(KeyError):  # two classes of that name: neither is taken
        local.find("elsewhere/own_net.py:Tiny")


def test_all_that_is_missing_is_named_at_once():
    config = {
        "encoder": {"name": "pixel"},
        "optim": {"name": "./absent.py:Mine", "schedule": "absent_too:rate"},
        "objective": {"mine": {"name": "absent_three:Loss"}},
    }
    with pytest.raises(PluginError) as error:
        local.check_given(config, "runs/a")
    listed = "'code=[./absent.py:Mine,absent_too:rate,absent_three:Loss]'"
    assert listed in str(error.value)
    # of the words to type, those that were given too: a command has them all or none
    local.keep("./absent.py:Mine", object)
    with pytest.raises(PluginError, match="made with absent_too:rate and absent_three") as error:
        local.check_given(config, "runs/a")
    assert listed in str(error.value)
    local.check_given({"encoder": {"name": "pixel"}}, "runs/a")
