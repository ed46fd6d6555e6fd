"""A recording as checks see it: labels at hand, frames decoded once, when they are asked for."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks.doubts import Suspicion, check_labels
from tactileforge.checks.sample import FrameSample, neighbour_changes, sample_of
from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError
from tactileforge.specs.published import spec


class Seen:
    """A recording with what its checks share.

    Args:
        recording: The recording.
        split: Its split, ``train`` or ``val``.
        has_layout: Whether a layout describes it, whose keys can put it right.
        sample: Frames that were decoded already; None to decode them when they are asked for.

    Attributes:
        recording: The recording.
        split: Its split.
        has_layout: Whether a layout describes it.
    """

    def __init__(
        self,
        recording: Recording,
        split: str = "train",
        has_layout: bool = True,
        sample: FrameSample | None = None,
    ) -> None:
        self.recording, self.split, self.has_layout = recording, split, has_layout
        if sample is not None:
            self.__dict__["sample"] = sample

    @property
    def key(self) -> str:
        """Key of the recording."""
        return self.recording.key

    @cached_property
    def suspicions(self) -> list[Suspicion]:
        """Findings from labels, times and sizes."""
        return list(check_labels(self.recording))

    @cached_property
    def scale(self) -> NDArray[np.float64]:
        """Scale of the force of its sensor, N, float64 (3,); 1 where it is not known."""
        try:
            return np.array(spec(self.recording.sensor).force_scale)
        except ConfigError:  # the sensor is not installed here
            return np.ones(3)

    @cached_property
    def sample(self) -> FrameSample:
        """A few frames all over the recording, made small.

        Raises:
            DataError: A frame cannot be decoded.
        """
        return sample_of(self.recording)

    @cached_property
    def steps(self) -> NDArray[np.float64]:
        """Changes between neighbours where most moves, float64 (n,); see `neighbour_changes`."""
        moving = int(self.sample.rows[int(self.sample.change.argmax())])
        return neighbour_changes(self.recording, moving)

    @property
    def is_picture(self) -> bool:
        """Whether its frames are pictures of a camera, and not taxels."""
        try:
            return spec(self.recording.sensor).kind == "image"
        except ConfigError:
            return True
