"""Touches of a layout: their files in order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, pairwise
from pathlib import Path

from tactileforge.data.frames.stacks import open_film
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.reading.files import deeper, kind_of, matching_files
from tactileforge.reading.frame_clock import Clocks
from tactileforge.reading.image_rows import ImageRows
from tactileforge.reading.label_rows import LabelRow, match_labels, row_of_series, rows_in_turn
from tactileforge.reading.layout import DatasetLayout
from tactileforge.reading.name_times import name_times
from tactileforge.reading.order import order_doubt
from tactileforge.reading.series import names_of, series_of
from tactileforge.reading.templates import template_columns
from tactileforge.reading.touch import LayoutTouch
from tactileforge.reading.trials import TRIAL


class FoundTouches:
    """Finds the touches of a layout; reads only the labels.

    Args:
        layout: The layout.
        folder: Its folder.
        doubts: Names of doubtful touches, each with the doubt as a phrase; added to.

    Attributes:
        files: All files of the layout.
        odd: One line for each match of a pattern other than a file.
    """

    def __init__(self, layout: DatasetLayout, folder: Path, doubts: list[tuple[str, str]]) -> None:
        self.layout, self.folder, self.doubts = layout, folder, doubts
        self.files, odd = matching_files(folder, layout.globs, layout.name)
        self.odd = [f"{path}: no file but {kind_of(path)}; left out" for path in odd]

    def touches(self, rows: ImageRows) -> list[LayoutTouch]:
        """The touches, in natural order.

        Raises:
            DataNotFoundError: No file matches.
            DataError: A row of the labels does not match any file.
            ConfigError: A pattern is invalid.
        """
        layout = self.layout
        if not self.files:
            raise DataNotFoundError(
                f"{self.folder}: no file matches {' or '.join(layout.globs)!r}"
                f"{deeper(self.folder, layout.globs, layout.name)}; set data.root to the folder of "
                f"the data, or correct the pattern of layout {layout.name!r}"
            )
        named = self._grouped(self.files)
        of_files = replace(layout, labels=None) if layout.singles else layout
        labels = match_labels(of_files, self.folder, named)
        touches = [
            LayoutTouch(name, paths, labels[name])
            for name, paths in named.items()
            if labels[name].cells or not layout.only
        ]
        if layout.each == "sequence" and not layout.order:
            touches = [*chain(*map(self._series, touches))]
        if layout.films:
            touches = [*chain(*map(self._films, touches))]
        touches = self._in_order(self._without_backgrounds(touches), Clocks(layout, rows))
        return [*chain(*map(self._singles, touches))] if layout.singles else touches

    def _grouped(self, files: list[Path]) -> dict[str, list[Path]]:
        """Files of each touch, by its name from the folder of the layout."""
        layout, grouped = self.layout, dict[Path, list[Path]]()
        rows: dict[str, LabelRow] = {}
        if layout.recording:
            each = {path.relative_to(self.folder).as_posix(): [path] for path in files}
            rows = match_labels(replace(layout, each="touch"), self.folder, each)
        for path in files:
            touch = path.parent if layout.each == "sequence" else path
            if layout.recording:
                row = rows[path.relative_to(self.folder).as_posix()]
                group = row.fill(layout.recording)
                if not group:
                    raise DataError(
                        f"{row.where}: no value for recording: {layout.recording!r}; fill it in, "
                        "or move the image out"
                    )
                touch /= group
            grouped.setdefault(touch, []).append(path)
        return {touch.relative_to(self.folder).as_posix(): of for touch, of in grouped.items()}

    def _without_backgrounds(self, touches: list[LayoutTouch]) -> list[LayoutTouch]:
        """Touches without the background images, and without touches left empty."""
        rule = self.layout.background
        if rule is None or rule.file is None:
            return touches
        # a video may name itself, with the frames in it: one file for all is not a touch
        if self.layout.each == "video" and template_columns(rule.file):
            return touches
        names = {touch.row.fill(rule.file) for touch in touches}
        still = {self.folder / name for name in names if name is not None}
        kept = [
            replace(touch, paths=[path for path in touch.paths if path not in still])
            for touch in touches
        ]
        # the only video may name itself, too
        return [touch for touch in kept if touch.paths] or touches

    def _in_order(self, touches: list[LayoutTouch], clocks: Clocks) -> list[LayoutTouch]:
        """Touches with their images in the layout's order."""
        if self.layout.each != "sequence":
            return touches
        out = []
        for touch in touches:
            paths = clocks.ordered(touch.paths, partial(touch.path, self.folder))
            if not self.layout.order and (doubt := order_doubt(paths)):
                self.doubts.append((touch.name, doubt))
            out.append(replace(touch, paths=paths))
        return out

    def _films(self, touch: LayoutTouch) -> Iterator[LayoutTouch]:
        """The touch of each chosen stream of a video; those of one file are held out together."""
        for name, number in (self.layout.films or {}).items():
            key = f"{touch.name}#{name}" if name else touch.name
            yield replace(touch, name=key, folder=touch.name, stream=number)

    def _singles(self, touch: LayoutTouch) -> Iterator[LayoutTouch]:
        """A touch of each frame of a film, with the row of labels in its place."""
        try:
            count = len(open_film(touch.paths[0], touch.stream, self.layout.white))
        except DataError:  # named when it is opened
            yield touch
            return
        rows = [touch.row] * count
        if self.layout.labels:
            path = touch.path(self.folder, self.layout.labels)
            rows = rows_in_turn(self.layout, path, touch.name)
            if len(rows) != count:
                raise DataError(
                    f"{path}: {len(rows)} rows for the {count} pictures of {touch.name}; give one "
                    "for each, in order"
                )
        for frame, row in enumerate(rows):
            folder = f"{touch.folder}/{frame:06d}" if touch.folder else ""
            name = f"{touch.name}/{frame:06d}"
            yield replace(touch, name=name, folder=folder, row=row, frame=frame)

    def _series(self, touch: LayoutTouch) -> Iterator[LayoutTouch]:
        """The touch, or one for each series of its folder."""
        found = series_of(touch.paths)
        if len(found) == 1:
            yield touch
            return
        names = [repr(name) for name, paths in found.items() if len(paths) > 1]
        more = ", ..." if len(names) > 3 else ""
        above, slash, _ = self.layout.globs[0].rpartition("/")
        pattern = above + slash + names_of(next(iter(found.values())))
        self.doubts.append(
            (
                touch.name,
                f"{len(names)} series of images in one folder, {', '.join(names[:3])}{more}, are "
                f"each taken for a recording; images: {pattern!r} would read only {names[0]}",
            )
        )
        rows = {}
        for name, paths in found.items():
            images = [path.relative_to(self.folder).as_posix() for path in paths]
            rows[name] = row_of_series(touch.row, name, images, self.layout)
        is_one = self._is_one_take([(found[name], rows[name]) for name in found])
        for name, paths in found.items():
            key = f"{touch.name}/{name}".removeprefix("./")
            # sensors of one take, but not takes of one folder, are held out together
            folder = touch.name if is_one and not TRIAL.match(name) else ""
            yield replace(touch, name=key, paths=paths, row=rows[name], folder=folder)

    def _is_one_take(self, series: Sequence[tuple[list[Path], LabelRow]]) -> bool:
        """Whether series may be of one take: of one object, and not one after the other."""
        several = [(paths, row) for paths, row in series if len(paths) > 1]
        if self.layout.object and len({row.fill(self.layout.object) for _, row in several}) > 1:
            return False
        spans = [span_of(paths) for paths, _ in several]
        dated = sorted(span for span in spans if span is not None)
        after = [before[1] < first[0] for before, first in pairwise(dated)]
        return len(dated) < len(spans) or not after or not all(after)


def span_of(paths: Sequence[Path]) -> tuple[float, float] | None:
    """Times of the first and last image by dates in their names, s; None without."""
    found = name_times([paths[0].stem, paths[-1].stem], None)
    if found.start is None or found.times is None:
        return None
    start = float(found.start)
    return start, start + float(found.times[-1])
