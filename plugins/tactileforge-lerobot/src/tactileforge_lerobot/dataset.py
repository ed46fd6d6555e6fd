"""The data set ``lerobot``: touch in LeRobot's folder format, version 3."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from tactileforge.plugin import ConfigError, DataError, Recording, is_held_out, unknown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactileforge_lerobot.read import LeRobotFolder, TouchFeature

_BACKGROUNDS = ("first", "none")


class LeRobot:
    """Touch features of LeRobot episodes, one recording each (`docs/lerobot.md`).

    ``observation.state`` and ``action`` are the tracks ``state`` and ``robot_action`` of each
    recording.

    A data set written by `tactileforge data lerobot` needs no option but ``root``.

    Args:
        root: Folder of the data set.
        touch: Names of the touch features, for example ``observation.images.digit``; None for those
            written by `tactileforge data lerobot`.
        sensors: Type of the sensor of each touch feature.
        force: Name of the force feature of each touch feature, "" for none; None where no touch
            feature has a force.
        force_columns: Columns x, y and z of the force features; three numbers for all, or three for
            each touch feature.
        camera: Name of the feature with the camera's view of the scene; None for none.
        background: ``first`` where episodes begin without contact, else ``none``.
        val: Share of the episodes held out for validation.

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
        camera: str | None = None,
        background: str = "first",
        val: float = 0.1,
    ) -> None:
        if not 0 <= val < 1:
            raise ConfigError(f"val is {val}; give the share that is held out, 0 or more, below 1")
        if background not in _BACKGROUNDS:
            raise ConfigError(unknown("data.background", background, _BACKGROUNDS))
        if touch is not None and len(sensors) != len(touch):
            raise ConfigError(
                f"data.touch names {len(touch)} features and data.sensors {len(sensors)} sensors: "
                "give the type of each, e.g. data.sensors=[digit]"
            )
        if touch is not None and force is not None and len(force) != len(touch):
            raise ConfigError(f"data.force names {len(force)} features, for {len(touch)} of touch")
        if len(force_columns) not in (3, 3 * len(touch or ())) or min(force_columns) < 0:
            raise ConfigError(
                f"data.force_columns={list(force_columns)}: give x, y and z, for all or for each"
            )
        self.root = Path(root).expanduser()
        self.given, self.sensors, self.force = touch, list(sensors), force
        self.force_columns, self.camera = tuple(force_columns), camera
        self.background, self.val = background, val
        self.skipped: list[str] = []

    @cached_property
    def folder(self) -> LeRobotFolder:
        """The data set on disk."""
        from tactileforge_lerobot.read import LeRobotFolder

        return LeRobotFolder(self.root)

    @property
    def provides(self) -> frozenset[str]:
        """Labels provided by the features; empty where the folder cannot be read."""
        try:
            touch, names = self._touch(), self.folder.info.features
            written = [about for one in self.folder.touch for about in one.values()]
        except (DataError, ConfigError):
            return frozenset()
        provided = {
            "force": any(one.force for one in touch),
            "action": any(name.startswith("observation.touch.") for name in names),
            "object": any(about.get("object") for about in written),
            "text": not written or any(about.get("text") for about in written),
            "image": bool(self.camera or self._written_camera()),
        }
        return frozenset(name for name, is_given in provided.items() if is_given)

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, episode by episode.

        An unreadable recording is left out and listed in ``skipped``.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: There is no data set.
            DataError: Its version is not supported, it lacks a feature, or no recording of the
                split can be read.
            ConfigError: An unknown split, or ``touch`` is missing.
        """
        if split not in ("train", "val"):
            raise ConfigError(unknown("split", split, ("train", "val")))
        folder = self.folder
        features = self._touch()
        camera = folder.known(self.camera, "data.camera") if self.camera else self._written_camera()
        failed: DataError | None = None
        opened = 0
        for number in range(len(folder.episodes)):
            if (split == "val") != is_held_out(f"{self.root.name}/{number}", self.val):
                continue
            for touch in features:
                try:
                    recording = folder.recording(number, touch, camera, self.background)
                except DataError as error:
                    failed = error
                    if str(error) not in self.skipped:
                        self.skipped.append(str(error))
                    continue
                opened += recording is not None
                if recording is not None:
                    yield recording
        if failed is not None and not opened:
            raise failed

    def plot(self, recording: Recording) -> Figure:
        """Plots a recording."""
        from tactileforge.plugin import plot_recording

        return plot_recording(recording)

    def _touch(self) -> list[TouchFeature]:
        from tactileforge_lerobot.read import TouchFeature

        folder = self.folder
        if self.given is not None:
            forces = self.force or [""] * len(self.given)
            columns = self.force_columns * (len(self.given) if len(self.force_columns) == 3 else 1)
            return [
                TouchFeature(
                    folder.known(images, "data.touch"),
                    sensor,
                    folder.known(force, "data.force") if force else "",
                    columns[3 * i : 3 * i + 3],
                )
                for i, (images, sensor, force) in enumerate(
                    zip(self.given, self.sensors, forces, strict=True)
                )
            ]
        if not folder.touch:
            pictures = ", ".join(folder.info.pictures()) or "none"
            raise ConfigError(
                f"{self.root}: which features are touch? Give data.touch=[...] and "
                f"data.sensors=[...]; its videos and images are: {pictures}"
            )
        kinds = {
            name: about["sensor"] for features in folder.touch for name, about in features.items()
        }
        if not any(f"observation.images.{name}" in folder.info.features for name in kinds):
            raise ConfigError(
                f"{self.root}: was written without frames of touch (images=camera), for LeRobot's "
                "policies alone; read what it was made of"
            )
        out = []
        for name, sensor in kinds.items():
            folder.known(f"observation.images.{name}", "meta/tactileforge.json")
            force = f"observation.force.{name}"
            known = force if force in folder.info.features else ""
            out.append(TouchFeature(f"observation.images.{name}", sensor, known))
        return out

    def _written_camera(self) -> str | None:
        written = "observation.images.camera"
        return written if self.folder.touch and written in self.folder.info.features else None
