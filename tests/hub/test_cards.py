"""Cards are complete, and agree with their sources."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tactileforge import list_models
from tactileforge.errors import ConfigError
from tactileforge.hub import cards
from tactileforge.hub.table import zoo_page
from tactileforge.specs.published import SPECS
from tactileforge.util.licences import NO_LICENCE

ROOT = Path(__file__).parents[2]
MAIN_TABLE = {"anytouch1", "anytouch2", "clip", "mae", "t3", "unitouch", "vjepa"}


def test_every_system_of_the_papers_main_table_has_a_card_with_its_row() -> None:
    assert set(cards.card_names()) >= MAIN_TABLE
    for name in MAIN_TABLE:
        results = cards.read_card(name).results
        seen = name in ("anytouch1", "t3")  # trained on Cloth: the table gives no number
        assert len([r for r in results if r.source.endswith("Table 1")]) % 11 == 10 * seen, name


def test_the_published_force_errors_are_the_sums_of_their_axes() -> None:
    """Another table of the paper gives the axes: an independent check of numbers and unit."""
    axes = {
        "Sparsh Bench force, DIGIT": (268.03, 161.57, 194.66),
        "Sparsh Bench force, GelSight Mini": (42.29, 57.31, 102.54),
        "ToucHD Bench force, DIGIT": (285.89, 334.37, 274.06),
        "ToucHD Bench force, GelSight Mini": (273.48, 397.17, 380.38),
    }
    results = {r.task: r for r in cards.read_card("anytouch2").results if r.model == "base"}
    for task, parts in axes.items():
        assert results[task].value == pytest.approx(sum(parts), abs=0.02)
        assert results[task].unit == "mN"


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "zoo/recipe").glob("*.md")))
def test_cards_are_complete(name: str) -> None:
    card = cards.read_card(name)
    assert re.search(r"arXiv \d{4}\.\d{5}", card.paper)
    assert card.code.startswith("https://")
    assert set(card.sensors) <= set(SPECS)
    assert card.data
    assert card.text.startswith(f"# {card.title}")
    assert card.recipe == (ROOT / "zoo" / "recipe" / f"{name}.yaml").is_file()
    spdx = {"Apache-2.0", "MIT", "CC-BY-NC-4.0", NO_LICENCE}
    assert {card.licence, *(w.licence for w in card.weights)} <= spdx
    for weight in card.weights:
        if weight.file:
            path = ROOT / "zoo" / weight.file
            assert path.stat().st_size == weight.bytes < 15e6


def test_layouts_are_those_of_the_importers() -> None:
    from tactileforge_published import LAYOUTS

    on_cards = {w.layout for _, _, w in cards.list_cards() if w and w.layout}
    assert on_cards == {layout.name for layout in LAYOUTS} - {"sparsh"}


def test_the_page_of_the_documentation_is_that_of_the_cards() -> None:
    written = (ROOT / "docs" / "zoo.md").read_text()
    assert written == zoo_page(), "write it: tactileforge zoo list --markdown > docs/zoo.md"
    assert all(f"`{name}`" in written for name in list_models())


def test_names_and_defaults() -> None:
    assert cards.find_card("anytouch2")[1] is cards.read_card("anytouch2").weights[0]
    card, weight = cards.find_card("anytouch2.base-2f")
    assert (card.clip(None), card.clip(weight)) == ((4, 0.0667), (2, 0.2))
    assert list_models("*vit*") == [
        "clip.vitb16",
        "clip.vitl14",
        "tvl.vitb",
        "tvl.vits",
        "tvl.vittiny",
    ]
    with pytest.raises(ConfigError, match="did you mean 'anytouch2'"):
        cards.find_card("anytuch2")
    with pytest.raises(
        ConfigError, match="unknown weights of anytouch2 'bass'; did you mean 'base'"
    ):
        cards.find_card("anytouch2.bass")
    with pytest.raises(ConfigError, match=r"file:some/model.safetensors"):
        cards.find_card("some/model.safetensors")


def test_a_card_without_weights_says_so(add_card: Callable[..., None]) -> None:
    add_card("bare")
    assert list_models() == ["bare"]
    assert list_models(weights=True) == []
    with pytest.raises(ConfigError, match="'bare' has no weights"):
        cards.find_card("bare")


WEIGHT: dict[str, Any] = {
    "tag": "base",
    "licence": "MIT",
    "url": "https://example.org/a",
    "sha256": "0" * 64,
    "bytes": 1,
}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"licens": "MIT"}, "did you mean 'licence'"),
        ({"licence": "mit"}, "card thing: licence: 'mit' is not an SPDX .* did you mean 'MIT'"),
        ({"weights": [WEIGHT | {"licence": "Apache"}]}, "weights 'base': licence: 'Apache' is no"),
        ({"title": 3}, "title is 3, which is not of type str"),
        ({"sensors": ["digit", 1]}, r"sensors is \['digit', 1\]"),
        ({"weights": [WEIGHT | {"file": "a"}]}, "one of file, url and layout"),
        ({"weights": [WEIGHT | {"url": ""}]}, "one of file, url and layout"),
        ({"weights": [WEIGHT | {"sha256": "abc"}]}, "64 hexadecimal digits"),
        ({"weights": [WEIGHT | {"bytes": 0}]}, "bytes are needed"),
        ({"weights": [WEIGHT, WEIGHT]}, "each used once"),
        ({"weights": [WEIGHT | {"tag": "Base"}]}, "lower-case"),
        ({"weights": [{"tag": "base"}]}, r"weights\[0\]: 'licence' is missing"),
        ({"weights": {"base": 1}}, "weights must be a list"),
        ({"weights": [{"tag": "a", "licence": "MIT", "layout": "clip"}]}, "state in source"),
        ({"results": [{"task": "x"}]}, r"results\[0\]: 'metric' is missing"),
        ({"spacing": 0}, "several have seconds between them"),
        ({"frames": 1}, "one frame has spacing 0"),
    ],
)
def test_cards_at_fault_are_named(
    changed: dict[str, Any], message: str, card_text: Callable[..., str]
) -> None:
    with pytest.raises(ConfigError, match=message):
        cards.parse_card("thing", card_text(**changed), False)


def test_a_page_without_front_matter_is_no_card(card_text: Callable[..., str]) -> None:
    with pytest.raises(ConfigError, match="does not start with front matter"):
        cards.parse_card("thing", "# Thing\n", False)
    with pytest.raises(ConfigError, match="card thing: while"):
        cards.parse_card("thing", "---\ntitle: [\n---\n", False)
    assert cards.parse_card("thing", card_text(), True).recipe
