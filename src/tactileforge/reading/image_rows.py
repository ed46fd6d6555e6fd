"""Look-up of CSV rows by the names of images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from posixpath import normpath

from tactileforge.errors import ConfigError, DataError
from tactileforge.reading.files import names_below
from tactileforge.reading.records import RECORDS
from tactileforge.reading.tables import Row, read_cells
from tactileforge.reading.templates import template_columns
from tactileforge.reading.trial_rows import recordings_of
from tactileforge.reading.written_names import ends_of, is_absolute, is_there, moved_path

#: Largest number of names that a slip is compared with.
_COMPARED = 2000
#: Default columns of image names, for a layout without ``key``.
KEYS = ("file", "image", "filename", "file_name", "name", "path", "img")


class ImageRows:
    """Finds the CSV row of each image; a CSV is read once.

    A row names an image by its path from the folder of the layout or of the CSV, by its absolute
    path, here or on another machine, or by the end of its path or its name if that is unique; with
    or without the ending.

    Args:
        folder: Folder of the layout.
        images: All images of the layout.
    """

    def __init__(self, folder: Path, images: Sequence[Path]) -> None:
        self.folder = folder
        self.images = images
        self._tables: dict[tuple[Path, str | None], dict[str, Row]] = {}

    def find(
        self,
        path: Path,
        key: str | None,
        columns: Sequence[str],
        paths: Sequence[Path],
        is_shared: bool = True,
    ) -> dict[int, Row]:
        """Place and cells of the row of each image, by its number among the images.

        Args:
            path: Path of the CSV.
            key: Column of the names; None for the first existing one of `KEYS`.
            columns: Columns to read.
            paths: Images of a touch; those without a row are left out of the result.
            is_shared: Whether the CSV serves several touches; otherwise bare names are enough.

        Raises:
            DataNotFoundError: There is no such CSV.
            DataError: Two rows name one image, or a row does not name an image.
            ConfigError: A column does not exist.
        """
        if (path, key) not in self._tables:
            table = self._moved(_table(path, key, columns))
            if key and template_columns(key):
                table = self._joint(table)
            self._check(path, table, self.images if is_shared else paths, is_shared)
            if not is_shared:
                self._tables.clear()  # a touch's own CSV is read once: keep memory bounded
            self._tables[path, key] = table
        table = self._tables[path, key]
        found = {}
        for number, image in enumerate(paths):
            names = self._spellings(image, path, is_shared)
            row = next((table[name] for name in names if name in table), None)
            if row is not None:
                found[number] = row
        return found

    def _moved(self, table: dict[str, Row]) -> dict[str, Row]:
        """The rows, with paths of another machine as those of this folder."""
        if not any(map(is_absolute, table)):
            return table
        inside = [image for image in self.images if image.is_relative_to(self.folder)]
        names = [image.relative_to(self.folder).as_posix() for image in inside]
        there = dict(zip(names, names, strict=True))
        rows: dict[str, Row] = {}
        for written, row in table.items():
            name = moved_path(written, there, self.folder) or written
            if name in rows:
                raise DataError(
                    f"{row[0]}: {name!r} has a row already ({rows[name][0]}); remove one"
                )
            rows[name] = row
        return rows

    def _joint(self, table: dict[str, Row]) -> dict[str, Row]:
        """The rows by image, named by several columns together."""
        names = [
            image.relative_to(self.folder).as_posix()
            for image in self.images
            if image.is_relative_to(self.folder)
        ]
        told = recordings_of(table, names)
        rows: dict[str, Row] = {}
        for written, row in table.items():
            for name in told.get(written, [written]):
                if name in rows:
                    raise DataError(
                        f"{row[0]}: {name!r} has a row already ({rows[name][0]}); remove one"
                    )
                rows[name] = row
        return rows

    def _check(
        self, path: Path, table: dict[str, Row], images: Sequence[Path], is_shared: bool
    ) -> None:
        if "*" in path.name:  # a file per row: others may lie beside those of images
            return
        known = {name for image in images for name in self._spellings(image, path, is_shared)}
        elsewhere: frozenset[str] | None = None
        for name, (where, _) in table.items():
            # A row may name an existing file outside the layout's pattern.
            if name in known or any(is_there(name, base) for base in (self.folder, path.parent)):
                continue
            if elsewhere is None:
                elsewhere = names_below(self.folder) - {image.name for image in images}
            if name in elsewhere:
                continue
            fix = "correct the row, or remove it"
            if sum(image.name == name for image in images) > 1:
                fix = f"several are called so; give the path from {self.folder} on"
            usual = [self._spellings(image, path, is_shared)[0] for image in images]
            near = (get_close_matches(name, usual[:_COMPARED], n=1) or usual)[0]
            raise DataError(
                f"{where}: {name!r} names no image in {self.folder} (one that there is: {near!r});"
                f" {fix}"
            )

    @cached_property
    def _alone(self) -> set[str]:
        """Ends of paths unique to one image."""
        ends = Counter(end for image in self.images for end in self._ends(image))
        return {end for end, count in ends.items() if count == 1}

    def _ends(self, image: Path) -> list[str]:
        """Ends of its path from folders below that of the layout on."""
        return ends_of(image.as_posix().removeprefix(_start(self.folder)))

    def _spellings(self, image: Path, table: Path, is_shared: bool) -> list[str]:
        path = image.as_posix()
        bases = dict.fromkeys(map(_start, (self.folder, table.parent)))
        names = [path.removeprefix(base) for base in bases if path.startswith(base)]
        names.append(path if image.is_absolute() else image.absolute().as_posix())
        names += [end for end in self._ends(image) if not is_shared or end in self._alone]
        return [*names, *(name.removesuffix(image.suffix) for name in names)]


def _start(folder: Path) -> str:
    """Begin of the paths of a folder's files."""
    return "" if folder == Path() else f"{folder.as_posix()}/"


def names_images(path: Path) -> bool:
    """Whether the rows of a CSV name images, by a column of `KEYS`."""
    rows = read_cells(path, [])
    # a JSON of one image has its values, and no need of its name: {"name": "mug", "force": 2}
    if not rows or (len(rows) == 1 and path.suffix.lower() in RECORDS):
        return False
    return any(name in rows[0][1] for name in KEYS)


def _table(path: Path, key: str | None, columns: Sequence[str]) -> dict[str, Row]:
    """Rows of a CSV by image name."""
    if key is None:
        header = list(next(iter(read_cells(path, columns)), ("", {}))[1])
        key = next((name for name in KEYS if name in header), None)
        if key is None:
            raise ConfigError(
                f"{path}: which column names the images? Give key: NAME, one of "
                f"{', '.join(header) or 'its columns'}; or frame: or time: of a recording's rows"
            )
    rows: dict[str, Row] = {}
    for where, cells in read_cells(path, [*columns, key]):
        name = normpath(cells[key].replace("\\", "/")) if cells[key] else ""
        if not name:
            raise DataError(f"{where}: no name of an image in column {key!r}; fill it in")
        if name in rows:
            raise DataError(f"{where}: {name!r} has a row already ({rows[name][0]}); remove one")
        rows[name] = where, cells
    return rows
