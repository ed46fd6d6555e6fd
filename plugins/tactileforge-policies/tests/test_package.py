"""Contents of the package: cards of its recipes, verbs, and a complete README."""

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
