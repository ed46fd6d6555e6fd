"""Demonstrations: recordings of the fingers of one episode, with states and commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import DataError
from tactileforge.specs import spec
from tactileforge_policies.robot import ACTIONS_TRACK, STATE_TRACK

#: Largest relative difference of two rates that counts as jitter.
_JITTER = 0.05


@dataclass(frozen=True)
class Demonstration:
    """One demonstration.

    Attributes:
        name: Name of the episode, unique in the data set.
        fingers: Recordings by the name of the finger, in alphabetical order.
    """

    name: str
    fingers: Mapping[str, Recording]

    @property
    def first(self) -> Recording:
        """Recording of the first finger; it holds the camera image."""
        return next(iter(self.fingers.values()))

    @property
    def times(self) -> NDArray[np.float64]:
        """Time of each step, s (T,)."""
        return self.first.times

    @property
    def period(self) -> float:
        """Duration of a step, s."""
        return self.first.period

    @cached_property
    def state(self) -> NDArray[np.float32]:
        """Proprioception before each command, (T, S)."""
        return _track(self.first, STATE_TRACK)

    @cached_property
    def action(self) -> NDArray[np.float32]:
        """Command of each step, (T, A)."""
        return _track(self.first, ACTIONS_TRACK)

    def force(self) -> NDArray[np.float32]:
        """Forces of all fingers, N, (T, 3 F).

        Raises:
            DataError: A finger has no forces, or some are not finite.
        """
        columns = []
        for recording in self.fingers.values():
            if recording.force is None or not np.isfinite(recording.force).all():
                raise DataError(
                    f"{recording.key}: no force of every frame, and data.touch=force reads them; "
                    "give data.touch=frames, or record the forces"
                )
            columns.append(recording.force)
        return np.concatenate(columns, axis=1).astype(np.float32)


def episodes_of(recordings: Iterable[Recording]) -> list[Demonstration]:
    """Groups the recordings of fingers into episodes, ordered by name.

    A recording names its episode and finger in its labels ``episode`` and ``finger``.

    Raises:
        DataError: A recording lacks one of these labels, or a finger occurs twice in an episode.
    """
    groups: dict[str, dict[str, Recording]] = {}
    for recording in recordings:
        names = [recording.labels.get(key) for key in ("episode", "finger")]
        if not all(isinstance(name, str) and name for name in names):
            raise DataError(
                f"{recording.key}: no demonstration, as its labels name no episode and finger; "
                "policies learn from what `tactileforge demos` or `record` of a robot writes"
            )
        episode, finger = map(str, names)
        group = groups.setdefault(episode, {})
        if finger in group:
            raise DataError(
                f"{recording.key} and {group[finger].key} are both finger {finger!r} of "
                f"{episode!r}; give each episode a name of its own"
            )
        group[finger] = recording
    return [Demonstration(name, dict(sorted(groups[name].items()))) for name in sorted(groups)]


def check_alike(episodes: Sequence[Demonstration], camera: bool) -> Demonstration:
    """Checks demonstrations for the training of one policy; returns the first.

    Args:
        episodes: All demonstrations.
        camera: Whether each needs a camera image.

    Raises:
        DataError: There are no demonstrations, or one lacks commands, has values that are not
            finite, or differs from the first in fingers, sensors, sizes or rate. The message names
            it.
    """
    if not episodes:
        raise DataError("the data set has no demonstration; make some with `tactileforge demos`")
    first = episodes[0]
    for episode in episodes:
        _check_steps(episode)
        _check_same(episode, first)
        if camera and episode.first.image is None:
            raise DataError(
                f"{episode.first.key}: no camera image; give data.camera=false to train without"
            )
    return first


def _check_steps(episode: Demonstration) -> None:
    count = len(episode.times)
    if count < 2:
        raise DataError(f"{episode.name}: {count} step; a demonstration has two or more")
    for recording in episode.fingers.values():
        if len(recording.times) != count or not np.allclose(recording.times, episode.times):
            raise DataError(
                f"{recording.key}: its times are not those of {episode.first.key}; fingers of one "
                "episode share their steps"
            )


def _check_same(episode: Demonstration, first: Demonstration) -> None:
    for what, mine, theirs in (
        ("fingers", list(episode.fingers), list(first.fingers)),
        ("sensors", _sensors(episode), _sensors(first)),
        ("numbers of a state", episode.state.shape[1], first.state.shape[1]),
        ("numbers of a command", episode.action.shape[1], first.action.shape[1]),
    ):
        if mine != theirs:
            raise DataError(
                f"{episode.name}: {what} {mine}, and {first.name} has {theirs}; one policy learns "
                "from demonstrations of one robot"
            )
    if abs(episode.period - first.period) > _JITTER * first.period:
        raise DataError(
            f"{episode.name}: {1 / episode.period:.4g} commands a second, and {first.name} has "
            f"{1 / first.period:.4g}; record at one rate, or leave one of them out"
        )


def _sensors(episode: Demonstration) -> list[str]:
    return [spec(recording.sensor).name for recording in episode.fingers.values()]


def _track(recording: Recording, name: str) -> NDArray[np.float32]:
    values = recording.tracks.get(name)
    if values is None:
        raise DataError(
            f"{recording.key}: no track {name!r} (it has: {', '.join(recording.tracks) or 'none'})"
            "; a policy learns from the robot's state and commands"
        )
    bad = np.flatnonzero(~np.isfinite(values).reshape(len(values), -1).all(1))
    if values.ndim != 2 or len(bad):
        where = f"row {bad[0]} is not finite" if len(bad) else f"its shape is {values.shape}"
        raise DataError(f"{recording.key}: track {name!r}: {where}; correct it, or leave it out")
    return values.astype(np.float32)
