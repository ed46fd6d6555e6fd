"""The data set ``lerobot``: touch in LeRobot's folder format, versions 2.0, 2.1 and 3."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path

from tactileforge.contracts import Guess, Recording
from tactileforge.errors import ConfigError, DataError, home_path
from tactileforge.reading import (
    Drawn,
    ForceKeys,
    StreamKeys,
    add_once,
    check_share,
    check_split,
    held_out_names,
)
from tactileforge_lerobot.drawn import Drawing
from tactileforge_lerobot.features import Chosen, written_camera
from tactileforge_lerobot.read import LeRobotFolder
from tactileforge_lerobot.recognise import recognise
from tactileforge_lerobot.sets import find_sets
from tactileforge_lerobot.touch_features import ReadOptions


class LeRobot(Drawn):
    """Touch features of LeRobot episodes, one recording each (`docs/lerobot.md`).

    ``observation.state`` and ``action`` are the tracks ``state`` and ``robot_action`` of each
    recording. A data set written by `tactileforge data lerobot` needs no option but ``root``.

    A touch feature holds pictures, or numbers: taxels, pressures, depths, or a video of 16 bits a
    channel. Numbers are drawn as pictures by ``span``; up to 4096 a frame are also the track
    ``taxels``.

    Args:
        root: Folder of the data set, or of several, up to four levels below it.
        touch: Names of the touch features, for example ``observation.images.digit``; ``*`` in a
            name stands for any characters, and ``/i`` behind it takes part i of the first axis.
            None for those written by `tactileforge data lerobot`.
        sensors: Type of the sensor of each touch feature, or one for all.
        force: Name of the force feature of each touch feature, "" for none; None where no touch
            feature has a force.
        force_columns: Columns x, y and z of the force features; three numbers for all, or three for
            each touch feature.
        force_unit: Unit of the forces, such as ``N``, ``kgf`` or ``lbf``; null for newton, unless
            names say another.
        force_sign: Factors of x, y and z that give the axes of `tactileforge.contracts`; ``mean``
            turns z so that its mean over a data set is positive, where the sign of pressing is not
            known.
        force_tare: Number of first rows whose median force is subtracted from all; of each episode,
            or with ``objects`` of each data set.
        force_tare_most: Largest force along z in these rows, in units of the feature; where it is
            larger, the recordings are left out. None for any.
        camera: Name of the feature with the camera's view of the scene; None for none.
        channels: ``bgr`` where pictures of touch have red and blue exchanged; null for ``rgb``.
        rotate: Degrees, clockwise, that put pictures of touch upright: 0, 90, 180 or 270.
        mirror: ``x`` where left and right are exchanged, ``y`` for top and bottom, or ``none``; it
            comes before ``rotate``.
        tracks: Names of further numeric features, kept as tracks.
        background: ``first`` where episodes begin without contact, else ``none``.
        span: Change of a number drawn as full colour, in units of the feature: one for x, y and z,
            or three.
        rest: Number without contact where ``background`` is ``none``.
        columns: Indices of x, y and z in the last axis of a numeric feature, or of z alone; []
            where that axis holds taxels. None where the shape leaves no choice.
        grid: Rows and columns of the picture of a numeric feature; None for its own.
        positions: Row and column of each taxel in the picture; None for a grid, row by row.
        missing: Numbers that stand for an unknown value in numeric features, which become NaN.
        objects: Whether each data set is one recording of one object, cut into episodes. The object
            has the name of its folder, the first frame of the first episode is the background of
            all, and whole objects are held out.
        val: Share of the episodes, or objects, held out for validation.

    Raises:
        ConfigError: An option is invalid, or options contradict each other.
    """

    def __init__(
        self,
        root: str,
        touch: Sequence[str] | None = None,
        sensors: Sequence[str] = (),
        force: Sequence[str] | None = None,
        force_columns: Sequence[int] = (0, 1, 2),
        force_unit: str | None = None,
        force_sign: Sequence[float | str] = (1.0, 1.0, 1.0),
        force_tare: int = 0,
        force_tare_most: float | None = None,
        camera: str | None = None,
        channels: str | None = None,
        rotate: int = 0,
        mirror: str = "none",
        tracks: Sequence[str] = (),
        background: str = "first",
        span: float | Sequence[float] | None = None,
        rest: float = 0.0,
        columns: Sequence[int] | None = None,
        grid: Sequence[int] | None = None,
        positions: Sequence[Sequence[float]] | None = None,
        missing: Sequence[float] = (),
        objects: bool = False,
        val: float = 0.1,
    ) -> None:
        check_share(val)
        self.root, self.val = home_path(root), val
        self.chosen = Chosen(touch, tuple(sensors), force, tuple(force_columns))
        self.camera = camera
        self.reading = ReadOptions(
            background=background,
            drawing=Drawing(span=span, rest=rest, columns=columns, grid=grid, positions=positions),
            stream=StreamKeys(channels=channels, rotate=rotate, mirror=mirror),
            force=ForceKeys(unit=force_unit, sign=tuple(force_sign)),  # type: ignore[arg-type]
            tare=force_tare,
            tare_most=force_tare_most,
            tracks=tuple(tracks),
            missing=tuple(missing),
            objects=objects,
        )
        self.skipped: list[str] = []
        self.notes: list[str] = []

    @staticmethod
    def recognise(root: Path) -> Guess | None:
        """Recognises LeRobot data sets by their info file; None for any other folder."""
        return recognise(root)

    @cached_property
    def folders(self) -> list[LeRobotFolder]:
        """Data sets on disk, in order; the folder itself where none is found."""
        found = find_sets(self.root) or {self.root.name: self.root}
        return [LeRobotFolder(path, name, self.reading) for name, path in found.items()]

    @property
    def provides(self) -> frozenset[str]:
        """Labels provided by the features; empty where no data set can be read."""
        for folder in self.folders:
            try:
                return self._provides(folder)
            except (DataError, ConfigError):
                continue
        return frozenset()

    def _provides(self, folder: LeRobotFolder) -> frozenset[str]:
        touch = self.chosen.of(folder)
        written = [about for one in folder.touch for about in one.values()]
        provided = {
            "force": any(one.force for one in touch),
            "action": any(
                folder.is_own(name, "action")
                for name in folder.info.features
                if name.startswith("observation.touch.")
            ),
            "object": self.reading.objects or any(about.get("object") for about in written),
            "text": not written or any(about.get("text") for about in written),
            "image": bool(self.camera or written_camera(folder)),
        }
        return frozenset(name for name, is_given in provided.items() if is_given)

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, episode by episode.

        An unreadable recording, or one of several data sets, is left out and listed in
        ``skipped``.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: There is no data set.
            DataError: Its version is not supported, it lacks a feature, or no recording of the
                split can be read.
            ConfigError: An unknown split, or an option is missing or does not fit the features.
        """
        check_split(split)
        failed: list[DataError] = []
        broken: list[DataError] = []
        opened = 0
        held = held_out_names(
            (unit for folder in self.folders for unit in self._units(folder)), self.val
        )
        for folder in self.folders:
            try:
                for recording in self._recordings(folder, split, failed, held):
                    opened += 1
                    yield recording
            except DataError as error:
                if len(self.folders) == 1:
                    raise
                self._skip(error, broken)
            self.notes += [note for note in folder.notes if note not in self.notes]
        if not opened and (failed or len(broken) == len(self.folders)):
            raise (failed or broken)[-1]

    def _units(self, folder: LeRobotFolder) -> list[str]:
        """Name of each episode's held-out unit."""
        name = folder.name
        count = len(folder.episodes)
        return [name] * count if self.reading.objects else [f"{name}/{i}" for i in range(count)]

    def _recordings(
        self, folder: LeRobotFolder, split: str, failed: list[DataError], held: frozenset[str]
    ) -> Iterator[Recording]:
        """Yields the recordings of a split of one data set."""
        features = self.chosen.of(folder)
        camera = folder.known(self.camera, "data.camera") if self.camera else written_camera(folder)
        for number, unit in enumerate(self._units(folder)):
            if (split == "val") != (unit in held):
                continue
            for touch in features:
                try:
                    recording = folder.recording(number, touch, camera)
                except DataError as error:
                    self._skip(error, failed)
                    continue
                if recording is not None:
                    yield recording

    def _skip(self, error: DataError, failed: list[DataError]) -> None:
        failed.append(error)
        add_once(self.skipped, error)

    @property
    def held_out(self) -> list[str]:
        """The held-out unit."""
        unit = "data set" if self.reading.objects else "episode"
        return [f"by {unit}, with all its sensors and cameras"] if self.val else []
