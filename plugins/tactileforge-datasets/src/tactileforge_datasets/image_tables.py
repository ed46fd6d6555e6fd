"""The data set ``image_tables``: tables with images in their cells, in parquet and arrow."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import FrameSubset, Guess, Recording
from tactileforge.data import (
    UNITS,
    EncodedFrames,
    LazyImages,
    check_rising,
    date_unit,
    newtons_of,
    stated,
)
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, check_names, home_path
from tactileforge.reading import (
    ASSUMED_FPS,
    AXES,
    SPLIT_OF_FOLDER,
    Drawn,
    Lines,
    add_once,
    as_texts,
    check_data_licence,
    check_share,
    check_split,
    flat,
    guess_sensor,
    held_out_names,
    matches,
    named_columns,
    scene_among,
    touch_among,
)
from tactileforge_datasets import arrow_files

#: In place of the column that tells recordings apart, where each file is one.
_OF_FILE = "{file}"
#: Name of a part of a table that was written in parts.
_PART = re.compile(r"\d+-of-\d+$|^part-|^shard|^data-\d+$")
#: Most files that are looked at for a guess.
_MOST = 10_000


@dataclass
class _Rows:
    """Rows of a recording: their places, and their plain values."""

    places: list[tuple[str, int]] = field(default_factory=list)
    values: list[Mapping[str, Any]] = field(default_factory=list)


class ImageTables(Drawn):
    """Rows of tables with images in their cells, as Hugging Face's datasets keep them.

    A row is a frame. Rows with one value in the column ``recording`` are a recording, in their
    order, and with ``{file}`` those of a file; without either, a row is a recording of one frame.
    Files are parquet, also those of a download, or the arrow of ``save_to_disk``; parts called
    ``train``, ``test`` and the like keep their side. Names of columns say what is not given here;
    values within others have a point (``force.0``).

    Args:
        root: Folder of the tables, or a single one.
        touch: Columns of images of touch; [] for the only one, or those that are called so.
        camera: Column of images of the scene; "" for none.
        sensor: Type of the sensor, or ``{column}``; "" guesses it.
        force: Columns of x, y and z, N; null for an axis that was not measured.
        sign: Factor of each axis: x to the right, y down, z into the gel, pressing is positive.
        times: Column of the times; "" for even times at ``fps``.
        time_unit: Unit of these times; "" for seconds, or that of dates.
        fps: Rows a second, without times.
        recording: Column that tells recordings apart; ``{file}`` where each file is one, "" where
            each row is one.
        object: Column of the touched object.
        text: Column of captions.
        background: ``first`` where recordings begin without contact, or ``none``.
        licence: Licence of the recordings.
        val: Share of the recordings held out, where files have no validation part.

    Raises:
        ConfigError: An option is invalid.

    Example:
        >>> data = ImageTables("touches", touch=["image"], sensor="digit", force=[None, None, "fz"])
        >>> sorted(data.provides)
        ['force']
    """

    def __init__(
        self,
        root: str,
        touch: str | Sequence[str] = (),
        camera: str = "",
        sensor: str = "",
        force: Sequence[str | None] = (),
        sign: Sequence[float] = (1.0, 1.0, 1.0),
        times: str = "",
        time_unit: str = "",
        fps: float | None = None,
        recording: str = "",
        object: str = "",
        text: str = "",
        background: Literal["first", "none"] = "none",
        licence: str = "",
        val: float = 0.1,
    ) -> None:
        check_share(val)
        if len(sign) != 3 or len(force) not in (0, 3):
            raise ConfigError(
                "data.force: [x, y, z] has three columns, and data.sign three factors"
            )
        if time_unit and time_unit not in UNITS:
            raise ConfigError(f"data.time_unit={time_unit}; give one of {', '.join(UNITS)}")
        self.root, self.val, self.background = home_path(root), val, background
        self.touch, self.camera, self.sensor = tuple(as_texts(touch)), camera, sensor
        self.force, self.sign = tuple(name or "" for name in force), tuple(sign)
        self.times, self.time_unit, self.fps = times, time_unit, fps
        self.recording, self.object, self.text = recording, object, text
        if licence:
            check_data_licence(licence, "data.licence")
        self.licence = licence
        self.skipped: list[str] = Lines()
        self.notes: list[str] = []

    @property
    def provides(self) -> frozenset[str]:
        """Labels of the columns."""
        given = {
            "force": any(self.force),
            "object": bool(self.object),
            "text": bool(self.text),
            "image": bool(self.camera),
        }
        return frozenset(name for name, is_there in given.items() if is_there)

    @property
    def held_out(self) -> list[str]:
        """The held-out unit."""
        if "val" in {side for _, side in self._files}:
            return ["the files of validation and test"]
        unit = f"recording ({self.recording.strip('{}')})" if self.recording else "image"
        return [f"by {unit}, with all its sensors and cameras"] if self.val else []

    @cached_property
    def _files(self) -> list[tuple[Path, str]]:
        """Tables with their side; "" for one without a side."""
        found = [(path, _side(path)) for path in _tables(self.root)]
        if not found:
            raise DataNotFoundError(
                f"{self.root}: no .parquet or .arrow; set data.root to the folder of the tables"
            )
        has_val = any(side == "val" for _, side in found)
        return [(path, (side or "train") if has_val else "") for path, side in found]

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: There is no table.
            DataError: A table is damaged, or not one recording can be read.
            ConfigError: A column does not exist, or a guess is needed for what is not given.
        """
        check_split(split)
        sides = {str(path): side for path, side in self._files}
        if not self.touch or not self.sensor:
            raise ConfigError(
                "data.touch and data.sensor are missing: the columns of images, and the type of "
                "the sensor; tactileforge data inspect FOLDER guesses them"
            )
        opened = 0
        grouped = self._grouped()
        drawn = (name for name, rows in grouped.items() if not sides[rows.places[0][0]])
        held = held_out_names(drawn, self.val)
        for name, rows in grouped.items():
            side = sides[rows.places[0][0]] or ("val" if name in held else "train")
            if side != split:
                continue
            for touch in self.touch:
                try:
                    yield self._open(name, touch, rows)
                    opened += 1
                except DataError as error:
                    add_once(self.skipped, error)
        if not opened and self.skipped:
            raise DataError(f"{self.root}: not one recording can be read; {self.skipped[0]}")

    def _grouped(self) -> dict[str, _Rows]:
        """Rows of each recording, by its name."""
        out: dict[str, _Rows] = {}
        for path, side in self._files:
            schema = arrow_files.read_schema(path)
            images = arrow_files.image_columns(schema)
            check_names(f"column of images of {path}", [*self.touch, *self._cameras], images)
            names = arrow_files.class_names(schema)
            plain = [one for one in schema.names if one not in images]
            part = (
                path.relative_to(self.root).with_suffix("").as_posix() if path != self.root else ""
            )
            for number, row in enumerate(arrow_files.read_plain(path, plain)):
                cells = dict(flat(row, ""))
                if not number:
                    recording = "" if self.recording == _OF_FILE else self.recording
                    asked = [*self.force, self.times, recording, self.object, self.text]
                    check_names(f"column of {path}", [one for one in asked if one], cells)
                for column, known in names.items():
                    if cells.get(column, "").isdecimal() and int(cells[column]) < len(known):
                        cells[column] = known[int(cells[column])]
                name = f"{part}/{number}".removeprefix("/")
                if self.recording == _OF_FILE:
                    name = part or path.stem
                elif self.recording:
                    name = f"{side}/{cells[self.recording]}".removeprefix("/")
                rows = out.setdefault(name, _Rows())
                rows.places.append((str(path), number))
                rows.values.append(cells)
        return out

    @property
    def _cameras(self) -> list[str]:
        return [self.camera] if self.camera else []

    def _open(self, name: str, touch: str, rows: _Rows) -> Recording:
        where = f"{self.root}, {name}"
        frames = _frames(where, rows.places, touch)
        first = rows.values[0]
        sensor = self.sensor
        if sensor.startswith("{"):
            sensor = stated(first.get(sensor.strip("{}"), ""))
        is_first = self.background == "first" and len(frames) > 1
        return Recording(
            key=f"{name}/{touch}" if len(self.touch) > 1 else name,
            sensor=sensor,
            frames=frames,
            times=self._times(rows, where),
            no_contact=FrameSubset(frames, [0]) if is_first else None,
            force=self._forces(rows, where),
            action=None,
            object=stated(first[self.object]) or None if self.object else None,
            text=stated(first[self.text]) or None if self.text else None,
            image=_frames(where, rows.places, self.camera) if self.camera else None,
            labels={},
            source=str(self.root),
            tier=1 if any(self.force) else 5,
            licence=self.licence,
        )

    def _times(self, rows: _Rows, where: str) -> NDArray[np.float64]:
        if not self.times or len(rows.values) == 1:
            return np.arange(len(rows.values)) / (self.fps or ASSUMED_FPS)
        values = np.array([_number(row[self.times], self.times, where) for row in rows.values])
        check_rising(values, where, f"correct {self.times!r}", row="row", shown="{:.10g}")
        unit = self.time_unit or date_unit(values) or "s"
        times: NDArray[np.float64] = (values - values[0]) * UNITS[unit]
        return times

    def _forces(self, rows: _Rows, where: str) -> NDArray[np.float32] | None:
        if not any(self.force):
            return None
        newtons = newtons_of(self.force, None, self.sign, "data", "sign")
        table = [
            [_number(row[name], name, where) if name else np.nan for name in self.force]
            for row in rows.values
        ]
        return (np.array(table) * self.sign * newtons).astype(np.float32)

    @staticmethod
    def recognise(root: Path) -> Guess | None:
        """Guesses the columns of tables with images.

        Raises:
            DataError: Several columns have images, and no name says which are touch.
        """
        files = _tables(root)
        if not files or (root / "meta" / "info.json").is_file():  # LeRobot's
            return None
        schema = arrow_files.read_schema(files[0])
        images = arrow_files.image_columns(schema)
        if not images:
            return None
        touch = images if len(images) == 1 else touch_among(images)
        if not touch:
            raise DataError(
                f"{files[0]}: images in {', '.join(images)}; say which are touch: "
                f"data=image_tables data.touch=[{images[0]}]"
            )
        plain = [name for name in schema.names if name not in images]
        rows = [dict(flat(row, "")) for row in islice(arrow_files.read_plain(files[0], plain), 256)]
        if not rows:
            return None
        others = [one for one in images if one not in touch]
        return _guess(root, files, touch, others, rows)


def _is_a_recording_each(
    files: Sequence[Path], rows: Sequence[Mapping[str, str]], times: str
) -> bool:
    """Whether each of several files is a recording: its times rise, and no name counts parts."""
    if len(files) < 2 or len(rows) < 2 or any(_PART.search(path.stem) for path in files):
        return False
    try:
        values = [float(row[times]) for row in rows]
    except ValueError:
        return False
    return all(after > before for before, after in pairwise(values))


def _guess(
    root: Path,
    files: Sequence[Path],
    touch: Sequence[str],
    others: Sequence[str],
    rows: Sequence[Mapping[str, str]],
) -> Guess:
    """Options of the data set by the names of columns."""
    path, found = files[0], named_columns(list(rows[0]))
    if not found.recording and found.times and _is_a_recording_each(files, rows, found.times):
        found = replace(found, recording=_OF_FILE)
    doubts: list[str] = []
    options: dict[str, Any] = {"root": str(root), "touch": [*touch]}
    words = "_".join([*path.parts[-3:], *touch])
    frames = _frames(str(path), [(str(path), 0)], touch[0])
    options |= guess_sensor(words, lambda: frames.shape, doubts)
    if found.sensor and found.sensor not in touch:
        options["sensor"] = f"{{{found.sensor}}}"
        doubts[:] = [line for line in doubts if not line.startswith("sensor:")]
    if view := scene_among(others):
        options["camera"] = view
        doubts.append(f"camera: {view} is the view of the scene")
    if found.recording:
        options["recording"] = found.recording
        options["background"] = "first"
        said = f"rows are told apart by {found.recording}"
        if found.recording == _OF_FILE:
            said = f"each file is one, as {found.times} rises in it"
        doubts.append(f"recording: {said}")
        doubts.append("background: nothing may touch in the first frame of a recording")
    else:
        doubts.append("recording: no column tells recordings apart, so each row is one")
    if found.recording and found.times:
        options["times"] = found.times
        if found.time_unit:
            options["time_unit"] = found.time_unit
    elif found.recording:
        options["fps"] = ASSUMED_FPS
        doubts.append(f"fps: {ASSUMED_FPS} is assumed, no column tells times")
    if found.force[2]:
        options["force"] = [*found.force]
        doubts.append(f"force: taken for newton, {AXES}")
    for name in ("object", "text"):
        column = getattr(found, name)
        if column and column not in (found.recording, found.sensor):
            options[name] = column
    doubts.append("licence: nothing says it (data.licence)")
    kind = "parquet" if path.suffix == ".parquet" else "arrow of save_to_disk"
    return Guess(options=options, format=f"tables with images, {kind}", score=0.2, doubts=doubts)


def _tables(root: Path) -> list[Path]:
    if root.is_file():
        return [root] if root.suffix in arrow_files.ENDINGS else []
    found = [
        path
        for ending in arrow_files.ENDINGS
        for path in islice(matches(root, f"**/*{ending}"), _MOST)
        # caches of transformations are no data
        if not path.name.startswith(("cache-", "tmp"))
    ]
    return sorted(found)


def _side(path: Path) -> str:
    """Side by the name of a table or its folder; "" for none."""
    words = (re.split(r"[-_.]", path.name)[0], path.parent.name)
    return next(
        (SPLIT_OF_FOLDER[one.lower()] for one in words if one.lower() in SPLIT_OF_FOLDER), ""
    )


def _frames(where: str, places: Sequence[tuple[str, int]], column: str) -> EncodedFrames:
    return EncodedFrames(where, LazyImages(len(places), partial(_picture, [*places], column)))


def _picture(places: Sequence[tuple[str, int]], column: str, i: int) -> bytes:
    path, row = places[i]
    return arrow_files.read_image(path, column, row)


def _number(cell: str, column: str, where: str) -> float:
    """A number; NaN for an empty cell."""
    text = stated(cell)
    try:
        return float(text) if text else float("nan")
    except ValueError:
        raise DataError(f"{where}: {column} is {cell!r}, and no number; correct it") from None
