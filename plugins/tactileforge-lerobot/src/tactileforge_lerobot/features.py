"""Touch features of a data set: those chosen by options, or those written by this package."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tactileforge.errors import ConfigError
from tactileforge_lerobot.read import LeRobotFolder
from tactileforge_lerobot.sets import expanded
from tactileforge_lerobot.touch_features import TouchFeature, check_columns


@dataclass(frozen=True)
class Chosen:
    """Options for the choice of touch features.

    Attributes:
        touch: Names of the features; None for those written by `write`.
        sensors: Type of the sensor of each, or one for all.
        force: Name of the force feature of each; None for none.
        columns: Columns x, y and z of the force features, for all or for each.
    """

    touch: Sequence[str] | None
    sensors: Sequence[str]
    force: Sequence[str] | None
    columns: Sequence[int]

    def __post_init__(self) -> None:
        if self.touch is None:
            check_columns(self.columns, 0)
        elif not any("*" in name for name in self.touch):
            self._check_each(len(self.touch))

    def _check_each(self, features: int) -> None:
        """Raises a `ConfigError` if options do not fit the number of touch features."""
        if len(self.sensors) not in (1, features):
            raise ConfigError(
                f"data.touch names {features} features and data.sensors {len(self.sensors)} "
                "sensors: give the type of each, or one for all, e.g. data.sensors=[digit]"
            )
        if self.force is not None and len(self.force) != features:
            raise ConfigError(
                f"data.force names {len(self.force)} features, for {features} of touch"
            )
        check_columns(self.columns, features)

    def of(self, folder: LeRobotFolder) -> list[TouchFeature]:
        """Touch features of a data set.

        Raises:
            DataError: It lacks a feature; the message names the nearest.
            ConfigError: Options do not fit its features, or ``touch`` is missing.
        """
        if self.touch is None:
            return written_touch(folder)
        touch = expanded(self.touch, list(folder.info.features))
        self._check_each(len(touch))
        each = len(touch) if len(self.columns) == 3 else 1
        columns = tuple(self.columns) * each
        forces = self.force or [""] * len(touch)
        sensors = self.sensors if len(self.sensors) > 1 else [*self.sensors] * len(touch)
        return [
            TouchFeature(
                folder.known(name, "data.touch"),
                sensors[i],
                folder.known(forces[i], "data.force") if forces[i] else "",
                columns[3 * i : 3 * i + 3],
            )
            for i, name in enumerate(touch)
        ]


def written_touch(folder: LeRobotFolder) -> list[TouchFeature]:
    """Touch features of a data set written by `write`.

    Raises:
        DataError: Its metadata name a feature that is not there.
        ConfigError: Another program wrote it, or it has no frames of touch.
    """
    if not folder.touch:
        pictures = ", ".join(folder.info.pictures()) or "none"
        raise ConfigError(
            f"{folder.root}: which features are touch? Give data.touch=[...] and "
            f"data.sensors=[...]; its videos and images are: {pictures}"
        )
    kinds = {name: about["sensor"] for parts in folder.touch for name, about in parts.items()}
    if not any(f"observation.images.{name}" in folder.info.features for name in kinds):
        raise ConfigError(
            f"{folder.root}: was written without frames of touch (images=camera), for LeRobot's "
            "policies alone; read what it was made of"
        )
    out = []
    for name, sensor in kinds.items():
        folder.known(f"observation.images.{name}", "meta/tactileforge.json")
        force = f"observation.force.{name}"
        known = force if force in folder.info.features else ""
        out.append(TouchFeature(f"observation.images.{name}", sensor, known))
    return out


def written_camera(folder: LeRobotFolder) -> str | None:
    """Camera feature of a data set written by `write`; None without one."""
    camera = "observation.images.camera"
    return camera if folder.touch and camera in folder.info.features else None
