"""Samples of a wrench sensor or a robot, segment by segment, at the times of frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactileforge_live.record.frame_queue import SampleBuffer
from tactileforge_live.record.raw import Raw
from tactileforge_live.record.rig import RigSensor
from tactileforge_live.record.wrench import GAP, interpolate_samples


class SegmentSamples:
    """Samples of one device during a take.

    Args:
        device: Wrench sensor or robot.
    """

    def __init__(self, device: RigSensor) -> None:
        assert isinstance(device.keeps, SampleBuffer)
        self.device, self.keeps = device, device.keeps
        self._last: Raw | None = None

    def cut(self, until: float) -> tuple[Raw, Raw]:
        """Removes the samples before a time.

        Returns:
            The samples with their neighbours on both sides, for interpolation, and without.
        """
        later, values = self.keeps.all()  # before the cut: those after it are neighbours too
        own = self.keeps.cut(until)
        before, self._last = self._last, self._last
        if len(own[0]):
            self._last = (own[0][-1:], own[1][-1:])
        if before is None:
            return (later, values), own
        return (np.concatenate([before[0], later]), np.concatenate([before[1], values])), own


def robot_tracks(
    wanted: NDArray[np.float64], samples: Raw, states: int, period: float
) -> dict[str, NDArray[np.float32]]:
    """Tracks ``state`` and ``robot_action`` at the times of frames.

    The state is interpolated. The action is the first command at or after the frame, since it can
    be a response to the frame.

    Args:
        wanted: Times of frames, float64 (T,), s.
        samples: Times (N,) and values (N, states + actions) of the robot.
        states: Number of values of the state.
        period: Seconds between samples of the robot.

    Returns:
        float32 (T, states) and (T, actions); NaN without a sample nearby. ``robot_action`` is
        absent for a robot without actions.
    """
    times, values = samples
    gap = max(GAP, 2 * period)
    tracks = {"state": interpolate_samples(wanted, times, values[:, :states], gap)}
    if values.shape[1] > states:
        actions = np.full((len(wanted), values.shape[1] - states), np.nan, np.float32)
        after = np.searchsorted(times, wanted)
        near = after < len(times)
        near[near] = times[after[near]] - wanted[near] <= gap
        actions[near] = values[after[near], states:]
        tracks["robot_action"] = actions
    return tracks
