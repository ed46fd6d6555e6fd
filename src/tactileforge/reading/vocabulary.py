"""One vocabulary of what is in files: each notion has one name, one unit and one direction.

The keys of every format are drawn from it, those of folders, tars, arrays, bags and LeRobot; what
only some of them say about the stream of pictures and the force is in `StreamKeys` and `ForceKeys`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from tactileforge.contracts.data import Frames
from tactileforge.data.frames.turned import turned
from tactileforge.data.labels.clock import UNITS
from tactileforge.data.labels.newtons import newtons_of
from tactileforge.errors import ConfigError, unknown
from tactileforge.util.licences import check_data_licence

CHANNELS = ("rgb", "bgr")
ROTATIONS = (0, 90, 180, 270)
MIRRORS = ("none", "x", "y")

#: Former names of keys, each with those of today and what changed beside the name.
RENAMED: Mapping[str, Mapping[str, str]] = {
    "action": {"command": "the command of the robot"},
    "channels": {"columns": "which values are x, y and z"},
    "colours": {"channels": "rgb or bgr"},
    "exchanged": {"channels": "bgr where red and blue are exchanged"},
    "force_unit": {"unit": ""},
    "frame": {"at": "gel, or where else the force acts"},
    "frames": {"touch": ""},
    "image": {"camera": ""},
    "joints": {"state": ""},
    "key": {"array": "", "samples": ""},
    "lag": {"lag_s": "delay of the pictures behind the force; of bags, it was the other way round"},
    "names": {"words": ""},
    "split": {"hold_out": "train is none, val is all"},
    "time": {"times": ""},
    "turns": {"rotate": "degrees, clockwise: one turn is 270"},
    "values": {"size": "values of a taxel"},
    "wrench": {"force": ""},
    "wrenches": {"tracks": ""},
}


class Keys:
    """Base of the keys of formats: a former name is an error that says the name of today."""

    RENAMED: ClassVar[Mapping[str, Mapping[str, str]]] = RENAMED


@dataclass(frozen=True, kw_only=True)
class StreamKeys(Keys):
    """How the pictures of a stream lie.

    Attributes:
        channels: ``rgb``, or ``bgr`` where the program that recorded exchanged red and blue; None
            for what the file says, else ``rgb``.
        rotate: Degrees, clockwise, that put pictures upright: 0, 90, 180 or 270. Forces and actions
            are those of the upright picture.
        mirror: ``x`` where left and right are exchanged, ``y`` for top and bottom, or ``none``; it
            comes before ``rotate``.
    """

    channels: str | None = None
    rotate: int = 0
    mirror: str = "none"

    @property
    def is_bgr(self) -> bool:
        """Whether red and blue are exchanged."""
        return self.channels == "bgr"

    @property
    def turns(self) -> int:
        """Quarter turns, clockwise, that put pictures upright."""
        return self.rotate // 90

    def upright(self, frames: Frames, is_bgr: bool | None = None) -> Frames:
        """Frames as the sensor sees them, still lazy.

        Args:
            frames: Frames as they lie.
            is_bgr: Whether red and blue are exchanged; None for what the keys say.
        """
        bgr = self.is_bgr if is_bgr is None else is_bgr
        return turned(frames, bgr, self.turns, "" if self.mirror == "none" else self.mirror)


@dataclass(frozen=True, kw_only=True)
class ForceKeys(Keys):
    """What forces mean.

    Attributes:
        unit: Unit of the forces: ``N``, ``kN``, ``mN``, ``uN``, ``kgf``, ``gf``, ``lbf``, ``ozf``;
            None for newton, unless names say another.
        sign: Factors of x, y and z that give the axes of the gel: x right, y down, z into it, with
            pressing positive.
    """

    unit: str | None = None
    sign: tuple[Any, Any, Any] = (1.0, 1.0, 1.0)

    def newtons(self, names: Sequence[str], where: str) -> float:
        """Newton of the unit.

        Args:
            names: Names of the values of x, y and z; "" where one has none.
            where: Place of the keys, for errors.

        Raises:
            ConfigError: The unit is unknown, or names say another and the keys none.
        """
        if self.unit in UNITS:
            raise ConfigError(
                f"{where}: unit is that of the force, and {self.unit} is one of time; give "
                f"times: {{column: ..., unit: {self.unit}}}"
            )
        sign = [1.0 if one == "mean" else float(one) for one in self.sign]
        return newtons_of(names, self.unit, sign, where, "unit")


@dataclass(frozen=True, kw_only=True)
class OriginKeys(Keys):
    """Where recordings come from.

    Attributes:
        source: Origin of the recordings.
        licence: Their licence: an SPDX identifier, ``LicenseRef-NAME``, or several words; "" where
            it is not known.
        tier: Tier of the tactile dynamic pyramid, 1 (force) to 5 (press).
    """

    source: str = ""
    licence: str = ""
    tier: int = 5


def check_stream(keys: StreamKeys, where: str) -> None:
    """Checks how the pictures of a stream lie.

    Args:
        keys: The keys.
        where: Their place, for errors.

    Raises:
        ConfigError: A value is none of those that are known.
    """
    if keys.channels not in (None, *CHANNELS):
        raise ConfigError(f"{where}: {unknown('channels', str(keys.channels), CHANNELS)}")
    if keys.rotate not in ROTATIONS:
        raise ConfigError(
            f"{where}: rotate is {keys.rotate}; give the degrees, clockwise, that put the picture "
            "upright: 0, 90, 180 or 270"
        )
    if keys.mirror not in MIRRORS:
        raise ConfigError(
            f"{where}: mirror is {keys.mirror!r}; give x (left and right exchanged), y (top and "
            "bottom), or none; it comes before rotate"
        )


def check_origin(keys: OriginKeys, where: str) -> None:
    """Checks where recordings come from.

    Args:
        keys: The keys.
        where: Their place, for errors.

    Raises:
        ConfigError: The licence is none, or the tier is not 1 to 5.
    """
    check_data_licence(f"{where}: licence", keys.licence)
    if not 1 <= keys.tier <= 5:
        raise ConfigError(f"{where}: tier is {keys.tier}, but must be 1 to 5")
