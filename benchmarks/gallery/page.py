"""The page of the gallery, ``docs/gallery.md``."""

from __future__ import annotations

from pathlib import Path

from gallery import objectives, readers, reports, sensors
from gallery.entry import Entry

PAGE = Path(__file__).parents[2] / "docs" / "gallery.md"
_TOP = """\
---
hide: [toc]
---

# Gallery

A picture and three lines for each sensor, objective, data reader and report of this repository.
All touch on this page is simulated, none of it comes from a published data set.
`python benchmarks/gallery_page.py` draws it anew.

[Sensors](#sensors) · [Objectives](#objectives) · [Readers](#data-readers) · [Reports](#reports)
"""
_SECTIONS = {
    "sensor": (
        "Sensors",
        "The first six are types with a simulated gel, the others are drivers.\n"
        "`tactileforge plugins list` shows the installed ones, [a page](plugins/sensor.md) how to\n"
        "add yours.",
    ),
    "objective": (
        "Objectives",
        "What the encoder sees, and what it has to predict. A recipe combines several:\n"
        "`'objective=[pixel,diff,force]'`.",
    ),
    "reader": (
        "Data readers",
        "Schematics: simulated frames stand for those of the named sensors, with a line for each\n"
        "column of the reader.",
    ),
    "report": (
        "Reports",
        "Single files that need no network. Shown is the top of each, made in miniature: numbers\n"
        "mean nothing here.",
    ),
}


def entries() -> list[Entry]:
    """All cards, in the order of the page."""
    return [
        *sensors.entries(),
        *objectives.entries(),
        *readers.entries(),
        *reports.entries(),
    ]


def text() -> str:
    """The page as Markdown."""
    parts, every = [_TOP], entries()
    for kind, (title, words) in _SECTIONS.items():
        cards = "\n".join(entry.markdown() for entry in every if entry.kind == kind)
        parts.append(
            f'## {title}\n\n{words}\n\n<div class="grid cards" markdown>\n\n{cards}\n</div>\n'
        )
    return "\n".join(parts)
