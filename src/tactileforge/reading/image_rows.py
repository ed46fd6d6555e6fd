"""Look-up of CSV rows by the names of images."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

from tactileforge.errors import ConfigError, DataError
from tactileforge.reading.files import names_below
from tactileforge.reading.records import RECORDS
from tactileforge.reading.tables import Row, read_cells
from tactileforge.reading.templates import template_columns
from tactileforge.reading.trial_rows import recordings_of
from tactileforge.reading.written_names import WrittenNames, is_there

#: Default columns of image names, for a layout without ``key``.
KEYS = ("file", "image", "filename", "file_name", "name", "path", "img")
#: A CSV, its column of names, and the folder of its images; None for all.
_Of: TypeAlias = tuple[Path, str | None, Path | None]


class ImageRows:
    """Finds the CSV row of each image; a CSV is read once.

    A row names an image as `written_names.WrittenNames` allows it.

    Args:
        folder: Folder of the layout.
        images: All images of the layout.
    """

    def __init__(self, folder: Path, images: Sequence[Path]) -> None:
        self.folder = folder
        self.images = images
        self._tables: dict[_Of, dict[Path, Row]] = {}

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
            is_shared: Whether the CSV serves several folders; otherwise bare names are enough.

        Raises:
            DataNotFoundError: There is no such CSV.
            DataError: Two rows name one image, or a row does not name an image.
            ConfigError: A column does not exist.
        """
        of = path, key, None if is_shared else paths[0].parent
        if of not in self._tables:
            images = self.images if is_shared else self._folders.get(paths[0].parent, paths)
            table = self._table(path, key or _key(path, columns), columns, images)
            if not is_shared:
                self._tables.clear()  # a touch's own CSV is read once: keep memory bounded
            self._tables[of] = table
        table = self._tables[of]
        return {number: table[image] for number, image in enumerate(paths) if image in table}

    @cached_property
    def _folders(self) -> dict[Path, list[Path]]:
        """The images of each folder."""
        found: dict[Path, list[Path]] = {}
        for image in self.images:
            found.setdefault(image.parent, []).append(image)
        return found

    def _table(
        self, path: Path, key: str, columns: Sequence[str], images: Sequence[Path]
    ) -> dict[Path, Row]:
        """Rows of a CSV by image."""
        of = {image.relative_to(self.folder).as_posix(): image for image in images}
        names = WrittenNames(of, self.folder, path.parent)
        rows = read_cells(path, [*columns, key])
        is_joint = bool(template_columns(key))
        told = recordings_of([cells[key] for _, cells in rows], [*of]) if is_joint else {}
        found: dict[Path, Row] = {}
        elsewhere: frozenset[str] | None = None
        for where, cells in rows:
            if not cells[key]:
                raise DataError(f"{where}: no name of an image in column {key!r}; fill it in")
            alone = names.find(cells[key])
            for name in [alone] if alone else told.get(cells[key], ()):
                if of[name] in found:
                    first = found[of[name]][0]
                    raise DataError(f"{where}: {name!r} has a row already ({first}); remove one")
                found[of[name]] = where, cells
            # a file per row has others beside it, and a row may name one outside of the pattern
            if alone or cells[key] in told or "*" in path.name:
                continue
            if elsewhere is None:
                elsewhere = names_below(self.folder) - {image.name for image in images}
            plain = names.plain(cells[key])
            bases = self.folder, path.parent
            if plain not in elsewhere and not any(is_there(plain, base) for base in bases):
                raise self._unknown(where, plain, names)
        return found

    def _unknown(self, where: str, name: str, names: WrittenNames) -> DataError:
        """Error about a row of no known image."""
        fix = "correct the row, or remove it"
        if sum(Path(one).name == name for one in names.all) > 1:
            fix = f"several are called so; give the path from {self.folder} on"
        return DataError(
            f"{where}: {name!r} names no image in {self.folder} (one that there is: "
            f"{names.nearest(name)!r}); {fix}"
        )


def names_images(path: Path) -> bool:
    """Whether the rows of a CSV name images, by a column of `KEYS`."""
    rows = read_cells(path, [])
    # a JSON of one image has its values, and no need of its name: {"name": "mug", "force": 2}
    if not rows or (len(rows) == 1 and path.suffix.lower() in RECORDS):
        return False
    return any(name in rows[0][1] for name in KEYS)


def _key(path: Path, columns: Sequence[str]) -> str:
    """Column of the names of images of a CSV."""
    header = list(next(iter(read_cells(path, columns)), ("", {}))[1])
    key = next((name for name in KEYS if name in header), None)
    if key is None:
        raise ConfigError(
            f"{path}: which column names the images? Give key: NAME, one of "
            f"{', '.join(header) or 'its columns'}; or frame: or time: of a recording's rows"
        )
    return key
