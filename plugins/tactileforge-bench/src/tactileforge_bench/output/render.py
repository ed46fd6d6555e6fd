"""Tables as Markdown, LaTeX and HTML."""

from __future__ import annotations

import re
import textwrap

from markupsafe import Markup

from tactileforge.pages import markdown_table, piece
from tactileforge_bench.output.grid import ColumnHead, Table, TableEntry

_TEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "[": "{[}",  # after the end of a row it would be an option of it, as would a star
    "*": "{*}",
    "±": r"$\pm$",
    "\N{MINUS SIGN}": "$-$",
    "\N{MULTIPLICATION SIGN}": r"$\times$",
    "°": r"$^\circ$",
    "µ": r"$\mu$",
    "·": r"$\cdot$",
    "†": r"\dag{}",
    "‡": r"\ddag{}",
    "↓": r"$\downarrow$",
    "↑": r"$\uparrow$",
    "▼": r"$\blacktriangledown$",
    "▲": r"$\blacktriangle$",
    "▽": r"$\triangledown$",
    "△": r"$\vartriangle$",
    "…": r"\ldots{}",
} | {letter: f"\\{letter}" for letter in "&%$#_"}
#: Letters of a line in the head of a column in LaTeX.
_NARROW = 14


def latex_text(text: str) -> str:
    r"""Plain text for LaTeX.

    Example:
        >>> print(latex_text("no_diff & 50 %"))
        no\_diff \& 50 \%
    """
    return "".join(_TEX.get(letter, letter) for letter in text)


def markdown_text(text: str) -> str:
    r"""Plain text for a Markdown table: nothing in it is markup, and pipes end no cell.

    Example:
        >>> print(markdown_text("a|b *c* no_diff"))
        a\|b \*c\* no_diff
    """
    text = re.sub(r"([\\|*`<\[\]])", r"\\\1", " ".join(text.split()))
    # an underscore inside a word is no emphasis, and is left readable
    return re.sub(r"(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])", r"\_", text)


def render_markdown(grid: Table) -> str:
    """A heading, the caption, the table in aligned columns, and its footnotes."""
    rows = [[markdown_text(f"{head.text}, {head.below}".strip(", ")) for head in grid.head]]
    rows += [[_markdown_entry(entry) for entry in row] for row in grid.rows]
    right = {i for i, entry in enumerate(grid.rows[0]) if i and entry.tone != "text"}
    notes = "".join(f"- ({mark}) {markdown_text(text)}\n" for mark, text in grid.notes)
    head = f"## {markdown_text(grid.title)}\n\n{markdown_text(grid.caption)}\n\n"
    lines = markdown_table(rows, right=right, aligned=True)
    return head + lines + "\n" + (f"\n{notes}" if notes else "")


def _markdown_entry(entry: TableEntry) -> str:
    text = markdown_text(entry.line)
    text = {"best": f"**{text}**", "second": f"<ins>{text}</ins>"}.get(entry.rank, text)
    return text + "".join(f" ({mark})" for mark in entry.marks)


def render_latex(grid: Table) -> str:
    """A floating table with booktabs' rules; footnotes below it."""
    first = grid.rows[0]
    columns = "l" + "".join("l" if entry.tone == "text" else "r" for entry in first[1:])
    rows = [" & ".join(map(_latex_head, grid.head))]
    rows += [" & ".join(map(_latex_entry, row)) for row in grid.rows]
    notes = "".join(
        f"\\par\\textsuperscript{{{latex_text(mark)}}} {latex_text(text)}\n"
        for mark, text in grid.notes
    )
    body = "".join(f"{row} \\\\\n" for row in rows[1:])
    return (
        "\\begin{table}[t]\n\\centering\n\\small\n"
        f"\\caption{{{latex_text(f'{grid.title}. {grid.caption}')}}}\n\\label{{tab:{grid.name}}}\n"
        f"\\begin{{tabular}}{{{columns}}}\n\\toprule\n{rows[0]} \\\\\n\\midrule\n{body}"
        f"\\bottomrule\n\\end{{tabular}}\n{notes}\\end{{table}}\n"
    )


def _latex_head(head: ColumnHead) -> str:
    lines = [*textwrap.wrap(head.text, _NARROW), *textwrap.wrap(head.below, _NARROW)]
    inner = r" \\ ".join(map(latex_text, lines))
    return f"\\shortstack{{{inner}}}" if len(lines) > 1 else inner


def _latex_entry(entry: TableEntry) -> str:
    text = latex_text(entry.line)
    text = {"best": f"\\textbf{{{text}}}", "second": f"\\underline{{{text}}}"}.get(entry.rank, text)
    marks = ",".join(latex_text(mark) for mark in entry.marks)
    return f"{text}\\textsuperscript{{{marks}}}" if marks else text


def render_html(grid: Table, heading: bool = False) -> Markup:
    """The table, with its caption above and its footnotes below."""
    return piece("grid", grid, heading)
