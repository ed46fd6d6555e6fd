"""Families of tables beside recordings: one table a recording or folder, or one for all."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, combinations, islice, permutations, takewhile
from os.path import normpath
from pathlib import Path, PurePath
from typing import TypeAlias

from tactileforge.data.labels.missing import stated
from tactileforge.errors import TactileForgeError
from tactileforge.reading.guessing.view_words import apart_by_capitals
from tactileforge.reading.order import name_prefix, name_rest
from tactileforge.reading.records import FILE_COLUMN, RECORDS
from tactileforge.reading.sides import SIDE_NAMES
from tactileforge.reading.tables import as_one_row, joined, read_cells
from tactileforge.reading.trial_rows import RECORDING_WORDS, recordings_of
from tactileforge.reading.written_names import ENDING, is_absolute, moved_path

Cells: TypeAlias = Sequence[Mapping[str, str]]
Parts: TypeAlias = tuple[str, ...]

#: Parts at each end of a very deep path by which tables are compared with it.
_DEEP = 6
#: Smallest share of files or names in a table, for the table to be about them.
_ABOUT = 0.8
#: Headers of columns that tell recordings apart.
RECORDING = re.compile(
    rf"(?:{RECORDING_WORDS})"
    r"(?:_?(?:id|index|idx|number|no|name))?"
)
#: Headers of numbers of rows.
_ID = re.compile(r"id|idx|index|number|no|nr")
#: A part of a name, other than a measured value.
_PART = re.compile(r"\d+(?:\.0+)?|\d+(?:[-_:]\d+)+|.*[^\W\d_].*")
#: Columns that may name recordings together, and the share of their rows that must.
_MOST_COLUMNS, _MOST_PART = 5, 0.5
#: Marks between the names of a folder and of a recording in it, in the name of a table.
_MARKS = "_-."
#: Marks between the words of a name.
_BETWEEN = "_-. "


@dataclass(frozen=True)
class Units:
    """Recordings of a guess.

    Attributes:
        root: Folder of the layout.
        each: ``video``, ``touch`` or ``sequence``.
        files: Path of each recording from the root (a file, or a folder of images), with the paths
            of its files.
        count: Frames of the first recording.
        seconds: Duration of the first recording.
        is_timed: Whether names tell the times of its frames.
        is_dated: Whether these are since 1970.
    """

    root: Path
    each: str
    files: Mapping[Parts, Sequence[Path]]
    count: int
    seconds: float
    is_timed: bool
    is_dated: bool


@dataclass
class Family:
    """Tables of one template.

    Attributes:
        template: Path from the root, with the names of a recording in braces.
        files: Paths of the tables.
        unit: A recording of the first table.
        rows: Cells of that table.
        key: Column with the names of images or recordings; None without one.
        apart: Column that names the recording of each of several rows, in a table of several; None
            for other tables.
        side: Side of the touch that is asked for, such as ``left``; "" for none.
    """

    template: str
    unit: Parts
    files: list[Path] = field(default_factory=list)
    rows: Cells = ()
    side: str = ""
    key: str | None = None
    apart: str | None = None

    @property
    def is_own(self) -> bool:
        """Whether each recording has a table, or shares it with those of its folder."""
        return "{" in self.template

    @property
    def is_numbered(self) -> bool:
        """Whether columns have numbers in place of names, as those of an array."""
        return bool(self.rows) and all(
            name == str(i) for i, name in enumerate(islice(self.rows[0], 1000))
        )

    def column(self, pattern: re.Pattern[str]) -> str | None:
        """The first column of a pattern."""
        header = self.rows[0] if self.rows else {}
        return next((name for name in header if fits(pattern, name)), None)


def fits(pattern: re.Pattern[str], title: str) -> bool:
    """Whether a header is of a pattern in small letters, or so with its capitals taken apart.

    Example:
        >>> fits(re.compile("time_s"), "TimeS"), fits(re.compile("fx"), "Fx")
        (True, True)
    """
    title = title.strip()
    return any(pattern.fullmatch(one.lower()) for one in (title, apart_by_capitals(title)))


def templates(files: Sequence[Path], units: Units) -> list[Family]:
    """Files beside recordings by their template, without rows."""
    place = _Places(units)
    found: dict[str, Family] = {}
    for path in files:
        template, unit = place.of(path.relative_to(units.root))
        found.setdefault(template, Family(template, unit)).files.append(path)
    return list(found.values())


def families(tables: Sequence[Path], units: Units) -> list[Family]:
    """Readable tables by template, each with the rows of the first one."""
    names = {path.name for paths in units.files.values() for path in paths}
    names |= {parts[-1] for parts in units.files if parts}
    names |= {ENDING.sub("", name) for name in names}
    folders = {part for parts in units.files for part in parts[:-1]}
    out = []
    for family in templates(tables, units):
        path = family.files[0]
        if family.template.rpartition("/")[2].startswith("*"):
            path, family.key = path.with_name(f"*{path.suffix}"), FILE_COLUMN
        try:
            rows = read_cells(path, [])
            is_of_image = units.each == "touch" and re.search(r"\{(?:stem|rest)\}", family.template)
            family.rows = [cells for _, cells in (as_one_row(rows) if is_of_image else rows)]
        except TactileForgeError:  # the reader names it, once it is told to read it
            continue
        if family.key:  # others may lie beside those of images
            family.rows = [row for row in family.rows if row[FILE_COLUMN] in names]
        while family.rows and not any(family.rows[-1].values()):
            family.rows = family.rows[:-1]
        if not family.rows:
            continue
        family.key = family.key or _key(family, names, folders, units)
        if len(family.files) == 1 and family.key and "*" not in family.template:
            family.template = family.files[0].relative_to(units.root).as_posix()
        family.apart = _apart(family, units)
        key = None if _is_one_each(family) else _joint_key(family, units)
        table = [joined(cells, key) for cells in family.rows] if key else []
        are_rows = key is not None and len({cells[key] for cells in table}) == len(table)
        # rows of a recording each, before those of its trial
        if key and (are_rows or not family.apart):
            family.rows = table
            family.key, family.apart = (key, None) if are_rows else (None, key)
            family.template = path.relative_to(units.root).as_posix()
        out.append(family)
    return out


class _Places:
    """Templates of tables by their places: each is of the recording most like it.

    That is the one with most parts of the table's path in its own, in their order.
    """

    def __init__(self, units: Units) -> None:
        self.units = units
        self._root: Parts = tuple(_common([parts[:-1] for parts in units.files]))
        self._images = {
            parts: {path.stem for path in paths}
            for parts, paths in units.files.items()
            if units.each == "sequence"
        }
        self._ends = self._ends_of_all()
        self._found: dict[Parts, Parts] = {}
        own = {parts: parts[len(self._root) : -1] for parts in units.files}
        # the beginning of a path before other parts of it, and whole names before parts of them
        for parts, folders in own.items():
            for depth in range(len(folders) + 2):
                self._found.setdefault((*folders, self._name(parts))[:depth], parts)
        for place in range(3):
            for parts, folders in own.items():
                for end in [*self._ends[parts]][place : place + 1]:
                    kept = [folders[i] for i in _kept(len(folders))]
                    for size in range(len(kept) + 1):
                        for some in combinations(kept, size):
                            self._found.setdefault(some, parts)
                            self._found.setdefault((*some, end), parts)

    def _name(self, unit: Parts) -> str:
        last = unit[-1] if unit else ""
        return last if self.units.each == "sequence" else PurePath(last).stem

    def _ends_of_all(self) -> dict[Parts, dict[str, str]]:
        """What tables may have of the name of each recording, with the word for it."""
        names = {parts: self._name(parts) for parts in self.units.files}
        first = {name.removesuffix(name_rest(name)).rstrip(_BETWEEN) for name in names.values()}
        # what follows any other first word may be of another recording
        is_of_rest = len(first) == 1 or {word.lower() for word in first} <= SIDE_NAMES
        several = len({*map(name_prefix, names.values())}) > 1 and self.units.each != "touch"
        found: dict[Parts, dict[str, str]] = {}
        for parts, name in names.items():
            ends = found.setdefault(parts, {name: "{stem}"})
            prefix, rest = name_prefix(name), name_rest(name)
            last = name[len(prefix) :].strip(_BETWEEN).lower()
            if prefix and (several or last in SIDE_NAMES | {"after"}):
                ends.setdefault(prefix, "{prefix}")
            if rest and is_of_rest:
                ends.setdefault(rest, "{rest}")
        return found

    def of(self, table: PurePath) -> tuple[str, Parts]:
        """Template of a table, and one of its recordings."""
        folder, stem = table.parts[:-1], table.stem
        if self.units.each == "sequence" and table.suffix.lower() in RECORDS:
            unit, at = self._most_alike(folder, "")
            if stem in self._images[unit]:  # a file per image
                return f"{self._folder(folder, unit, at)}/*{table.suffix}".lstrip("/"), unit
        unit, at = self._most_alike(folder, stem)
        inner = self._folder(folder, unit, at)
        return (f"{inner}/" if inner else "") + self._stem(stem, unit) + table.suffix, unit

    def _most_alike(self, folder: Parts, stem: str) -> tuple[Parts, dict[int, int]]:
        """The recording with most parts of a path, and the places of folders in its own."""
        start = len(_common([folder, self._root]))
        inside = folder[start:]
        ways = [(*inside, *way) for way in _ways(stem)]
        for size in range(len(inside) + 2, -1, -1):
            for parts in ways:
                whole = [tuple(range(size))] if size == len(parts) else []
                for some in chain(whole, combinations(_kept(len(parts)), size)):
                    unit = self._found.get(tuple(parts[i] for i in some))
                    if unit is None:
                        continue
                    at, end = {i: i for i in range(start)}, len(unit)
                    path = (*unit[:-1], self._name(unit)) if unit else ()
                    for i in reversed([i for i in some if i < len(inside)]):
                        end = next(j for j in range(end - 1, -1, -1) if path[j] == parts[i])
                        at[start + i] = end
                    return unit, at
        raise AssertionError("a recording has no parts in common with any path")

    def _stem(self, stem: str, unit: Parts) -> str:
        """Name of a table, with those of its recording in braces."""
        above = unit[-2] if len(unit) > 1 else ""
        for text, word in self._ends[unit].items():
            if _starts(stem, text):
                return word + stem[len(text) :]
            joint = {f"{above}{mark}{text}": mark for mark in _MARKS if above}
            if stem in joint:
                return f"{{folder}}{joint[stem]}{word}"
            # a number may count anything
            if text and name_rest(stem) == text and (word == "{rest}" or not text.isdecimal()):
                return stem.removesuffix(text) + word
        return "{folder}" + stem[len(above) :] if _starts(stem, above) else stem

    def _folder(self, folder: Parts, unit: Parts, at: Mapping[int, int]) -> str:
        """Folder of a table, with the names of the folders of a recording in braces."""
        if self.units.each == "sequence" and folder == unit:
            return "{file}" if folder else ""
        words = {len(unit) - 3: "{parent}", len(unit) - 2: "{folder}", len(unit) - 1: "{stem}"}
        out = [words.get(at[i], part) if i in at else part for i, part in enumerate(folder)]
        common = len(_common([folder, unit[:-1]]))
        if len(self._root) < min(common, len(unit) - 3):  # deeper than these words tell
            out = ["{above}", *[".."] * (len(unit) - 1 - common), *out[common:]]
        return "/".join(out)


def _kept(count: int) -> Sequence[int]:
    """Places of so many parts of a path; of a very deep one, the first and last ones."""
    places = range(count)
    return places if count <= 2 * _DEEP else [*places[:_DEEP], *places[-_DEEP:]]


def _ways(stem: str) -> list[Parts]:
    """Possible parts of a path in the name of a table.

    Example:
        >>> _ways("mug_1_ft")
        [('mug_1_ft',), ('mug_1',), ('mug',), ('mug', '1_ft'), ('mug_1', 'ft'), ('1_ft',)]
    """
    marks = [*re.finditer(r"[_.\- ]+", stem)]
    starts = [(stem[: mark.start()],) for mark in reversed(marks)]
    pairs = [(stem[: mark.start()], stem[mark.end() :]) for mark in marks]
    rest = [(name_rest(stem),)] if marks else []
    return [(stem,), *starts, *pairs, *rest]


def _common(folders: Sequence[Parts]) -> Sequence[str]:
    """The first parts common to some folders."""
    levels = zip(*folders, strict=False)
    return [level[0] for level in takewhile(lambda level: len({*level}) == 1, levels)]


def _starts(stem: str, name: str) -> bool:
    """Whether the name of a table is, or begins with, a recording's."""
    return bool(name) and (stem == name or re.match(rf"{re.escape(name)}[_.\- ]", stem) is not None)


def _filled(family: Family, units: Units) -> Iterator[bool]:
    """Whether each recording has its table."""
    there = {path.relative_to(units.root).as_posix() for path in family.files}
    if "*" in family.template:
        there = {
            f"{name.rpartition('/')[0]}/*{PurePath(name).suffix}".lstrip("/") for name in there
        }
    above = family.template.split("/")[:-1]
    # names of some recordings or folders in a template are of no others
    own = {*above}.intersection(chain.from_iterable(units.files))
    for unit in units.files:
        yield own <= {*unit} and table_of(family, unit, units) in there


def table_of(family: Family, unit: Parts, units: Units) -> str:
    """Path of the table of a recording from the root, by the template of its family."""
    padded = ("", "", *unit)
    stem = padded[-1] if units.each == "sequence" else PurePath(padded[-1]).stem
    name = family.template.replace("{file}", "/".join(unit)).replace("{stem}", stem)
    name = name.replace("{prefix}", name_prefix(stem)).replace("{rest}", name_rest(stem))
    name = name.replace("{folder}", padded[-2]).replace("{parent}", padded[-3])
    return normpath(name.replace("{above}", "/".join(unit[:-1]) or "."))


def is_for_all(family: Family, units: Units) -> bool:
    """Whether each recording has its own table, or all share one."""
    if family.is_own:
        return all(_filled(family, units))
    names = {PurePath(unit[-1]).stem.lower() for unit in units.files if unit}
    return bool(family.key or family.apart) or len(units.files) == 1 or names <= SIDE_NAMES


def without_table(family: Family, units: Units) -> list[Parts]:
    """The recordings without a table, if most have one of their own; [] for other families."""
    if not family.is_own or "*" in family.template:
        return []
    lacking = [
        unit for unit, has in zip(units.files, _filled(family, units), strict=True) if not has
    ]
    if 2 * len(lacking) >= len(units.files):
        return []
    # a table of another recording in its place is none of its own
    return (
        [] if any((units.root / table_of(family, x, units)).exists() for x in lacking) else lacking
    )


def recordings(units: Units, family: Family | None = None) -> list[str]:
    """Paths of recordings from the root; of single images, those of their folders."""
    own: Iterable[Parts] = units.files
    if family is not None and family.is_own:
        table = table_of(family, family.unit, units)
        own = (unit for unit in own if table_of(family, unit, units) == table)
    parts = [unit[:-1] if units.each == "touch" else unit for unit in own]
    return ["/".join(one) for one in dict.fromkeys(parts) if one]


def _apart(family: Family, units: Units) -> str | None:
    """Column of the recording of each of several rows of a table; None without one."""
    names = [] if "*" in family.template else recordings(units, family)
    if len(names) < 2:
        return None
    for title, cells, told in _telling(family.rows[0], family.rows, names):
        # numbers may count anything: as those of recordings, by the name of their column alone
        is_named = not all(map(str.isdecimal, told)) or RECORDING.fullmatch(title.strip().lower())
        are_most = len({*chain.from_iterable(told.values())}) >= _ABOUT * len(names)
        if is_named and are_most and len(cells) > len({*cells}):
            return title
    return None


def _joint_key(family: Family, units: Units) -> str | None:
    """Columns with the names of recordings together, as a template; None for none.

    Where rows of both orders could be meant, neither is.
    """
    if family.is_own or len(family.rows) < 2 or len(units.files) < 2:
        return None
    titles = [name for name in family.rows[0] if _is_name(family, name)][:_MOST_COLUMNS]
    paths = [path for of in units.files.values() for path in of]
    files = (path.relative_to(units.root).as_posix() for path in paths)
    # a column of the names of images, alike in several folders, needs others beside it
    images = {path.name for path in paths}
    is_of_images = any({row[title] for row in family.rows} <= images for title in titles)
    several = () if is_of_images else (tuple(recordings(units)),)
    single = () if family.apart and not is_of_images else (tuple(files),)
    for names in dict.fromkeys((*several, *single)):
        for size in (2, 3):
            found: dict[str, tuple[int, float]] = {}
            for columns in permutations(titles, size):
                key = "/".join(f"{{{name}}}" for name in columns)
                cells = {joined(row, key)[key] for row in family.rows}
                told = recordings_of(cells, names)
                named = [name for members in told.values() for name in members]
                if len(told) > _MOST_PART * len(cells) and len({*named}) == len(named) > 1:
                    found[key] = len(named), len(told) / len(cells)
            best = [key for key, share in found.items() if share == max(found.values())]
            if len(best) == 1:
                return best[0]
    return None


def _is_elsewhere(family: Family, key: str, units: Units) -> bool:
    """Whether rows name images in other folders, here or on another machine."""
    cells = [row[key].replace("\\", "/") for row in family.rows]
    if "*" in family.template or Path(cells[0]).exists():
        return False
    paths = [path.relative_to(units.root).as_posix() for of in units.files.values() for path in of]
    names = {name: name for name in (*paths, *map("/".join, units.files))}
    names |= {str(PurePath(name).with_suffix("")): name for name in names if name}
    if not all(map(is_absolute, cells)):
        last = {"/".join(name.split("/")[-2:]) for name in names}
        return all("/" in cell.removeprefix("./") for cell in cells) and not any(
            "/".join(cell.split("/")[-2:]) in last for cell in cells
        )
    return not any(moved_path(cell, names, units.root) for cell in cells)


def _is_one_each(family: Family) -> bool:
    """Whether the key of a table alone tells its rows apart, and tells what they are of."""
    if family.key is None or "*" in family.template:
        return family.key is not None
    return len({row[family.key] for row in family.rows}) == len(family.rows)


def _is_name(family: Family, title: str) -> bool:
    """Whether cells of a column may be a part of a name: words, or whole numbers."""
    cells = [row[title] for row in family.rows]
    return (
        1 < len({*cells}) < len(cells)
        and all(stated(cell) for cell in cells)
        and all(_PART.fullmatch(cell) for cell in cells)
        and not {"{", "}"} & {*title}
    )


def _key(family: Family, names: set[str], folders: set[str], units: Units) -> str | None:
    """Column with the names of files, or another folder or number of a recording in each row."""
    rows, is_table = family.rows, len(family.rows) > 1 and len(family.files) == 1
    if len(rows) == 1:  # "digit", beside digit.mp4, is a word of its own
        names = {name for name in names if "." in name}
    for known in (names, folders) if is_table else (names,):
        for title in rows[0]:
            cells = [row[title] for row in rows if stated(row[title])]
            found = {cell for cell in cells if cell.replace("\\", "/").rpartition("/")[2] in known}
            # each once: zeros are not names
            is_about = cells and len(found) >= _ABOUT * len(cells if known is names else rows)
            if is_about and not (known is names and _is_elsewhere(family, title, units)):
                return title
    counted = [
        title
        for title in rows[0]
        if RECORDING.fullmatch(title.strip().lower()) or _ID.fullmatch(title.lower())
    ]
    paths = ["/".join(parts) for parts in units.files if parts]
    for title, cells, _ in _telling(counted, rows, paths) if is_table else ():
        if len({*cells}) == len(cells):
            return title
    return None


def _telling(
    titles: Iterable[str], rows: Cells, names: Sequence[str]
) -> Iterator[tuple[str, list[str], Mapping[str, Sequence[str]]]]:
    """Columns with recordings in every cell, with the cells and the recordings by these."""
    for title in titles:
        cells = [row[title] for row in rows]
        told = recordings_of(cells, names)
        if {*cells} <= told.keys():
            yield title, cells, told
