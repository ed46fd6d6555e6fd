"""The user's clips, as one value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any, TypeAlias, TypedDict

from tactileforge.errors import ConfigError
from tactileforge.hub.inputs import Images, read_still
from tactileforge.hub.sensor_rows import Policy

#: A frame without contact, a word in its place, or nothing.
Still: TypeAlias = Images | str | None
#: Name of the sensor, or one name a clip, or nothing.
Sensors: TypeAlias = str | Sequence[str] | None


class Unknown(TypedDict, total=False):
    """Options of methods that encode all clips at once.

    Attributes:
        unknown_sensor: ``error``, or ``universal`` to take the universal tokens, and warn.
    """

    unknown_sensor: Policy


class Batched(Unknown, total=False):
    """Options of methods that encode batch by batch.

    Attributes:
        batch_size: GivenClips that are computed at once.
    """

    batch_size: int


@dataclass(frozen=True)
class GivenClips:
    """Clips, as a user gives them to a method of `Model`.

    Attributes:
        frames: uint8, RGB, oldest first, of any size: one clip (T, H, W, 3) or (T, 3, H, W), or a
            batch with B in front. numpy or torch. One image, (H, W, 3), (3, H, W) or a batch with
            one frame a clip, is shown in all T places.
        background: A frame without contact of the same recording, of the frames' size: one, or one
            a clip. ``"first"`` takes the first frame of each clip, ``"none"`` subtracts nothing. Of
            a path the image is read.
        sensor: Name of the sensor, or one name a clip; ``"universal"`` takes the universal tokens.
        unknown_sensor: ``error``, or ``universal`` to take the universal tokens, and warn.
        batch_size: GivenClips that are computed at once.
        checks: Whether to warn of swapped colours and changed light.
    """

    frames: Images
    background: Still = None
    sensor: Sensors = None
    unknown_sensor: Policy = "error"
    batch_size: int = 32
    checks: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "background", read_still(self.background))

    @property
    def word(self) -> str:
        """The word in place of a background; "" where there is none."""
        return self.background if isinstance(self.background, str) else ""

    @property
    def subtracts(self) -> bool:
        """Whether a background is given that is subtracted."""
        return self.background is not None and self.word != "none"

    def refuse_itself(self) -> None:
        """Raises a ConfigError if one image would be its own background."""
        of_file = isinstance(self.frames, str | PathLike) or hasattr(self.frames, "getbands")
        if self.word == "first" and (of_file or getattr(self.frames, "ndim", 0) == 3):
            raise ConfigError("background='first' is the image itself: give one without contact")


def check_batch_size(batch_size: Any) -> None:
    """Raises a ConfigError unless it is a whole number of clips, 1 or more."""
    if not isinstance(batch_size, int) or isinstance(batch_size, bool) or batch_size < 1:
        raise ConfigError(f"batch_size={batch_size!r}: give a whole number of clips, 1 or more")
