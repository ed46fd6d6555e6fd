"""Families of tables beside recordings: one table a recording or folder, or one for all."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice, permutations, takewhile
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
    """Files beside recordings by their template, without rows.

    Args:
        files: Paths of the files.
        units: The recordings.
    """
    place = _Places(units)
    found: dict[str, Family] = {}
    for path in files:
        template, unit = place.of(path.relative_to(units.root))
        found.setdefault(template, Family(template, unit)).files.append(path)
    return list(found.values())


def families(tables: Sequence[Path], units: Units) -> list[Family]:
    """Readable tables by template, each with the rows of the first one.

    Args:
        tables: Paths of tables.
        units: The recordings.
    """
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
        family.key = family.key or _key(family.rows, names)
        if family.key and _is_elsewhere(family, units):
            family.key = None
        if not family.key and len(family.rows) > 1 and len(family.files) == 1:
            family.key = _key(family.rows, folders, are_rows=True) or _number(family.rows, units)
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
    """Templates of tables by their places beside the recordings."""

    def __init__(self, units: Units) -> None:
        self.units = units
        self._exact: dict[tuple[Parts, str], Parts] = {}
        self._prefix: dict[tuple[Parts, str], Parts] = {}
        self._near: dict[tuple[Parts, str], Parts] = {}
        self._alike: dict[tuple[Parts, str, str], Parts] = {}
        self._named: dict[tuple[Parts, str], tuple[Parts, Parts | None]] = {}
        self._part: dict[tuple[Parts, str], tuple[str, Parts]] = {}
        self._mirror: dict[tuple[Parts, Parts, str], Parts] = {}
        self._joint: dict[str, Parts] = {}
        self._inside: dict[Parts, list[Parts]] = {}
        self._below: dict[Parts, Parts] = {}
        self._images: dict[Parts, frozenset[str]] = {}
        names = {parts: self._name(parts) for parts in units.files}
        first = {
            name.removesuffix(name_rest(name)).rstrip(_BETWEEN).lower() for name in names.values()
        }
        # what follows any other first word may be of another recording
        is_of_rest = len(first) == 1 or first <= SIDE_NAMES
        self._shared = len(_common([parts[:-1] for parts in units.files]))
        for parts, paths in units.files.items():
            stem = names[parts]
            if is_of_rest and (rest := name_rest(stem)):
                self._part.setdefault((parts[:-1], rest), ("{rest}", parts))
            prefix = name_prefix(stem)
            if prefix and stem[len(prefix) :].strip(_BETWEEN).lower() in SIDE_NAMES | {"after"}:
                self._part.setdefault((parts[:-1], prefix), ("{prefix}", parts))
            self._exact.setdefault((parts[:-1], stem), parts)
            self._prefix.setdefault((parts[:-1], prefix), parts)
            for depth in range(len(parts)):
                self._near.setdefault((parts[:depth], stem), parts)
            for depth in range(len(parts) - 1):
                self._mirror.setdefault((parts[:depth], parts[depth + 1 : -1], stem), parts)
                self._alike.setdefault((parts[:depth], parts[-2], stem), parts)
            for place, name in ((parts, stem), (parts[:-1], "".join(parts[-2:-1]))):
                for depth in range(len(place)):
                    key = parts[:depth], name
                    if self._named.setdefault(key, (place, parts))[0] != place:
                        self._named[key] = place, None
            for mark in _MARKS if len(parts) > 1 else "":
                self._joint.setdefault(f"{parts[-2]}{mark}{stem}", parts)
            self._inside.setdefault(parts[:-1], []).append(parts)
            inside = parts if units.each == "sequence" else parts[:-1]
            for depth in range(len(inside) + 1):
                self._below.setdefault(inside[:depth], parts)
            if units.each == "sequence":
                self._images[parts] = frozenset(path.stem for path in paths)

    def _name(self, unit: Parts) -> str:
        last = unit[-1] if unit else ""
        return last if self.units.each == "sequence" else PurePath(last).stem

    def of(self, table: PurePath) -> tuple[str, Parts]:
        """Template of a table, and one of its recordings."""
        folder, stem = table.parts[:-1], table.stem
        inside = next(i for i in range(len(folder), -1, -1) if folder[:i] in self._below)
        below = self._below[folder[:inside]]
        if self.units.each == "sequence":
            # a file per image: {file}/*.json
            for of in (folder, below):
                if stem in self._images.get(of, ()) and table.suffix.lower() in RECORDS:
                    return f"{self._folder(folder, of)}/*{table.suffix}".lstrip("/"), of
        unit = self._exact.get((folder, stem)) or self._exact.get((folder[:-1], stem))
        if unit is None:
            beside = [one for one in self._inside.get(folder, ()) if _starts(stem, self._name(one))]
            depths = range(len(folder), -1, -1)
            levels = range(len(folder) - 1, -1, -1)
            mirror = (self._mirror.get((folder[:i], folder[i + 1 :], stem)) for i in levels)
            alike = (self._alike.get((folder[:i], folder[-1], stem)) for i in depths if folder)
            near = (self._near.get((folder[:i], stem)) for i in depths)
            unit = max(beside, key=len, default=None)
            unit = unit or next(filter(None, chain(mirror, alike, near)), None)
            unit = unit or self._joint.get(stem)
        prefix = name_prefix(stem)
        if unit is None and self.units.each == "video" and prefix:
            unit = self._prefix.get((folder, prefix))
            if unit is not None:
                stem = "{prefix}" + stem[len(prefix) :]
        for text in (stem, prefix, name_rest(stem)) if unit is None else ():
            if text and (found := self._part.get((folder, text))):
                word, unit = found
                stem = word.join(stem.rsplit(text, 1))
                break
        if unit is None:  # as in touch/trial_1 and vision/trial_1
            names = (stem, *reversed(folder[inside:]))
            named = (self._named.get((folder[:inside], name)) for name in names)
            unit = next((one[1] for one in named if one and one[1]), below)
        name = self._name(unit)
        above = unit[-2] if len(unit) > 1 else ""
        if unit and _starts(stem, name):
            stem = "{stem}" + stem[len(name) :]
        elif above and stem in (joint := {f"{above}{mark}{name}": mark for mark in _MARKS}):
            stem = f"{{folder}}{joint[stem]}{{stem}}"
        elif _starts(stem, above):
            stem = "{folder}" + stem[len(above) :]
        inner = self._folder(folder, unit)
        return (f"{inner}/" if inner else "") + stem + table.suffix, unit

    def _folder(self, folder: Parts, unit: Parts) -> str:
        """Folder of a table, with the names of the folders of a recording in braces."""
        if self.units.each == "sequence" and folder == unit:
            return "{file}" if folder else ""
        common = len(_common([folder, unit[:-1]]))
        if self._shared < min(common, len(unit) - 3):  # deeper than the names of two folders tell
            up = [".."] * (len(unit) - 1 - common)
            below = [self._braced(part, unit) for part in folder[common:]]
            return "/".join(["{above}", *up, *below])
        words = {len(unit) - 2: "{folder}", len(unit) - 3: "{parent}"}
        # tables in a tree like that of the recordings have their folders from its root on
        is_like = len(folder) == len(unit) - 1
        out = [
            words.get(i, part)
            if folder[: i + 1] == unit[: i + 1] or (is_like and folder[i:] == unit[i:-1])
            else part
            for i, part in enumerate(folder)
        ]
        for i, part in enumerate(out):
            if part == folder[i] and unit[-2:-1] == (part,):
                out[i] = "{folder}"
            if folder[i] == self._name(unit) and (i == len(out) - 1 or out[i] == part):
                out[i] = "{stem}"
        return "/".join(out)

    def _braced(self, part: str, unit: Parts) -> str:
        """A folder of a table, in braces if it has the name of a recording or of its folder."""
        if unit and part == self._name(unit):
            return "{stem}"
        return "{folder}" if len(unit) > 1 and part == unit[-2] else part


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
    """Paths of recordings from the root; of single images, those of their folders.

    Args:
        units: The recordings.
        family: Tables; of several, those that share the first one are meant.
    """
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
    for title in family.rows[0]:
        cells = [row[title] for row in family.rows]
        told = recordings_of(cells, names)
        # numbers may count anything: as those of recordings, by the name of their column alone
        is_named = not all(map(str.isdecimal, told)) or RECORDING.fullmatch(title.strip().lower())
        are_all = (
            len({*chain.from_iterable(told.values())}) >= _ABOUT * len(names)
            and {*cells} <= told.keys()
        )
        if told and is_named and are_all and len(cells) > len({*cells}):
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


def _is_elsewhere(family: Family, units: Units) -> bool:
    """Whether rows name images in other folders, here or on another machine."""
    cells = [row[str(family.key)].replace("\\", "/") for row in family.rows]
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


def _number(rows: Cells, units: Units) -> str | None:
    """Column with the number of another recording in each row; None without one."""
    names = ["/".join(parts) for parts in units.files]
    for title in rows[0]:
        cells = [row[title] for row in rows]
        is_named = RECORDING.fullmatch(title.strip().lower()) or _ID.fullmatch(title.lower())
        if (
            is_named
            and len({*cells}) == len(cells)
            and {*cells} <= recordings_of(cells, names).keys()
        ):
            return title
    return None


def _key(rows: Cells, names: set[str], are_rows: bool = False) -> str | None:
    """Column with the names of files, with ``are_rows`` another in each row; None without one."""
    if len(rows) == 1:  # "digit", beside digit.mp4, is a word of its own
        names = {name for name in names if "." in name}
    for title in rows[0]:
        cells = [row[title] for row in rows if stated(row[title])]
        found = {cell for cell in cells if cell.replace("\\", "/").rpartition("/")[2] in names}
        # each once: zeros are not names
        if cells and len(found) >= _ABOUT * len(rows if are_rows else cells):
            return title
    return None
