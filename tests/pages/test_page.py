"""The page kit: one place of markup, with everything else escaped."""

import ast
import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest
import torch
from markupsafe import Markup
from tactileforge_bench.output.grid import ColumnHead, Table, TableEntry
from tactileforge_bench.output.render import render_html

import tactileforge
from tactileforge.pages import images, page
from tactileforge.pages.figures import bars_figure
from tactileforge.pages.templating import breakable, joined

HOSTILE = "</script><img src=x onerror=\"alert('1')\"> & more"
PACKAGE = Path(tactileforge.__file__).parent
PLUGINS = Path(__file__).parents[2] / "plugins"
PIXELS = np.zeros((4, 6, 3), np.uint8)


@pytest.mark.parametrize(
    "made",
    [
        page.paragraph(HOSTILE),
        page.heading(HOSTILE),
        page.facts({HOSTILE: HOSTILE}),
        page.verdict([("good", HOSTILE)]),
        page.items([HOSTILE]),
        page.details(HOSTILE, HOSTILE),
        page.preformatted(HOSTILE),
        page.table("name", [HOSTILE], [[HOSTILE, f"text|{HOSTILE}"]], HOSTILE),
        page.panel(HOSTILE, HOSTILE, HOSTILE),
        page.panels([HOSTILE]),
        page.card(HOSTILE, Markup(), HOSTILE),
        page.cards([HOSTILE]),
        page.stack([HOSTILE]),
        page.group_name(HOSTILE, HOSTILE),
        page.legend({0: HOSTILE}, HOSTILE, HOSTILE, HOSTILE),
        images.image(PIXELS, HOSTILE),
        images.strip([Markup()], 1, HOSTILE),
        images.noted(Markup(), HOSTILE),
        images.captioned(Markup(), HOSTILE),
        images.figure([PIXELS], HOSTILE, HOSTILE, 1),
        render_html(
            Table(
                "n",
                HOSTILE,
                HOSTILE,
                [ColumnHead(HOSTILE, HOSTILE)],
                [[TableEntry(HOSTILE, "best")]],
            ),
            True,
        ),
        joined([HOSTILE, page.paragraph("")]),
    ],
)
def test_text_is_escaped_in_every_piece(made: Markup) -> None:
    assert isinstance(made, Markup)
    assert 'onerror="' not in made
    assert "<script" not in made
    assert HOSTILE in unescape(made)


def test_a_page_escapes_its_titles_and_keeps_its_markup() -> None:
    sections = [page.Section("first", HOSTILE, page.paragraph("in <markup>"))]
    text = page.html_page(HOSTILE, page.facts({"key": "value"}), sections)
    assert text.count("&lt;img src=x onerror=") == 4  # title, heading, contents, section
    assert "<img" not in text
    assert "<p>in &lt;markup&gt;</p>" in text
    assert "--c0:#" in text
    assert "{{" not in text


def test_cells_have_their_class_and_nothing_else_is_one() -> None:
    text = page.table("t", ["a", "text|b"], [["r", "good|1", "bad|2", "odd|3"]])
    assert '<th scope="col" class="text">b</th>' in text
    assert '<td class="good">1</td><td class="bad">2</td><td>odd|3</td>' in text
    assert "aria-describedby" not in text


def test_a_strip_leaves_places_empty() -> None:
    text = images.strip([None, images.image(PIXELS, "second")], 2)
    assert text.count("<span></span>") == 1
    assert text.index("<span>") < text.index("<img")


def test_an_image_is_the_same_from_bytes_and_from_a_tensor() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (8, 12, 3), np.uint8)
    tensor = torch.from_numpy(pixels).permute(2, 0, 1) / 255
    assert images.image(pixels, "x") == images.image(tensor, "x")


def test_a_difference_lies_around_mid_grey_and_is_clipped() -> None:
    change = np.array([[[0.0, 1.0, -1.0], [0.3, 100.0, -100.0]]])
    assert images.amplified_difference(change, 4.0).tolist() == [[[128, 132, 124], [129, 255, 0]]]


@pytest.mark.slow
def test_markup_is_written_in_templates_only() -> None:
    tag = re.compile(r"</(div|p|ul|li|dl|figure|section|table|td|th|details|h\d|pre)>|<img ")
    written = [
        f"{path.name}:{node.lineno}"
        for path in sorted([*PACKAGE.rglob("*.py"), *PLUGINS.glob("*/src/**/*.py")])
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and tag.search(node.value)
    ]
    assert written == []


def test_long_names_break_behind_their_marks() -> None:
    name = "guessed/left_gelsight_of_the_second_robot.mp4"
    assert breakable("press it") == "press it"
    assert "<wbr>" not in breakable("guessed/press_01.mp4")
    broken = breakable(f"{name} <b>")
    assert broken.replace("<wbr>", "") == f"{name} &lt;b&gt;"
    longest = max(broken.split(" ")[0].split("<wbr>"), key=len)
    assert len(longest) < 12


def test_wide_tables_name_their_cells_for_a_phone() -> None:
    head = ("Axis", "MAE (N)", "median guess (N)", "R2")
    made = page.table("t", head, [("x", "0.1", "bad|0.2", "0.3")])
    assert re.findall(r'data-head="([^"]*)"', made) == [*head[1:]]
    assert 'class="folds"' in made
    assert "data-head" not in page.table("t", head[:2], [("x", "0.1")])


def test_the_next_commands_are_the_last_section() -> None:
    part = page.next_commands([("tactileforge zoo pack runs/<a>", "pack it")])
    assert "tactileforge zoo pack runs/&lt;a&gt;</pre>" in part.body


def test_bars_have_intervals() -> None:
    drawn = bars_figure("accuracy (%)", [("pixels", 50.0, 4.0), ("mine", 70.0, float("nan"))])
    assert 'aria-label="accuracy (%) of pixels, mine"' in drawn
    assert all(f">{name}</text>" in drawn for name in ("pixels", "mine"))
    ends = [
        part for part in re.findall(r'<path d="[^"]*"[^>]*>', drawn) if "stroke-width: 1.2" in part
    ]
    assert len(ends) == 1  # NaN has no interval
