"""Names of columns and rows of tables as programs write them.

Cells are separated by commas, semicolons, tabs or blanks. Decimals have points, or commas where
these separate no cells. Names stand in the first line, below lines of a title, behind ``#`` or
``%``, in two lines (groups or units), or nowhere: then columns are ``0``, ``1`` and so on. Lines
may be printed arrays, in brackets.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from itertools import chain, islice

from tactileforge.data.labels.missing import stated
from tactileforge.reading.records import flat
from tactileforge.util.untrusted import load_json

#: Lines at the start of a file that show how it is written.
_HEAD = 40
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf)", re.IGNORECASE)
_WITH_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_QUOTED = re.compile(r'"[^"]*"')
#: A line of an array, and the name of a file: no column is called so.
_ARRAY = re.compile(r"\s*\[[^\[\]]*\]\s*|\s*\(\s*[-+.\d][^()]*\)\s*")
_FILE = re.compile(r"\S.*\.(?:png|jpe?g|bmp|tiff?|webp|npy|mp4|avi|mov|mkv)", re.IGNORECASE)
#: A name in a list of recordings: a path, or words and a number.
_LISTED = re.compile(r"[^\s/]+(?:/[^\s/]+)+/?|[^\W\d_][\w.-]*\d")
#: What parts numbers of one cell, and what encloses them.
_PARTED, _AROUND = re.compile(r"[,;\s]+"), "[]() \t\r\n"
#: Units of a line below the names of columns; of these, those that a reader takes for granted.
_UNITS = frozenset(
    word
    for words in (
        "s sec seconds ms us µs ns n newton mn kn un cn kgf gf g kg lbf nm n.m n·m n*m n-m nmm mnm",
        "mm cm um µm deg rad degc °c c k v mv a ma hz pa kpa bar psi count counts adc px pixel",
        "m 1 -",
    )
    for word in words.split()
)
_USUAL = frozenset(("s", "sec", "seconds", "n", "newton", "1", "-", ""))

Cells = Sequence[str]


@dataclass(frozen=True)
class TextTable:
    """A table of texts.

    Attributes:
        header: Names of the columns.
        rows: Number of the line and cells of each row; no cells for an empty line.
        named: Whether the file has names of its columns.
    """

    header: list[str]
    rows: list[tuple[int, list[str]]]
    named: bool = True


def read_text_table(text: str) -> TextTable:
    r"""The table of a text.

    Raises:
        csv.Error: Quotes are damaged.

    Example:
        >>> table = read_text_table("Time;Fx\ns;mN\n0,5;12,5\n")
        >>> table.header, table.rows
        (['Time', 'Fx [mN]'], [(3, ['0.5', '12.5'])])
    """
    filled = [line for line in text.splitlines() if line.strip()]
    if filled and all(map(_ARRAY.fullmatch, filled)):
        text = "\n".join(line.strip(_AROUND) for line in text.splitlines())
    mark = _mark(text)
    if mark == " ":
        lines = [(i, line.split()) for i, line in enumerate(text.splitlines(), 1)]
    else:
        reader = csv.reader(StringIO(text, newline=""), delimiter=mark, skipinitialspace=True)
        lines = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    return table_of(lines, with_commas=mark != ",")


def table_of(lines: Sequence[tuple[int, list[str]]], with_commas: bool = False) -> TextTable:
    """The table of lines of cells, such as those of a spreadsheet."""
    start = next((i for i, (_, cells) in enumerate(lines) if any(cells)), len(lines))
    lines = lines[start:]
    if with_commas:
        lines = _with_points(lines)
    header, begin = _header([cells for _, cells in islice(lines, _HEAD)])
    rows = [(number, cells) for number, cells in lines[begin:] if not _is_comment(cells)]
    if header is None:
        width = max((len(cells) for _, cells in rows[:_HEAD]), default=0)
        return TextTable([str(i) for i in range(width)], rows, named=False)
    return TextTable(_in_groups(header, rows), rows)


def _in_groups(header: list[str], rows: Sequence[tuple[int, Cells]]) -> list[str]:
    """Names, repeated ones behind their group, an empty column before them.

    Example:
        >>> _in_groups(["t", "force", "x", "torque", "x"], [(2, ["0", "", "1", "", "2"])])
        ['t', 'force', 'force.x', 'torque', 'torque.x']
    """
    if len({*header}) == len(header):
        return header
    filled = {i for _, cells in rows for i, cell in enumerate(cells) if cell}
    out, group = [], ""
    for i, name in enumerate(header):
        is_empty = bool(rows) and i not in filled
        group = name if is_empty else group
        out.append(f"{group}.{name}" if group and not is_empty and header.count(name) > 1 else name)
    return out


def in_cells(rows: Sequence[Mapping[str, str]]) -> dict[str, list[dict[str, str]]]:
    """Values within the cells of columns: several numbers, or JSON of named values.

    Returns:
        Cells of each row, by the column that they come from: ``wrench.0`` to ``wrench.5`` of a
        column ``wrench`` with six numbers in a cell.

    Example:
        >>> in_cells([{"force": "[0.1, 0, 2]"}, {"force": ""}])["force"]
        [{'force.0': '0.1', 'force.1': '0', 'force.2': '2'}, {}]
    """
    found = {}
    for name in rows[0] if rows else ():
        first = next((row[name] for row in rows if stated(row[name])), "")
        if not _inside(name, first):
            continue
        inner = [_inside(name, row[name]) if stated(row[name]) else {} for row in rows]
        widths = {tuple(cells) for cells in inner if cells}
        is_all = all(cells or not stated(row[name]) for cells, row in zip(inner, rows, strict=True))
        if is_all and len(widths) == 1:
            found[name] = inner
    return found


def _inside(name: str, cell: str) -> dict[str, str]:
    """Values within a cell; {} for one value."""
    if cell.startswith("{"):
        try:
            return dict(flat(load_json(cell), name))
        except ValueError:
            return {}
    parts = _PARTED.split(cell.strip(_AROUND))
    if len(parts) < 2 or not all(map(is_number, parts)):
        return {}
    return {f"{name}.{i}": part for i, part in enumerate(parts)}


def _mark(text: str) -> str:
    """The character between cells."""
    lines = [line for line in islice(text.splitlines(), _HEAD) if line.strip()]
    lines = [_QUOTED.sub('""', line) for line in lines]
    if not lines:
        return ","
    body = lines[len(lines) // 2 :]
    first, last = lines[0], body[-1]
    for mark in ("\t", ";"):
        counts = {line.count(mark) for line in body}
        if len(counts) > 1 or not min(counts):
            continue
        # of a file with commas in its first line, texts may have semicolons
        if "," not in first or (
            first.count(mark) in counts and any(map(_is_decimal, last.split(mark)))
        ):
            return mark
    # comments and titles above a table may have commas
    if any("," in line for line in body):
        return ","
    widths = {len(line.split()) for line in body}
    is_plain = all(is_number(word) or _FILE.fullmatch(word) for word in " ".join(body).split())
    return " " if is_plain and len(widths) == 1 and min(widths) > 1 else ","


def _header(lines: Sequence[Cells]) -> tuple[list[str] | None, int]:
    """Names of the columns, None without any, and the number of the first row."""
    comment: list[str] = []
    begin = 0
    while begin < len(lines) and _is_comment(lines[begin]):
        comment = _uncommented(lines[begin])
        begin += 1
    if begin == len(lines):
        return comment or None, begin
    first = lines[begin]
    if _is_data(first) or _names_files(lines[begin : begin + 2]):
        named = len(comment) == len(first) and not any(map(is_number, comment))
        return (comment, begin) if named else (None, begin)
    begin = _below_titles(lines, begin)
    header, second = list(lines[begin]), begin + 1
    if not _is_second(lines[second:]):
        return header, second
    return _joined(header, lines[second]), second + 1


def _names_files(lines: Sequence[Cells]) -> bool:
    """Whether lines have names of files in a column, or are a list of names."""
    is_list = {*map(len, lines)} == {1} and all(map(_LISTED.fullmatch, chain(*lines)))
    return is_list or any(all(map(_FILE.fullmatch, column)) for column in zip(*lines, strict=False))


def _below_titles(lines: Sequence[Cells], begin: int) -> int:
    """Number of the line of names below lines of a title; ``begin`` without such lines."""
    width = Counter(len(cells) for cells in lines[len(lines) // 2 :]).most_common(1)[0][0]
    for i in range(begin, len(lines) - 1):
        cells = lines[i]
        is_names = len(cells) == width > 1 and all(cells) and len({*cells}) == width
        if is_names and not any(map(is_number, cells)):
            after = next((line for line in lines[i + 1 :] if any(line)), ())
            after = lines[i + 2] if _is_second(lines[i + 1 :]) else after
            return i if any(map(is_number, after)) else begin
        # a title has other cells than the table, or the first alone
        if len(cells) == width and (sum(map(bool, cells)) > 1 or not cells[0]):
            return begin
    return begin


def _is_second(lines: Sequence[Cells]) -> bool:
    """Whether the first of some lines is of names or units: texts above numbers alone."""
    if len(lines) < 2 or not any(lines[0]) or any(map(is_number, lines[0])):
        return False
    below = [line for line in lines[1:] if any(line)]
    texts = [i for i, cell in enumerate(lines[0]) if stated(cell)]
    columns = [[stated(line[i]) for line in below if i < len(line)] for i in texts]
    return bool(columns) and all(
        any(column) and all(is_number(cell) for cell in column if cell) for column in columns
    )


def _joined(above: Sequence[str], below: Sequence[str]) -> list[str]:
    """Names of two lines: groups and names, or names and units."""
    plain = [cell.strip("[]() ").casefold() for cell in below]
    if all(unit in _UNITS or not unit for unit in plain):
        units = [*zip(below, plain, strict=True), *[("", "")] * (len(above) - len(below))]
        return [
            name if unit in _USUAL else f"{name} [{cell.strip('[]() ')}]"
            for name, (cell, unit) in zip(above, units, strict=False)
        ]
    out, group = [], ""
    for i, name in enumerate(below):
        group = above[i] if i < len(above) and above[i] else group
        out.append(f"{group}.{name}" if group and name and group != name else name or group)
    return out


def _with_points(lines: Sequence[tuple[int, list[str]]]) -> Sequence[tuple[int, list[str]]]:
    """Lines with points in place of commas in numbers."""
    width = max((len(cells) for _, cells in lines), default=0)
    has_comma, has_point = [False] * width, [False] * width
    for _, cells in lines:
        for i, cell in enumerate(cells):
            has_comma[i] |= _WITH_COMMA.fullmatch(cell) is not None
            has_point[i] |= "." in cell and _NUMBER.fullmatch(cell) is not None
    turned = [i for i in range(width) if has_comma[i] and not has_point[i]]
    if not turned:
        return lines
    out = []
    for number, cells in lines:
        for i in turned:
            if i < len(cells) and _WITH_COMMA.fullmatch(cells[i]):
                cells[i] = cells[i].replace(",", ".")
        out.append((number, cells))
    return out


def _is_data(cells: Cells) -> bool:
    """Whether a line is of numbers, and no names: 0, 1, 2 are those of an array."""
    filled = [cell for cell in cells if cell]
    if filled == [str(i) for i in range(len(filled))] and len(filled) > 1:
        return False
    return 2 * sum(map(is_number, filled)) >= len(filled) > 0


def _is_comment(cells: Cells) -> bool:
    return bool(cells) and (cells[0].startswith(("#", "% ", "%%")) or cells[0] == "%")


def _uncommented(cells: Cells) -> list[str]:
    cells = [cells[0].lstrip("#% "), *cells[1:]]
    return cells if cells[0] or (len(cells) > 1 and cells[1] == "") else [*cells[1:]]


def is_number(cell: str) -> bool:
    """Whether a cell is a number as programs write it.

    Example:
        >>> is_number("-1.5e3"), is_number("nan"), is_number("3 N")
        (True, True, False)
    """
    return _NUMBER.fullmatch(cell) is not None


def _is_decimal(cell: str) -> bool:
    cell = cell.strip()
    return is_number(cell) or _WITH_COMMA.fullmatch(cell) is not None
