"""Keys of a map: the meaning of the arrays of a format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from tactileforge.reading import ForceKeys as ForceMeaning
from tactileforge.reading import Keys as SchemaKeys
from tactileforge.reading import OriginKeys, StreamKeys

#: One key, or several of which the first that is there counts.
Keys = str | tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ReadKeys(SchemaKeys):
    """A value read from a file.

    Attributes:
        array: Path of an array, of which the first row of the episode is taken; or, with ``attr``,
            of an array or group, where one that begins with ``/`` is counted from the top of the
            file.
        attr: Name of an attribute; "" for the values of the array.
        json: Name in a JSON text, with points between those in each other; "" where the value is
            none.
        default: Value without the key; null for none.
        words: Words of the file, and what they mean.
        whole: Whether the array has no time axis, and all its values are taken.
    """

    array: Keys
    attr: str = ""
    json: str = ""
    default: str | float | None = None
    words: Mapping[str, str] = field(default_factory=dict)
    whole: bool = False


@dataclass(frozen=True, kw_only=True)
class TimeKeys(SchemaKeys):
    """Times of the rows.

    Attributes:
        array: Path of the array.
        unit: ``s``, ``ms``, ``us``, ``ns``; ``frames`` for numbers of frames, which need ``fps``;
            or ``numbers_or_s``, frames if they are whole numbers by type, else seconds.
    """

    array: Keys
    unit: Literal["s", "ms", "us", "ns", "frames", "numbers_or_s"] = "s"


@dataclass(frozen=True, kw_only=True)
class PictureKeys(StreamKeys):
    """Pictures: uint8, 16 bits, fractions, or encoded images, one per row.

    Attributes:
        array: Path of the array.
        encoded: Order of the channels of decoded images; null for ``channels``.
        axes: ``hwc``, ``chw`` with channels first, or ``hw`` for grey. A single channel is grey,
            too; a fourth, alpha, is left out.
        white: Value of white in pictures of fractions or of 16 bits; null where there are none.
    """

    array: Keys
    encoded: Literal["rgb", "bgr"] | None = None
    axes: Literal["hwc", "chw", "hw"] = "hwc"
    white: float | None = None


@dataclass(frozen=True, kw_only=True)
class PartKeys(SchemaKeys):
    """Parts of a row of values by attributes of its array.

    Attributes:
        names: Attribute with the names of the parts.
        lengths: Attribute with the number of values of each.
    """

    names: str
    lengths: str


@dataclass(frozen=True, kw_only=True)
class TaxelKeys(SchemaKeys):
    """Numbers of taxels, drawn as pictures.

    Attributes:
        form: ``grid``: (rows, columns) or (rows, columns, values); ``points``: (taxels, values);
            ``flat``: all values of a row one after another.
        size: Values of each taxel in a ``flat`` row.
        columns: Which values are x, y and z; one alone is z. Null for all of one or three.
        span: Change that is drawn as full colour; null where the option ``data.span`` is needed.
        baseline: ``zero``, or ``first`` for the first row of the episode.
        sensor: Type of the sensor in recordings, unless ``data.sensors`` knows its name.
    """

    form: Literal["grid", "points", "flat"] = "grid"
    size: int = 1
    columns: tuple[int, ...] | None = None
    span: float | None = None
    baseline: Literal["zero", "first"] = "zero"
    sensor: str = "serial_array"


@dataclass(frozen=True, kw_only=True)
class ForceKeys(ForceMeaning):
    """Force on a touch.

    Attributes:
        array: Path of the array; with ``{axis}`` for x, y and z, those of an array each.
        columns: Columns x, y and z; null where an axis is not measured.
        sign: Factors of x, y and z that give the axes of the gel: x right, y down, z into it, with
            pressing positive; ``mean`` turns z so that its mean is positive.
        at: ``gel`` for the force on the gel; anything else, such as ``flange``, acts elsewhere, and
            makes no label but the track ``wrench``.
        times: Times of its rows, by the clock of the frames, to which they are interpolated; null
            where each row is of a frame.
    """

    array: Keys
    columns: tuple[int | None, int | None, int | None] = (0, 1, 2)
    sign: tuple[float, float, float | Literal["mean"]] = (1.0, 1.0, 1.0)
    at: str = "gel"
    times: TimeKeys | None = None


@dataclass(frozen=True, kw_only=True)
class TouchKeys(PictureKeys):
    """Touch of one sensor, or of several by placeholders in the key.

    Attributes:
        finger: Name of the finger; placeholders of the key, ``pad`` and ``part`` may be in it.
        sensor: Type of the sensor, or where it is read.
        pads: Whether the second axis counts pads of one kind.
        parts: Columns of a picture or grid that are a sensor of their own, by name; or attributes
            with names and lengths of parts of a flat row.
        taxels: How numbers are drawn; null where touch is pictures.
        draw: Which numbers are touch: ``all``, or ``grids`` alone.
        reference: Key of the picture without contact; "" for none.
        force: Force; null for none.
        times: Times of its own; null for those of the map.
        tracks: Further values by name; placeholders that the key of the touch has not stand for
            every array that fits, and is no touch itself.
        labels: Further labels of the recording.
    """

    sensor: str | ReadKeys = field(metadata={"example": "gelsight_mini"})
    finger: str = ""
    pads: bool = False
    parts: Mapping[str, tuple[int, int]] | PartKeys | None = None
    taxels: TaxelKeys | None = None
    draw: Literal["all", "grids"] = "all"
    reference: str = ""
    force: ForceKeys | None = None
    times: TimeKeys | None = None
    tracks: Mapping[str, Keys] = field(default_factory=dict)
    labels: Mapping[str, str | ReadKeys] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class SplitKeys(SchemaKeys):
    """Names of the episodes of each split, for episodes in groups.

    Attributes:
        train: Path of the array of names, from the top of the file; "" for all that are not held
            out.
        val: The same for those held out; "" for all that are not trained on.
    """

    train: str = ""
    val: str = ""


@dataclass(frozen=True, kw_only=True)
class EpisodeMap(OriginKeys):
    """Map of the names of a format. Keys that end with ``?`` may be absent.

    Attributes:
        about: The format, in a line.
        touch: Arrays of touch.
        citation: Publication to cite.
        files: Ends of the paths that are read, with placeholders; ``/`` separates folders.
        within: Group that may hold all arrays; keys start below it. With placeholders, such as
            ``data/demo_{number#}``, each group that fits is an episode.
        beside: Further files of an episode, by a word: their keys are ``WORD:KEY``. Each is a path
            with the placeholders of ``files``, from the folder where their match begins.
        ends: Key of the row after the last of each episode; "" where a file is one episode.
        ends_are: What ``ends`` holds: ``ends``, ``starts`` or ``lengths`` of the episodes in rows,
            ``numbers``, that of the episode of each row; or ``rows``, any array whose rows are an
            episode each.
        splits: Which episodes are held out, where the file says; null for a share of them.
        times: Times; null for regular rows at ``fps``.
        fps: Rows per second, or where it is read; null where the option ``data.fps`` is needed.
        camera: View of the scene; null for none.
        state: Keys of the robot's state, side by side: the track ``state``.
        command: Keys of its command, side by side: the track ``robot_action``. A last one
            ``next_state`` is the state of the row after, where no other is there.
        tracks: Further values by name; placeholders stand for every array that fits.
        large: Values like ``tracks``, also with the placeholders of touch, that are read only if
            ``data.large`` names them.
        text: Caption, or where it is read.
        object: Name of the touched object, or where it is read.
        labels: Further labels.
        limit: Numbers of a larger magnitude mean that there is no value.
        background: ``first`` where episodes begin without contact, else ``none``.
        hold_out: Unit held out together, with placeholders; "" for an episode.
        signature: Keys by which the format is recognised.
        doubts: What is inferred, a line each.
    """

    about: str
    touch: tuple[TouchKeys, ...]
    tier: int = 2
    citation: str = ""
    files: tuple[str, ...] = ()
    within: str = ""
    beside: Mapping[str, str] = field(default_factory=dict)
    ends: str = ""
    ends_are: Literal["ends", "starts", "lengths", "numbers", "rows"] = "ends"
    splits: SplitKeys | None = None
    times: TimeKeys | None = None
    fps: float | ReadKeys | None = None
    camera: PictureKeys | None = None
    state: tuple[str, ...] = ()
    command: tuple[str, ...] = ()
    tracks: Mapping[str, Keys] = field(default_factory=dict)
    large: Mapping[str, Keys] = field(default_factory=dict)
    text: str | ReadKeys = ""
    object: str | ReadKeys = ""
    labels: Mapping[str, str | ReadKeys] = field(default_factory=dict)
    limit: float | None = None
    background: Literal["none", "first"] = "none"
    hold_out: str = ""
    signature: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
