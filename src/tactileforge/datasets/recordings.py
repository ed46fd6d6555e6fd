"""The data set ``recordings``: folders of videos or images, described by layouts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

from omegaconf import OmegaConf

from tactileforge.contracts import Guess, Recording
from tactileforge.errors import (
    ConfigError,
    DataError,
    DataNotFoundError,
    check_names,
    command,
    home_path,
)
from tactileforge.reading.drawn import Drawn
from tactileforge.reading.files import DamagedFileError, read_text
from tactileforge.reading.guessing.layout import guess_layout
from tactileforge.reading.layout import (
    EXAMPLE,
    FILE_COLUMNS,
    UNITS_HELD_OUT,
    DatasetLayout,
    parse_layout,
)
from tactileforge.reading.notes import Lines, Notes, add_once
from tactileforge.reading.reader import LayoutReader
from tactileforge.reading.splits import (
    SPLIT_OF_FOLDER,
    check_share,
    check_split,
    held_out_names,
    is_held_out,
    split_parts,
)
from tactileforge.reading.templates import template_columns
from tactileforge.reading.touch import LayoutTouch
from tactileforge.reading.touch_trials import join_trials
from tactileforge.util.strict import build
from tactileforge.util.untrusted import load_yaml

#: Name of a file in the root with the layouts of its data.
LAYOUT_FILE = "tactileforge.yaml"


@dataclass(frozen=True)
class LayoutFile:
    """Contents of `LAYOUT_FILE`."""

    layouts: dict[str, Any] = field(metadata={"example": "{my_touches: {...}}"})


#: A reader, its touches, and the side of each.
_Listed: TypeAlias = tuple[LayoutReader, list[LayoutTouch], list[str]]


class Recordings(Drawn):
    """Touch recordings in folders, described by layouts (`docs/data.md` lists their keys).

    Args:
        root: Folder of the data.
        layouts: Layouts by name; None drops one. Without any, those under the key ``layouts`` of
            ``tactileforge.yaml`` in the root, less the dropped ones; without that file the guess,
            each line of which is one of `notes`.
        val: Share held out for validation; unused by layouts with a split in their labels.
        tracks: Whether layouts' ``tracks`` are read, and their frames to drop left out.
        guess: Whether a layout may be guessed.

    Raises:
        ConfigError: A layout is invalid; names it and the key.

    Example:
        >>> cups = {"videos": "*.mp4", "sensor": "digit", "object": "cup", "background": "none"}
        >>> sorted(Recordings("touches", {"cups": cups}).provides)
        ['object']
    """

    def __init__(
        self,
        root: str,
        layouts: Mapping[str, Any] | None = None,
        val: float = 0.1,
        tracks: bool = True,
        guess: bool = True,
    ) -> None:
        check_share(val)
        self.root = home_path(root)
        self.val = val
        self.tracks = tracks
        self.guess = guess
        self.skipped: list[str] = Lines()
        self._noted = Notes()
        self._split_up: dict[str, _SplitUp] = {}
        self._listed: dict[str, list[_Listed]] = {}
        given = _as_plain(layouts or {})
        self._given = {name: layout for name, layout in given.items() if layout is not None}
        self._left_out = sorted(given.keys() - self._given.keys())
        self._parsed = _parse_all(self._given)

    @staticmethod
    def recognise(root: Path) -> Guess | None:
        """Guess the layout of a folder of videos or images, if it has no layout of its own."""
        if not root.is_dir():
            return None
        if (root / LAYOUT_FILE).is_file():
            options = {"root": str(root)}
            return Guess(options=options, format=f"layouts of {LAYOUT_FILE}", score=1.0)
        return guess_layout(root)

    @cached_property
    def layouts(self) -> list[DatasetLayout]:
        """The layouts of the configuration, or those of the root."""
        if self._given:
            return self._parsed
        shipped = _shipped(self.root, self.guessed)
        check_names("layout in data.layouts", self._left_out, shipped)
        kept = [layout for name, layout in shipped.items() if name not in self._left_out]
        if not kept:
            raise ConfigError(f"{self.root}: every layout is null; leave one in data.layouts")
        return kept

    @property
    def guessed(self) -> Mapping[str, Any]:
        """The guessed options; {} where a layout is given, or no guess fits."""
        found = self._guess
        return {"layouts": found.options["layouts"]} if found else {}

    @cached_property
    def _guess(self) -> Guess | None:
        has_own = self._given or _layout_file(self.root).is_file()
        return None if has_own or not self.guess else guess_layout(self.root)

    @property
    def provides(self) -> frozenset[str]:
        """Labels provided by at least one layout; empty where there is none."""
        try:
            return frozenset(label for layout in self.layouts for label in layout.provides)
        except DataNotFoundError:
            return frozenset()

    @property
    def notes(self) -> list[str]:
        """Doubts about the recordings read so far, one line per kind."""
        doubts = {name: of.doubt for name, of in self._split_up.items()}
        told = [*self._guess.doubts, self._correction] if self._guess else ()
        return [
            *(f"guessed, to be checked: {doubt}" for doubt in told),
            *self._noted.lines(),
            *(f"{name}: {one}" for name, one in doubts.items() if one),
        ]

    @property
    def _correction(self) -> str:
        """Line on the findings of a guess, and on its correction."""
        sides = [side for of in self._split_up.values() for side in of.sides]
        found = f"{len(sides)} recordings were found, {sides.count('val')} of them held out; "
        return (
            f"{found if sides else ''}{command('data', 'inspect', str(self.root))} shows each "
            f"guess, and writes the layout to correct and to keep as {self.root / LAYOUT_FILE}"
        )

    @property
    def held_out(self) -> list[str]:
        """The held-out units, one line per layout read so far."""
        return [f"{name}: {of.held_out}" for name, of in self._split_up.items()]

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, layout by layout, files in natural order.

        A recording is left out and listed in ``skipped`` if it, its background or its camera view
        cannot be opened.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: A folder or file is missing.
            DataError: Labels contradict the files, or no recording for training can be opened.
            ConfigError: An unknown split, or an unknown sensor or action in a label.
        """
        check_split(split)
        opened, failed = 0, []
        layouts = (
            self.layouts if self.tracks else [replace(one, tracks=None) for one in self.layouts]
        )
        # listed once for both splits, which are then of the same files; anew for the next pair
        listed, self._listed = self._listed.pop(split, None), {}
        if listed is None:
            listed = self._split([LayoutReader(layout, self.root) for layout in layouts])
            self._listed = {"val" if split == "train" else "train": listed}
        for of, touches, sides in listed:
            reader = of.again()
            try:
                for touch, side in zip(touches, sides, strict=True):
                    if side not in (split, "time"):
                        continue
                    labelled = _labelled(reader, touch)
                    while reader.doubts:
                        name, doubt = reader.doubts.pop()
                        self._noted.add(f"{reader.layout.name}/{name}", doubt)
                    if isinstance(labelled, str):
                        failed.append(labelled)
                        add_once(self.skipped, labelled)
                        continue
                    opened += 1
                    for recording in labelled:
                        if side == "time":
                            yield from split_parts(recording, self.val, split)
                        else:
                            yield recording
            finally:
                reader.index.save()
            tagged, images = reader.tagged
            if 0 < tagged < images:
                self._noted.add(
                    reader.layout.name,
                    f"{tagged} of {images} images have an EXIF orientation, and are turned by it; "
                    "were all taken the same way up?",
                )
        # one bad file is skipped, but a whole set of them is a mistake in the layout
        if failed and not opened and split == "train":
            raise DataError(f"not one of {len(failed)} recordings can be opened; {failed[0]}")

    def _split(self, readers: Sequence[LayoutReader]) -> list[_Listed]:
        """Touches of each layout, with their sides, before anything is opened.

        A split must not depend on readable files.
        """
        listed = [(reader, reader.touches()) for reader in readers]
        found = []
        for (reader, touches), named in zip(listed, join_trials(listed), strict=True):
            for line in reader.odd:
                add_once(self.skipped, line)
            told = [
                _side(reader.layout, touch, *trial)
                for touch, trial in zip(touches, named, strict=True)
            ]
            found.append((reader, touches, [trial for _, trial in named], told))
        drawn = [name for *_, told in found for name, _ in told if name]
        sides_told = {side for *_, told in found for _, side in told}
        held = held_out_names(drawn, 0 if {"val", "time"} & sides_told else self.val)
        out = []
        for reader, touches, trials, told in found:
            sides = [
                side or ("val" if is_held_out(name, self.val, held) else "train")
                for name, side in told
            ]
            self._split_up[reader.layout.name] = _SplitUp(reader.layout, trials, sides)
            out.append((reader, touches, sides))
        return out


def _labelled(reader: LayoutReader, touch: LayoutTouch) -> list[Recording] | str:
    """Recordings of a touch, or a line about a damaged file of it."""
    try:
        frames = reader.open(touch)
    except DataError as error:
        return str(error)
    try:
        return list(reader.label(touch, frames))
    except DamagedFileError as error:
        return str(error)


@dataclass(frozen=True)
class _SplitUp:
    """The trial and the side of each recording of a layout."""

    layout: DatasetLayout
    trials: list[str]
    sides: list[str]

    @property
    def held_out(self) -> str:
        """The held-out unit, in words."""
        unit, count = self.layout.hold_out, len(set(self.trials))
        what = f"{len(self.trials)} recordings of {count} trials"
        if unit in ("none", "all"):
            return f"{what}, all for {'train' if unit == 'none' else 'val'}"
        if unit == "time":
            return f"{what}, blocks of time of each"
        by = {"trial": "trials, with all sensors, cameras and repetitions of one"}
        by |= {"recording": "recordings, each by itself", "object": "objects"}
        held = self.sides.count("val")
        said = "1 recording" if held == 1 else f"{held} recordings"
        return f"{what}, by {by.get(unit, unit)}: {said} held out"

    @property
    def doubt(self) -> str:
        """Trials on both sides, as a phrase; "" without any."""
        sides: dict[str, set[str]] = {}
        for trial, side in zip(self.trials, self.sides, strict=True):
            sides.setdefault(trial, set()).add(side)
        both = [trial for trial, of in sides.items() if len(of) > 1]
        if not both or self.layout.hold_out == "object":
            return ""
        return (
            f"{len(both)} trials, such as {both[0]!r}, are in training and validation, by "
            f"hold_out: {self.layout.hold_out}; hold_out: trial holds out all sensors of one"
        )


def _side(layout: DatasetLayout, touch: LayoutTouch, home: str, trial: str) -> tuple[str, str]:
    """Name by which the side of a touch is drawn, or ``train``, ``val`` or ``time``; "" for one."""
    row, unit_of = touch.row, layout.hold_out
    side = {"none": "train", "all": "val"}.get(unit_of) or row.fill(unit_of)
    unit = {"trial": trial, "recording": touch.name, "object": trial}.get(unit_of)
    if unit_of == "object" and layout.object and (name := row.fill(layout.object)):
        return name, ""
    of_file = set(template_columns(unit_of)) <= {*FILE_COLUMNS} and unit_of not in UNITS_HELD_OUT
    if of_file and side and side.casefold() not in SPLIT_OF_FOLDER:
        unit = side
    if unit is not None:
        return f"{home}/{unit}", ""
    if side not in ("train", "val", "time"):
        column = unit_of.strip("{}")
        raise DataError(
            f"{row.where}: the split is {side or ''!r}, but must be train or val; layout "
            f'{layout.name!r} can say what it means: words: {{{column}: {{"{side or ""}": train}}}}'
        )
    return "", side


def _parse_all(layouts: Mapping[str, Any]) -> list[DatasetLayout]:
    return [parse_layout(name, _as_plain(config)) for name, config in layouts.items()]


def _as_plain(config: Any) -> Any:
    """Plain data; a mapping's keys are names, though YAML reads some as numbers."""
    plain = OmegaConf.to_container(config, resolve=True) if OmegaConf.is_config(config) else config
    if not isinstance(plain, Mapping):
        return plain
    return {str(key): value for key, value in plain.items()}


def _layout_file(root: Path) -> Path:
    """Path of the data's `LAYOUT_FILE`.

    Raises:
        DataNotFoundError: There is no such folder, or the file has another ending.
    """
    path = root / LAYOUT_FILE
    if not root.is_dir():
        found = "a file, and no folder" if root.is_file() else "no such folder"
        raise DataNotFoundError(f"{root}: {found}; set data.root to the folder of the data")
    if not path.is_file():
        # the name with another ending is the likeliest reason
        for other in sorted(root.iterdir()):
            if other.stem.lower() == path.stem and other.suffix.lower() in (".yml", ".yaml"):
                raise DataNotFoundError(f"{path}: no such file; rename {other.name} to {path.name}")
    return path


def _shipped(root: Path, guessed: Mapping[str, Any]) -> dict[str, DatasetLayout]:
    """The layouts of the data's `LAYOUT_FILE`, by name, or the guessed ones."""
    path = _layout_file(root)
    if guessed:
        return {layout.name: layout for layout in _parse_all(guessed["layouts"])}
    if not path.is_file():
        raise DataNotFoundError(
            f"{path}: no such file, and no layouts are given. Copy those that "
            f"{command('data', 'inspect', str(root))} guesses and shows, set data.root to a folder "
            f"that has it, or write it, for example:\n{EXAMPLE}"
        )
    try:
        content = load_yaml(read_text(path))  # without interpolation: the file is untrusted
    except ValueError as error:
        raise ConfigError(f"{path}: {error}; correct it") from error
    given = {
        str(name): layout
        for name, layout in build(LayoutFile, str(path), content).layouts.items()
        if layout is not None
    }
    return {layout.name: layout for layout in _parse_all(given)}
