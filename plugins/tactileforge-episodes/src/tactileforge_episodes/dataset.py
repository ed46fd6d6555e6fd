"""The data set ``episodes``: arrays of episodes in zarr, HDF5, npz and mat, read by a map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

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
from tactileforge.reading import (
    Drawn,
    add_once,
    as_texts,
    check_share,
    check_split,
    is_held_out,
    load_map,
    one_of_few,
)

if TYPE_CHECKING:
    from tactileforge_episodes.map_keys import EpisodeMap
    from tactileforge_episodes.reader import EpisodeFile
    from tactileforge_episodes.statements import Statements

#: Files looked at for the labels of the data set, and for the signs of its forces.
_FIRST = 16
#: Most units of a set of which one is held out, however small its share.
_SMALL = 30
_LABELS = ("force", "action", "object", "text", "image")


class Episodes(Drawn):
    """Arrays of episodes, one recording a sensor and episode (`docs/data.md`).

    Files are read where they lie, in folders, zip and tar: zarr (versions 2 and 3), HDF5, npz and
    MATLAB's .mat.
    A map says which arrays are touch, camera, state and so on.

    Args:
        root: Folder of the files, or a single file.
        preset: Name of a map of the package, such as ``open_x_tactile``; "" to recognise the format
            by the keys of its files, or to guess a map of them, unless ``map`` is given.
        map: A map of your own, or a YAML file with it; "" for none.
        touch: Keys of touch for the guess, where their names do not tell; [] for those that do.
        guess: Whether a format may be recognised, or a map guessed, where none is given.
        fps: Rows a second, where the files have no times; null for what the map says.
        sensors: Types of sensors by their name in the files, for those that the map does not know;
            ``any`` stands for every name.
        span: Change of taxels drawn as full colour, in their unit; null for that of the map.
        draw: Which numbers are drawn as touch: ``none``, ``grids`` of taxels, or ``all``; null for
            what the map says. Others are tracks, where the map names them.
        background: ``first`` where episodes begin without contact, or ``none``; null for what the
            map says.
        channels: Order of the channels of all pictures; null for what the map says.
        large: Names of large tracks of the map that are read too, such as ``depth``.
        hold_out: Unit held out together, with placeholders of the map's paths such as ``{task}``;
            null for that of the map.
        licence: Licence of the recordings, where the map knows none.
        val: Share of the units held out for validation.

    Raises:
        ConfigError: An option is invalid, or options contradict each other.
    """

    def __init__(
        self,
        root: str,
        preset: str = "",
        map: str | Mapping[str, Any] = "",
        touch: Sequence[str] = (),
        guess: bool = True,
        fps: float | None = None,
        sensors: Mapping[str, str] | None = None,
        span: float | None = None,
        draw: Literal["none", "grids", "all"] | None = None,
        background: Literal["first", "none"] | None = None,
        channels: Literal["rgb", "bgr"] | None = None,
        large: Sequence[str] = (),
        hold_out: str | None = None,
        licence: str = "",
        val: float = 0.1,
    ) -> None:
        check_share(val)
        if preset and map:
            raise ConfigError(
                "give data.preset=NAME, a known format, or data.map=FILE.yaml, not both"
            )
        if touch and (preset or map):
            raise ConfigError(
                "data.touch is for a guess; leave it out, or data.preset and data.map"
            )
        if (fps is not None and fps <= 0) or (span is not None and span <= 0):
            raise ConfigError(f"data.fps={fps}, data.span={span}: give values above 0")
        self.root = home_path(root)
        self.map = OmegaConf.to_container(map) if OmegaConf.is_config(map) else map
        self.touch, self.guess = tuple(as_texts(touch)), guess
        self.preset, self.val, self.hold_out = preset, val, hold_out
        self.fps, self.sensors, self.span, self.draw = fps, dict(sensors or {}), span, draw
        self.background, self.channels = background, channels
        self.large, self.licence = tuple(large), licence
        self.skipped: list[str] = []
        self._notes: list[str] = []
        self._recognised: Guess | None = None
        self._drawn: dict[str, str] = {}
        self._failed: DataError | None = None

    @cached_property
    def keys(self) -> EpisodeMap:
        """The map.

        Raises:
            ConfigError: There is no such preset or file, or a key of it is invalid.
            DataNotFoundError: No format is recognised.
        """
        from tactileforge_episodes.map_files import parse_map, read_preset

        options: Mapping[str, Any] = {"preset": self.preset, "map": self.map}
        if not self.preset and not self.map:
            options = self.guessed
        if preset := options.get("preset"):
            keys = read_preset(str(preset))
        elif isinstance(options["map"], str):
            path = home_path(options["map"])
            keys = parse_map(str(path), load_map(path))
        else:
            keys = parse_map("data.map", options["map"])
        check_names("data.large", self.large, keys.large)
        return keys

    @cached_property
    def guessed(self) -> Mapping[str, Any]:
        """The preset or map that was recognised or guessed; {} where one is given.

        Raises:
            DataNotFoundError: No format is recognised, or nothing may be guessed.
        """
        if self.preset or self.map:
            return {}
        from tactileforge_episodes.guess import guess, listed_arrays

        if not self.guess:
            raise DataNotFoundError(
                f"{self.root}: data.guess=false, and no map; give data.preset=NAME or data.map=FILE"
                f".yaml (docs/data.md); {listed_arrays(self.root)}"
            )
        found = guess(self.root, self.touch)
        if found is None:
            raise DataNotFoundError(
                f"{self.root}: no zarr, HDF5, npz or mat is there; set data.root to the folder of "
                "the files (docs/data.md)"
            )
        self._recognised = found
        return {key: value for key, value in found.options.items() if key != "root"}

    @property
    def notes(self) -> list[str]:
        """Facts inferred, or read with doubt, a line each."""
        reading = self.__dict__.get("reading")
        vanished = [] if reading is None else reading.optional.lines()
        return [*self._correction, *dict.fromkeys([*self._notes, *vanished])]

    @property
    def _correction(self) -> list[str]:
        """Line on the recognised format and its episodes, with a fix; [] where a map is given."""
        if self._recognised is None:
            return []
        held = [*self._drawn.values()].count("val")
        found = f"{len(self._drawn)} episodes were found, {held} of them held out; "
        other = "data.preset says another" if "preset" in self.guessed else "data.map says more"
        show = command("data", "inspect", str(self.root))
        return [
            f"{self.root}: recognised as {self._recognised.format}; {found if self._drawn else ''}"
            f"{other}, and {show} writes the options to correct"
        ]

    @cached_property
    def provides(self) -> frozenset[str]:
        """Labels of the first recordings; empty where nothing can be read."""
        found: set[str] = set()
        try:
            for number, file in enumerate(self._files(None)):
                if number == _FIRST:
                    break
                try:
                    for recording in file.recordings(0, lambda _: None):
                        found |= {name for name in _LABELS if getattr(recording, name) is not None}
                except DataError:
                    continue
        except (DataError, ConfigError):
            return frozenset()
        return frozenset(found)

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, file by file and episode by episode.

        A file or episode that cannot be read is left out and listed in ``skipped``.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: There is no file of the map.
            DataError: No recording of the split can be read.
            ConfigError: An unknown split, or an option is missing.
        """
        check_split(split)
        opened = 0
        for file in self._files(split):
            try:
                for number in range(len(file.episodes)):
                    if self._split(file, number) != split:
                        continue
                    try:
                        for recording in file.recordings(number, self._skip, self._notes.append):
                            opened += 1
                            yield recording
                    except DataError as error:
                        self._skip(error)
            except DataError as error:
                self._skip(error)
        if self._failed is not None and not opened:
            raise self._failed

    def _skip(self, error: DataError) -> None:
        self._failed = error
        add_once(self.skipped, error)

    def _files(self, split: str | None) -> Iterator[EpisodeFile]:
        """Yields the files of a split; None for both."""
        from tactileforge_episodes.find import find_files

        reading, count = self.reading, 0
        for file in find_files(self.root, self.keys, reading, self.skipped, self._notes):
            count += 1
            whole = not self.keys.ends
            if split is None or not whole or self._split(file, 0) == split:
                yield file
        if not count:
            ends = ", ".join(self.keys.files) or "*.zarr, *.hdf5, *.npz, *.mat, *.zip, *.tar"
            bad = f" ({self.skipped[0]})" if self.skipped else ""
            raise DataNotFoundError(
                f"{self.root}: no file that ends like {ends}{bad}; set data.root to the folder of "
                "the data set, or correct `files` of the map"
            )

    @cached_property
    def reading(self) -> Statements:
        """Facts of the options, and measured signs.

        Raises:
            ConfigError: The map cannot be read.
        """
        from tactileforge_episodes.find import measure_signs
        from tactileforge_episodes.statements import Statements

        said = Statements(
            fps=self.fps,
            sensors=self.sensors,
            span=self.span,
            draw=self.draw,
            background=self.background,
            channels=self.channels,
            large=self.large,
            licence=self.licence,
        )
        self._notes += [f"{self.keys.about}: {line}" for line in self.keys.doubts]
        return measure_signs(self.root, self.keys, said, _FIRST, self._notes)

    def _split(self, file: EpisodeFile, number: int) -> str:
        from tactileforge_episodes.names import placeholders

        check_names("placeholder of data.hold_out", placeholders(self._template), file.values)
        side = file.split if self.hold_out is None else None
        if side is None:
            is_val = is_held_out(self._unit(file, number), self.val, self._held)
            side = "val" if is_val else "train"
        self._drawn[file.key(number)] = side
        return side

    def _unit(self, file: EpisodeFile, number: int) -> str:
        from tactileforge_episodes.names import fill

        return fill(self._template, file.values) if self._template else file.key(number)

    @property
    def _template(self) -> str:
        """Template of the unit held out as one; "" for an episode."""
        return self.keys.hold_out if self.hold_out is None else self.hold_out

    @cached_property
    def _held(self) -> frozenset[str]:
        """Held-out units of a set of a few, at least one of three; empty for larger sets."""
        units: set[str] = set()
        for file in self._files(None):
            if file.split is not None and self.hold_out is None:
                return frozenset()
            with suppress(DataError):  # `recordings` names it
                units |= {self._unit(file, number) for number in range(len(file.episodes))}
            # a share is held out as it is: no further file is opened to know
            if len(units) > _SMALL or any(is_held_out(unit, self.val) for unit in units):
                return frozenset()
        return one_of_few(units, self.val)

    @property
    def held_out(self) -> list[str]:
        """The held-out unit."""
        unit = self._template or "episode"
        return [f"by {unit}, with all its sensors and cameras"] if self.val else []

    @staticmethod
    def recognise(root: Path) -> Guess | None:
        """Recognises the format of a folder or file by the keys of its first files, or guesses it.

        Args:
            root: Folder or file.

        Raises:
            DataError: There are arrays, but none that is touch by its name, or two readings.
        """
        from tactileforge_episodes.guess import guess

        return guess(root)
