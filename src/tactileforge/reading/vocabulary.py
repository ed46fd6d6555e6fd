"""One vocabulary of files: each notion has one name, one unit and one direction.

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

#: Every key of every format, and its one meaning. The table of `docs/data.md` is made of it.
NOTIONS = {
    # where values are
    "videos": "patterns of films, each a recording",
    "stream": "number of the stream of video, from 0, or several by name",
    "images": "patterns of images; `each` says what one is",
    "files": "ends of paths, with placeholders",
    "samples": "template of the keys of samples, with placeholders",
    "path": "folder below `data.root`",
    "file": "path of a table, or of a picture or film without contact; `{column}` is filled in",
    "array": "path of an array or group in its file",
    "topic": "name of a topic",
    "values": "part of a sample, or a value in one: `force.npy`, `json:force`",
    "column": "column of a table",
    "columns": "columns, or values of a row: those of x, y and z, null where not measured",
    "key": "column with the name of the file, image or recording that a row is of; "
    '`"{object}/{take}"` of columns that name it together',
    "frame": "column with the number of the frame that a row is of, from 0",
    "attr": "attribute of an array or group",
    "json": "name in a JSON text, with points between those in each other",
    "default": "value where the file has none",
    "whole": "whether an array has no time axis",
    "within": "group below which all paths start; with placeholders, each that fits is an episode",
    "beside": "further files of an episode, by a word",
    "ends": "array of the rows after the last of each episode",
    "ends_are": "what `ends` holds: ends, starts, lengths or numbers; `rows`, of any array: each "
    "row is an episode",
    "parts": "parts of a row that are a sensor of their own",
    "names": "attribute with the names of the parts",
    "lengths": "attribute with the number of values of each part",
    "crops": "parts of a picture that are a sensor of their own, by name",
    "box": "left, top, width and height of a part, pixels",
    "pads": "whether the second axis counts pads of one kind",
    "each": "what an image is: `touch`, or one of a `sequence`; of `videos`, `touch` makes each "
    "frame one",
    "recording": "what tells recordings in one folder apart",
    "order": "order of the images of a sequence",
    "signature": "arrays by which a format is recognised",
    # pictures
    "touch": "pictures of touch",
    "camera": "pictures of the scene",
    "sensor": "type of the sensor",
    "sensors": "types of sensors",
    "finger": "name of the finger",
    "channels": "`rgb`, or `bgr` where red and blue are exchanged",
    "encoded": "`channels` of decoded images, where arrays have another",
    "rotate": "degrees, clockwise, that put pictures upright: 0, 90, 180 or 270",
    "mirror": "`x`: left and right are exchanged; `y`: top and bottom; before `rotate`",
    "axes": "order of the axes of a picture: `hwc`, `chw` or `hw`",
    "white": "value of white, in pictures of fractions or of 16 bits",
    "every": "stored frames for each frame of the camera",
    "ignore": "codes of checks that are known to find something",
    "background": "frames or a picture without contact, or `none`",
    "reference": "array of a picture without contact",
    "first": "number of first frames",
    "last": "number of last frames",
    "median": "whether the median over the recording is taken",
    # numbers drawn as pictures
    "taxels": "how numbers are drawn",
    "draw": "which numbers are drawn as touch",
    "form": "how taxels lie: `grid`, `points` or `flat`",
    "size": "values of each taxel in a flat row",
    "span": "change that is drawn as full colour, in units of the file",
    "baseline": "value without contact: `zero`, or that of the `first` row",
    "rest": "number without contact",
    "grid": "rows and columns of the picture",
    "positions": "row and column of each taxel in the picture",
    # time
    "times": "times of frames or rows",
    "unit": "unit of the values beside it: of force (N, mN, kgf, ...) or of times (s, ms, us, ns)",
    "fps": "frames per second",
    "clock": "which stamps count: those of `header` or of the `bag`",
    "gap": "largest difference of a frame and its values, s",
    "lag_s": "delay of the pictures behind the force, s",
    "start": "begin, s from the first message; of rows with times, where they meet the frames: "
    "`first_row`, `contact`, or the time of the first frame by their clock",
    "stop": "end, s from the first message",
    "intervals": "parts of a bag, each a recording",
    # force
    "force": "force on the touch: x right, y down, z into the gel, pressing positive",
    "sign": "factors of x, y and z into these axes; `mean` turns z so that its mean is positive",
    "at": "`gel`, or where else the force acts, which makes it a track",
    "tare": "number of first rows whose median is subtracted",
    "tare_most": "largest force along z in these rows, in units of the file",
    "partial": "whether rows may cover a part of the recording",
    # what else is known
    "state": "state of the robot: the track `state`",
    "command": "command of the robot: the track `robot_action`",
    "tracks": "further values a frame, by name",
    "large": "tracks that are read only on request",
    "name": "name of a track",
    "frames": "the first frame, and the one after the last",
    "margin": "frames on each side of an edge without a value",
    "only": "whether recordings without a row of labels are left out",
    "drop": "column of 1 for frames that are left out",
    "action": "atomic action of the touch",
    "object": "name of the touched object",
    "text": "caption",
    "words": "word for each value",
    "labels": "labels of recordings beside those with a key of their own, or their table",
    "limit": "numbers of a larger magnitude mean that there is no value",
    "missing": "numbers that mean that there is no value",
    # about the recordings
    "hold_out": "what is held out together",
    "splits": "where the file names the episodes of `train` and `val`",
    "objects": "whether a data set is one recording of one object",
    "about": "the format, in a line",
    "source": "origin of the recordings",
    "licence": "licence of the recordings",
    "citation": "publication to cite",
    "tier": "tier of the tactile dynamic pyramid, 1 (force) to 5 (press)",
    "doubts": "what is inferred, a line each",
}


class Keys:
    """Base of the keys of formats: a former name is an error with today's."""

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
        """Quarter turns to upright pictures, clockwise."""
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
    """Meaning of forces.

    Attributes:
        unit: Unit of the forces: ``N``, ``kN``, ``mN``, ``uN``, ``cN``, ``kgf``, ``gf``, ``lbf`` or
            ``ozf``; None for newton, unless names say another.
        sign: Factors of x, y and z that give the axes of the gel: x right, y down, z into it, with
            pressing positive.
    """

    unit: str | None = None
    sign: tuple[Any, Any, Any] = (1.0, 1.0, 1.0)

    def newtons(self, names: Sequence[str], where: str, key: str = "unit") -> float:
        """Newton of the unit.

        Args:
            names: Names of the values of x, y and z; "" where one has none.
            where: Place of the keys, for errors.
            key: Name of the key of the unit.

        Raises:
            ConfigError: The unit is unknown, or names say another and the keys none.
        """
        if self.unit in UNITS:
            raise ConfigError(
                f"{where}: {key} is that of the force, and {self.unit} is one of time; give "
                f"times: {{column: ..., unit: {self.unit}}}"
            )
        sign = [1.0 if one == "mean" else float(one) for one in self.sign]
        return newtons_of(names, self.unit, sign, where, key)


@dataclass(frozen=True, kw_only=True)
class OriginKeys(Keys):
    """Origin of recordings.

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
    """Checks the origin of recordings.

    Args:
        keys: The keys.
        where: Their place, for errors.

    Raises:
        ConfigError: The licence is none, or the tier is not 1 to 5.
    """
    check_data_licence(f"{where}: licence", keys.licence)
    if not 1 <= keys.tier <= 5:
        raise ConfigError(f"{where}: tier is {keys.tier}, but must be 1 to 5")
