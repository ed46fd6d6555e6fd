"""Wrenches and joints of bags at the times of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge_rosbags.bags import Bag, changed
from tactileforge_rosbags.map_keys import ForceKeys
from tactileforge_rosbags.series import Clock, Scan, between, nearest_rows, scan

#: Types of messages of wrenches, and of joints.
WRENCHES = ("geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/Wrench")
JOINTS = ("sensor_msgs/msg/JointState",)
#: Most sets of joint names of a topic.
_SETS = 16
#: Tracks of joints, by the field of the message.
_TRACKS = {"position": "state", "velocity": "joint_velocity", "effort": "joint_effort"}


def read_wrench(
    bag: Bag, topic: str, clock: Clock, gap: float, lag_s: float = 0.0
) -> tuple[NDArray[np.float32], Scan]:
    """Wrench at each frame, float32 (T, 6), as in the messages: forces, then torques.

    Between two messages within ``gap`` they are interpolated; frames without one are NaN.

    Args:
        bag: The bag.
        topic: Name of the topic.
        clock: Clock of the frames.
        gap: Largest difference in time, s.
        lag_s: Delay of the frames behind the wrench, s.

    Returns:
        The wrenches, and the reading of the topic.

    Raises:
        DataError: The topic is not there, of another type or empty, or no message is near a frame.
    """
    found = _wrenches(bag, topic, changed(bag.path))
    at = clock.times - round(lag_s * 1e9)
    wrench, near = between(clock.of(found.series), at, gap, found.values)
    if not near.any():
        raise _apart(found, clock, gap)
    wrench[~near] = np.nan
    return wrench, found


@lru_cache(maxsize=16)
def _wrenches(bag: Bag, topic: str, _changed: int) -> Scan:
    found = scan(bag, topic, WRENCHES, wrench_of)
    return replace(found, values=_finite(found.values))


def wrench_of(message: Any) -> tuple[float, ...]:
    """Force and torque of a message, x, y and z each."""
    wrench = getattr(message, "wrench", message)
    force, torque = wrench.force, wrench.torque
    return force.x, force.y, force.z, torque.x, torque.y, torque.z


def force_of(wrench: NDArray[np.float32], keys: ForceKeys) -> NDArray[np.float32]:
    """Force on the gel, float32 (T, 3), N, of wrenches along other axes."""
    newton = keys.newtons([keys.topic] * 3, "touch.force")
    force = np.full((len(wrench), 3), np.nan, np.float32)
    for axis, (column, sign) in enumerate(zip(keys.columns, keys.sign, strict=True)):
        if column is not None:
            force[:, axis] = wrench[:, column] * (sign * newton)
    return force


@dataclass(frozen=True)
class _Joints:
    """Messages of a topic with the same joints.

    Attributes:
        names: Names of the joints.
        rows: Numbers of the messages.
        values: float32 (messages, joints, 3), position, velocity and effort.
    """

    names: tuple[str, ...]
    rows: NDArray[np.int64]
    values: NDArray[np.float32]


def read_joints(
    bag: Bag, topics: Sequence[str], clock: Clock, gap: float
) -> tuple[dict[str, NDArray[np.float32]], list[str], list[Scan]]:
    """Joints at each frame: tracks (T, joints), NaN without a message within ``gap``.

    Joints of several topics, and of messages with other names, are side by side; of a joint that is
    there twice, the first counts.

    Args:
        bag: The bag.
        topics: Names of the topics.
        clock: Clock of the frames.
        gap: Largest difference in time, s.

    Returns:
        Tracks by name, names of the joints, and the readings of the topics.

    Raises:
        DataError: A topic is not there, of another type or empty, or no message is near a frame.
    """
    names: list[str] = []
    parts: list[NDArray[np.float32]] = []
    scans = []
    for topic in topics:
        found = _joint_sets(bag, topic, changed(bag.path))
        scans.append(found)
        times, seen = clock.of(found.series), False
        for joints in found.values:
            free = [i for i, name in enumerate(joints.names) if name not in names]
            rows, near = nearest_rows(times[joints.rows], clock.times, gap)
            seen |= bool(near.any())
            values = joints.values[rows][:, free]
            values[~near] = np.nan
            names += [joints.names[i] for i in free]
            parts.append(values)
        if not seen:
            raise _apart(found, clock, gap)
    if not parts:
        return {}, [], []
    every = np.concatenate(parts, axis=1)
    tracks = {track: every[:, :, i] for i, track in enumerate(_TRACKS.values())}
    return {name: one for name, one in tracks.items() if not np.isnan(one).all()}, names, scans


@lru_cache(maxsize=16)
def _joint_sets(bag: Bag, topic: str, _changed: int) -> Scan:
    """A topic of joints; its values are a `_Joints` for each set of names."""
    found = scan(bag, topic, JOINTS, _joints)
    sets: dict[tuple[str, ...], list[int]] = {}
    for row, values in enumerate(found.values):
        sets.setdefault(tuple(sorted(values)), []).append(row)
    if len(sets) > _SETS:
        raise DataError(
            f"{found.series}: {len(sets)} sets of joint names, where {_SETS} are the limit; leave "
            "it out of joints"
        )
    made = []
    for rows in sets.values():
        names = tuple(found.values[rows[0]])
        table = [[found.values[row][name] for name in names] for row in rows]
        made.append(_Joints(names, np.asarray(rows), _finite(table)))
    return replace(found, values=made)


def _joints(message: Any) -> dict[str, tuple[float, ...]]:
    """Position, velocity and effort by joint; NaN for values absent from the message."""
    names = list(message.name)
    if not names or len({*names}) != len(names):
        raise DataError("joints without names, or with one name twice")
    columns = []
    for field in _TRACKS:
        values = getattr(message, field)
        if len(values) not in (0, len(names)):
            raise DataError(f"{len(names)} names of joints, but {len(values)} values of {field}")
        columns.append(list(values) or [float("nan")] * len(names))
    return dict(zip(names, zip(*columns, strict=True), strict=True))


def _finite(values: Sequence[Any]) -> NDArray[np.float32]:
    """Numbers as float32, with NaN for numbers beyond its range."""
    with np.errstate(over="ignore"):
        numbers = np.asarray(values, np.float64).astype(np.float32)
    return np.where(np.isfinite(numbers), numbers, np.float32(np.nan))


def _apart(found: Scan, clock: Clock, gap: float) -> DataError:
    return DataError(
        f"{found.series}: no message within {gap:g} s of a frame of {clock.touch.topic}; if their "
        "stamps are of different clocks, give data.clock=bag"
    )
