"""Contents of the package: cards of its recipes, verbs, and a complete README."""

import ast
import re
import tomllib
from pathlib import Path

import pytest

from tactileforge import cli
from tactileforge.hub import cards

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", ["diffusion_policy", "imitation"])
def test_cards_are_complete(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    card = cards.read_card(name)
    assert card.recipe
    assert re.search(r"arXiv \d{4}\.\d{5}", card.paper)
    assert card.code.startswith("https://")
    assert card.text.startswith(f"# {card.title}")
    assert cli.run(["zoo", "show", name]) == 0
    assert f"tactileforge train recipe={name}" in capsys.readouterr().out


def test_verbs_are_listed_with_the_others(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["--help"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"^ *demos +Records the scripted expert", said, re.M)
    assert re.search(r"^ *rollout +Rolls a policy out", said, re.M)


def test_the_readme_has_every_name() -> None:
    readme = (ROOT / "README.md").read_text()
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    names = [name for group in groups.values() for name in group if name != "policies"]
    assert len(names) == 9
    assert [name for name in names if f"`{name}`" not in readme] == []


def test_the_readme_names_what_is_imported_beside_the_door() -> None:
    table = (ROOT / "README.md").read_text().split("## What it imports")[1]
    rows = re.findall(r"^\| (`.*?) \|", table, re.M)
    named = {f"tactileforge.{name}" for row in rows for name in re.findall(r"`(.*?)`", row)}
    used: set[str] = set()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module == "tactileforge":
                used |= {f"tactileforge.{name.name}" for name in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                used.add(node.module)
    private = {name for name in used if name.startswith("tactileforge.")}
    private -= {"tactileforge.plugin", "tactileforge.testing"}
    unnamed = {name for name in private if not any(_within(name, one) for one in named)}
    idle = {one for one in named if not any(_within(name, one) for name in private)}
    assert (unnamed, idle) == (set(), set())


def _within(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")
