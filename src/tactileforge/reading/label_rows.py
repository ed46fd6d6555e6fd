"""Labels of touches: CSV rows matched with files, and templates filled from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from tactileforge.data.labels.missing import stated
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.reading.files import names_below
from tactileforge.reading.layout import DatasetLayout
from tactileforge.reading.order import name_prefix, name_rest
from tactileforge.reading.tables import joined, read_cells
from tactileforge.reading.templates import template_columns, template_parts
from tactileforge.reading.trial_rows import recordings_of
from tactileforge.reading.written_names import WrittenNames, is_there


@dataclass(frozen=True)
class LabelRow:
    """Labels of one file, or of one folder of images.

    Attributes:
        where: CSV and line, or the file itself without a row.
        cells: Values of the CSV by column; "" for a missing one.
        words: Values by column, with ranks as words, and ``file``, ``stem``, ``prefix``, ``rest``,
            ``folder``, ``parent`` and ``above``.
        images: Rows of the images of a folder, by file; empty for a folder with one row.
        mixed: Description of the difference, by column, for columns of unequal rows of a folder.
    """

    where: str
    cells: Mapping[str, str]
    words: Mapping[str, str]
    images: Mapping[str, LabelRow] = field(default_factory=dict)
    mixed: Mapping[str, str] = field(default_factory=dict)

    def fill(self, template: str, spaced: bool = False) -> str | None:
        """The template with its columns filled in; None if one of them is empty.

        Raises:
            ConfigError: A column does not exist.
            DataError: The images of one folder differ in a column.
        """
        values = dict(self.words)
        if spaced:
            values = {name: value.replace("_", " ") for name, value in values.items()}
            values["action"] = "{action}"
        out = ""
        for text, name in template_parts(template):
            if name is None:
                out += text
                continue
            if name not in values:
                raise ConfigError(f"{self.where}: {unknown('column', name, values)}")
            if name in self.mixed and not (spaced and name == "action"):
                raise DataError(f"{self.mixed[name]}; a recording has one: correct the rows")
            if not values[name]:
                return None
            out += text + values[name]
        return out


def read_labels(layout: DatasetLayout, folder: Path) -> dict[str, LabelRow]:
    """Rows of the labels of a layout, by file name as written in the CSV.

    Raises:
        DataNotFoundError: There is no such CSV.
        DataError: A file has two rows, or a value has no word.
        ConfigError: The key column does not exist.
    """
    if layout.labels is None:
        return {}
    rows: dict[str, LabelRow] = {}
    for where, cells in read_cells(folder / layout.labels, [layout.key, *layout.words]):
        name = cells[layout.key]
        if not name and template_columns(layout.key):
            raise DataError(
                f"{where}: {layout.key} name a file together, and one is empty; fill it in, or "
                "remove the row"
            )
        if name in rows:
            raise DataError(f"{where}: {name!r} has a row already ({rows[name].where})")
        rows[name] = _row(name, where, cells, layout)
    return rows


def _row(name: str, where: str, cells: Mapping[str, str], layout: DatasetLayout) -> LabelRow:
    """A row of a touch or of one of its images, with its words."""
    values, words = {layout.key: name}, {layout.key: name}
    for column, value in cells.items():
        if column != layout.key:
            known = layout.words.get(column)
            is_word = known is not None and value in known  # "none" may be a rank of its own
            values[column] = value if is_word else stated(value)
            words[column] = _word(known, values[column], f"{where}, column {column!r}")
    return LabelRow(where, values, words | _names(name, layout))


def label_row(name: str, rows: Mapping[str, LabelRow], layout: DatasetLayout) -> LabelRow:
    """The row of a touch; without one, a row with all columns of the labels empty."""
    if name in rows:
        return rows[name]
    header = next(iter(rows.values())).words if rows else {}
    return LabelRow(name, {}, dict.fromkeys(header, "") | _names(name, layout))


def rows_in_turn(layout: DatasetLayout, path: Path, name: str) -> list[LabelRow]:
    """Rows of the pictures of a film, in their order."""
    return [_row(name, where, cells, layout) for where, cells in read_cells(path, [*layout.words])]


def match_labels(
    layout: DatasetLayout, folder: Path, files: Mapping[str, Sequence[Path]]
) -> dict[str, LabelRow]:
    """The row of each touch; without one, a row with all columns of the labels empty.

    Rows may write a file with ``./``, with backslashes, as an absolute path, from the folder of the
    CSV on, in another case, without its ending, or by the end of the path or its name alone if that
    is unique; of an absolute path of another machine the end counts, with a folder or more. A row
    that names a folder is of all touches in it that have no row of their own; for a touch that is a
    folder, a row may name one of its images. Labels in a file of its own (``{folder}/meta.json``)
    are one row, or rows of its images.

    Raises:
        DataError: A row names no touch, or two rows name one; see also `read_labels`.
    """
    if layout.labels and template_columns(layout.labels):
        return _own_rows(layout, layout.labels, folder, files)
    rows = read_labels(layout, folder)
    if not rows:
        return {name: label_row(name, rows, layout) for name in files}
    images: dict[str, str] = {}
    if layout.each == "sequence":
        for name, paths in files.items():
            images |= dict.fromkeys((path.relative_to(folder).as_posix() for path in paths), name)
    names = WrittenNames([*files, *images], folder, (folder / (layout.labels or "")).parent)
    of_touch: dict[str, dict[str, LabelRow]] = {}
    of_folder: dict[str, tuple[int, LabelRow]] = {}
    missed = []
    for written, row in rows.items():
        found = names.find(written)
        if found is None and (inside := names.inside(written)):
            for name in inside:
                # of two folders, the one that lies in the other: it holds less
                if name not in of_folder or len(inside) < of_folder[name][0]:
                    of_folder[name] = len(inside), row
            continue
        if found is None:
            missed.append((written, row))
            continue
        mine = of_touch.setdefault(images.get(found, found), {})
        if found in mine:
            raise DataError(f"{row.where}: {found!r} has a row already ({mine[found].where})")
        mine[found] = replace(row, words={**row.words, **_names(found, layout)})
    # numbers in place of names, as a table counts its trials
    told = recordings_of([written for written, _ in missed], [*files]) if missed else {}
    if len(told) < len(missed) and images:
        told = {**recordings_of([one for one, _ in missed], [*images]), **told}
    for written, row in missed:
        for name in told.get(written, ()):
            mine = of_touch.setdefault(images.get(name, name), {})
            if name in mine:
                raise DataError(f"{row.where}: {name!r} has a row already ({mine[name].where})")
            mine[name] = replace(row, words={**row.words, **_names(name, layout)})
    missed = [(written, row) for written, row in missed if written not in told]
    for name, (_, row) in of_folder.items():
        if (touch := images.get(name, name)) not in of_touch:
            of_touch[touch] = {name: replace(row, words={**row.words, **_names(name, layout)})}
    elsewhere = names_below(folder) if missed else frozenset()
    for written, row in missed:
        plain = names.plain(written)
        exists = is_there(plain, folder) or plain in elsewhere
        # one CSV may label the files of several layouts: theirs pass, once some are ours
        if of_touch and exists and not names.any_below(plain):
            continue
        what = f"no file in {folder}"
        if exists:
            what = f"nothing that layout {layout.name!r} reads in {folder}"
        raise DataError(
            f"{row.where}: {written!r} names {what} (one that there is: {names.nearest(plain)!r}); "
            "correct the row, or remove it"
        )
    merged = {name: _merged(name, mine, layout) for name, mine in of_touch.items()}
    header = next(iter(rows.values()))
    return {name: merged.get(name) or label_row(name, {"": header}, layout) for name in files}


def _own_rows(
    layout: DatasetLayout, template: str, folder: Path, files: Mapping[str, Sequence[Path]]
) -> dict[str, LabelRow]:
    """The row of each touch from a file of its own, or of its folder; see `match_labels`."""
    found: dict[str, LabelRow] = {}
    of_file: dict[Path, list[str]] = {}  # touches of one folder share its file
    for name in files:
        filled = LabelRow(name, {}, _names(name, layout)).fill(template)
        of_file.setdefault(folder / (filled or ""), []).append(name)
    for path, touches in of_file.items():
        many = "*" in path.name
        if not (any(path.parent.glob(path.name)) if many else path.is_file()):
            continue
        rows = read_cells(path, [*layout.words])
        if not rows:
            raise DataError(
                f"{path}: a line of names of columns, and no row; if that line is a text, write "
                "the name of its column above it (text), or remove the file"
            )
        if len(rows) == 1 and not many:
            found |= {name: _row(name, *rows[0], layout) for name in touches}
            continue
        if not many and not template_columns(layout.key) and layout.key not in rows[0][1]:
            series = {name: _of_series(name, path, rows, layout) for name in touches}
            if any(row.cells.values() for row in series.values()):
                found |= series
                continue
        touch_of = {
            one.relative_to(folder).as_posix(): name for name in touches for one in files[name]
        }
        touch_of |= {name: name for name in touches}
        names = WrittenNames(touch_of, folder, path.parent)
        mine: dict[str, dict[str, LabelRow]] = {}
        for where, cells in rows:
            for column in template_columns(layout.key) or [layout.key]:
                if column not in cells:
                    raise ConfigError(
                        f"{path}: {len(rows)} rows, so key: names the column of the files that "
                        f"they are of: {unknown('column', column, cells)}"
                    )
            if template_columns(layout.key):
                cells = joined(cells, layout.key)
            if file := names.find(cells[layout.key]):
                mine.setdefault(touch_of[file], {})[file] = _row(file, where, cells, layout)
        found |= {name: _merged(name, inside, layout) for name, inside in mine.items()}
    header = dict.fromkeys((column for row in found.values() for column in row.words), "")
    return {
        name: replace(found[name], words=header | dict(found[name].words))
        if name in found
        else LabelRow(name, {}, header | _names(name, layout))
        for name in files
    }


def _of_series(
    name: str, path: Path, rows: Sequence[tuple[str, Mapping[str, str]]], layout: DatasetLayout
) -> LabelRow:
    """The row of a touch from a series over time: the values common to all its rows."""
    first, cells = rows[0][1], dict[str, str]()
    mixed: dict[str, str] = {}
    for column, value in first.items():
        other = next((row for row in rows if row[1][column] != value), None)
        cells[column] = "" if other else value
        if other:
            mixed[column] = (
                f"{other[0]}: {column} is {other[1][column]!r} here and {value!r} in {rows[0][0]}, "
                f"both of {name}"
            )
    row = _row(name, str(path), cells, layout)
    return replace(row, cells={k: v for k, v in row.cells.items() if k in cells}, mixed=mixed)


def _merged(name: str, rows: Mapping[str, LabelRow], layout: DatasetLayout) -> LabelRow:
    """One row of a touch: the common values of its rows, with differing columns in ``mixed``."""
    whole = rows.get(name)
    if len(rows) == 1 and whole is not None:
        return whole
    images = {file: row for file, row in rows.items() if file != name}
    names = _names(name, layout)
    cells: dict[str, str] = {layout.key: name}
    words: dict[str, str] = {layout.key: name}
    mixed: dict[str, str] = {}
    for column in next(iter(rows.values())).cells:
        if column == layout.key:
            continue
        given = {row.cells[column]: row for row in rows.values() if row.cells[column]}
        cells[column] = words[column] = ""
        if not given:
            continue
        first, *others = given.values()
        if others:
            other = others[0]
            mixed[column] = (
                f"{other.where}: {column} is {other.cells[column]!r} here and "
                f"{first.cells[column]!r} in {first.where}, both of {name}"
            )
        else:
            cells[column], words[column] = first.cells[column], first.words[column]
    where = next(iter(rows.values())).where
    return LabelRow(where, cells, words | names, images, mixed)


def row_of_series(
    row: LabelRow, series: str, images: Iterable[str], layout: DatasetLayout
) -> LabelRow:
    """The row of one of several series of images in a folder, with the column ``series``."""
    own = {name: row.images[name] for name in images if name in row.images}
    name = row.words["file"]
    merged = _merged(name, own, layout) if own else row
    return replace(merged, words={**merged.words, **_names(name, layout), "series": series})


def _names(name: str, layout: DatasetLayout) -> dict[str, str]:
    path = Path(name)
    folder = path.parent
    stem = path.name if layout.each == "sequence" else path.stem  # a folder has no ending
    return {
        "file": name,
        "stem": stem,
        "prefix": name_prefix(stem),
        "rest": name_rest(stem),
        "folder": folder.name,
        "parent": folder.parent.name,
        "above": folder.as_posix(),
    }


def _word(words: Mapping[str, str] | None, value: str, where: str) -> str:
    if words is None or (not value and "" not in words):
        return value
    if value not in words:
        known = ", ".join(sorted(words))
        raise DataError(f"{where}: {value!r} has no word (there are words for: {known}); add one")
    return words[value]
