"""Keys of a map: the meaning of the topics of bags."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from tactileforge.reading import ForceKeys as ForceMeaning
from tactileforge.reading import Keys, OriginKeys, StreamKeys


@dataclass(frozen=True, kw_only=True)
class ForceKeys(ForceMeaning):
    """Force on a touch.

    Attributes:
        topic: Topic of `geometry_msgs` ``WrenchStamped`` or ``Wrench``; with a ``?`` at its end, it
            may be absent.
        at: ``gel`` for the force on the gel, which is the label; anything else, such as
            ``flange``, acts elsewhere, and makes no label but the track ``wrench``.
        columns: Which of the force's x, y and z (0, 1, 2) lie along the axes of the gel; null where
            an axis is not measured.
        lag_s: Delay of the pictures behind the force, s: a frame shows the force of so long before
            it.
    """

    topic: str
    at: str = "gel"
    columns: tuple[int | None, int | None, int | None] = (0, 1, 2)
    lag_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class PictureKeys(StreamKeys):
    """A topic of pictures.

    Attributes:
        topic: Topic of `sensor_msgs` ``CompressedImage``, or of ``Image`` in rgb8, bgr8, rgba8,
            bgra8, mono8, 8UC1, yuv422 (uyvy) or yuv422_yuy2 (yuyv); 8UC3 and 8UC4 need
            ``channels``.
        channels: ``bgr`` where red and blue are exchanged in the pictures; null for what the
            encoding says, and an error where it does not say the order.
    """

    topic: str


@dataclass(frozen=True, kw_only=True)
class TouchKeys(PictureKeys):
    """Touch of one sensor.

    Attributes:
        sensor: Type of the sensor.
        finger: Name of the finger; "" for that of the topic.
        force: Its force, from a topic of wrenches; null for none.
    """

    sensor: str = field(metadata={"example": "digit"})
    finger: str = ""
    force: ForceKeys | None = None


@dataclass(frozen=True, kw_only=True)
class IntervalKeys(Keys):
    """A part of a bag, and its own labels.

    Attributes:
        start: Begin, s from the first message of the bag, by the time of recording.
        stop: End, s.
        object: Name of the touched object; "" for that of the map.
        text: Caption; "" for that of the map.
        labels: Further labels.
    """

    start: float
    stop: float
    object: str = ""
    text: str = ""
    labels: Mapping[str, str | float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class BagMap(OriginKeys):
    """Map of the topics of bags.

    Attributes:
        touch: Topics of touch.
        camera: Topic of the view of the scene; with a ``?`` at its end, it may be absent.
        state: Topics of `sensor_msgs` ``JointState``: the tracks ``state``, ``joint_velocity`` and
            ``joint_effort``; null for all of the bag.
        tracks: Topics of wrenches that are tracks, by the name of the track; null for all of the
            bag, but those of touches.
        clock: ``header`` for the stamps of messages where each has one, or ``bag`` for the time of
            recording.
        gap: Largest difference of a frame and its wrench or joints, s.
        background: ``first`` where recordings begin without contact, ``bag`` where bags do, or
            ``none``.
        intervals: Parts of bags, by the name of the bag; a bag without an entry is one recording a
            sensor.
        object: Name of the touched object.
        text: Caption.
        labels: Further labels.
        tier: Tier of the tactile dynamic pyramid, 1 to 5, of touch without a force.
    """

    touch: tuple[TouchKeys, ...]
    camera: PictureKeys | None = None
    state: tuple[str, ...] | None = None
    tracks: Mapping[str, str] | None = None
    clock: Literal["header", "bag"] = "header"
    gap: float = 0.1
    background: Literal["none", "first", "bag"] = "none"
    intervals: Mapping[str, tuple[IntervalKeys, ...]] = field(default_factory=dict)
    object: str = ""
    text: str = ""
    labels: Mapping[str, str | float] = field(default_factory=dict)
    tier: int = 2


def finger_of(touch: TouchKeys) -> str:
    """Name of the finger of a touch.

    Example:
        >>> finger_of(TouchKeys(topic="/left/image/compressed", sensor="digit"))
        'left_image_compressed'
    """
    return touch.finger or plain(touch.topic)


def plain(topic: str) -> str:
    """A topic as a name without slashes."""
    return topic.strip("/").replace("/", "_") or "topic"
