"""The page kit: style, sections, tables and panels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from tactileforge.pages.figures import CLASSES, marker_of
from tactileforge.pages.templating import environment, piece

MINUS = "\N{MINUS SIGN}"
NONE = "\N{EN DASH}"
SPLIT_WORDS = {"val": "validation", "train": "training"}


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        name: Name of the anchor.
        title: Title, plain text.
        body: Markup of the section; `joined` joins pieces.
    """

    name: str
    title: str
    body: Markup


def html_page(title: str, top: Markup, sections: Sequence[Section]) -> str:
    """The whole page.

    Args:
        title: Title, plain text.
        top: Markup between the title and the table of contents.
        sections: Sections in order.
    """
    colours = [
        ";".join(f"--c{i}:{themes[theme]}" for i, themes in enumerate(CLASSES)) for theme in (0, 1)
    ]
    template = environment().get_template("page.html")
    return template.render(title=title, top=top, sections=sections, colours=colours)


def table(
    name: str, head: Sequence[str], rows: Iterable[Sequence[str]], caption: str = ""
) -> Markup:
    """A table with the names of rows in the first column.

    Args:
        name: Id of the table.
        head: Cells of the head, plain text; any cell may begin with a class (``good|``, ``bad|``,
            ``text|``).
        rows: Cells of each row, plain text.
        caption: Caption above the table, plain text.
    """
    cells = [(first, [_cell(text) for text in rest]) for first, *rest in rows]
    return piece("table", name, [_cell(text) for text in head], cells, caption)


def _cell(text: str) -> tuple[str, str]:
    """Class and text of a cell."""
    kind, mark, rest = text.partition("|")
    return (kind, rest) if mark and kind in ("good", "bad", "text") else ("", text)


def paragraph(text: str, soft: bool = False) -> Markup:
    """A paragraph of plain text; ``soft`` for a paler one."""
    return piece("paragraph", text, soft)


def heading(text: str) -> Markup:
    """A heading inside a section."""
    return piece("heading", text)


def facts(about: Mapping[str, str]) -> Markup:
    """Facts by name, as small cards; empty values are left out."""
    return piece("facts", {key: value for key, value in about.items() if value})


def verdict(lines: Iterable[tuple[str, str]]) -> Markup:
    """A list of findings, each marked ``good``, ``bad`` or ``plain``."""
    return piece("verdict", list(lines))


def items(lines: Iterable[str]) -> Markup:
    """A list of plain text."""
    return piece("items", list(lines))


def details(title: str, body: str, is_open: bool = False) -> Markup:
    """A collapsible part of a page."""
    return piece("details", title, body, is_open)


def preformatted(text: str) -> Markup:
    """Plain text with preserved line breaks."""
    return piece("preformatted", text)


def next_commands(lines: Sequence[tuple[str, str]]) -> Section:
    """The last section of a page: commands that go on from it.

    Args:
        lines: Command, and what it is for.
    """
    return Section("next", "Next", piece("commands", list(lines)))


def panel(title: str, drawing: str, caption: str = "") -> Markup:
    """A drawing with a title above and a caption below; both plain text."""
    return piece("panel", title, drawing, caption)


def panels(parts: Iterable[str], wide: bool = False) -> Markup:
    """Drawings side by side, as many as fit."""
    return piece("panels", list(parts), wide)


def card(title: str, body: Markup, caption: str = "") -> Markup:
    """Strips and drawings of one recording, with a title and a caption; both plain text."""
    return piece("card", title, body, caption)


def cards(parts: Iterable[str], rem: float = 11) -> Markup:
    """Cards side by side, as many as fit at a smallest width of ``rem``."""
    return piece("cards", list(parts), rem)


def stack(parts: Iterable[str]) -> Markup:
    """Figures below one another."""
    return piece("stack", list(parts))


def group_name(name: str, rest: str) -> Markup:
    """The name of a group of figures, with a short description."""
    return piece("group_name", name, rest)


def legend(names: Mapping[int, str], line: str = "", area: str = "", ink: str = "") -> Markup:
    """The legend of a drawing.

    Args:
        names: Names of the classes by number; -1 is grey.
        line: Meaning of a line in the colour of the text; "" for none.
        area: Meaning of a shaded area; "" for none.
        ink: Meaning of points in the colour of the text, listed first; "" for none.
    """
    keys = [("o", "currentColor", ink)] * bool(ink)
    keys += [
        (marker_of(i), f"var(--c{i % len(CLASSES)})" if i >= 0 else "var(--other)", name)
        for i, name in names.items()
    ]
    keys += [("line", "currentColor", line)] * bool(line)
    keys += [("area", "var(--shade)", area)] * bool(area)
    return piece("legend", keys)


def number(value: float) -> str:
    """A number with three digits; a dash for NaN."""
    return f"{value:.3g}".replace("-", MINUS) if value == value else NONE


def percent(share: float, signed: bool = False) -> str:
    """A share in whole percent; one digit more below ten."""
    value = 100 * share
    if value != value:
        return NONE
    # 9.95 is written as 9.9 or 10, never as 10.0
    text = f"{value:{'+' if signed else ''}.{1 if abs(value) < 9.95 else 0}f}"
    return f"{text.lstrip('+-') if float(text) == 0 else text} %".replace("-", MINUS)


def duration(seconds: float) -> str:
    """A duration in s as readable text.

    Example:
        >>> duration(75), duration(7500), duration(4.2)
        ('1 min 15 s', '2 h 5 min', '4.2 s')
    """
    if seconds < 60:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"
