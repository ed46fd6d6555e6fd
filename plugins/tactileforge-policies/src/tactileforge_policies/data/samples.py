"""Samples of demonstrations: the observation at a step, and the next commands."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.contracts import Recording
from tactileforge.data import Clips, CutColumns, take_steps, view_of
from tactileforge.specs import spec
from tactileforge_policies.data.episodes import Demonstration, check_alike, episodes_of
from tactileforge_policies.reference import gain_of, with_gain
from tactileforge_policies.robot import Robot

Touch: TypeAlias = Literal["frames", "force", "none"]
#: Frames uint8 (n, T, 3, H, W), backgrounds (n, 3, H, W) and sensors -> tokens (n, L, width).
Encode: TypeAlias = Callable[[Tensor, Tensor, Sequence[str]], Tensor]

_BATCH = 32
#: Largest size of tokens kept in memory, bytes.
_IN_MEMORY = 2**31


@dataclass(frozen=True, kw_only=True)
class Cutting:
    """Options of cutting demonstrations into samples.

    Attributes:
        horizon: Commands of a chunk.
        observations: Number of steps with state and camera image in a sample.
        touch: Input of touch: ``frames``, ``force`` or ``none``; see `robot.Robot`.
        camera: Whether the camera image is read.
        image_size: Height and width of the resized camera image, pixels.
        reference_press: Whether changes of pictures are divided by the gain of their finger; see
            `reference.reference_gain`.
    """

    horizon: int = 8
    observations: int = 2
    touch: Touch = "frames"
    camera: bool = True
    image_size: int = 48
    reference_press: bool = False


class EpisodeClips(Clips):
    """Samples of demonstrations: one for each step of each episode.

    A sample holds one clip per finger, ending at the step (frames before the first are copies of
    it), states and camera images of the last steps, and the commands from this step on. After the
    end of an episode the last command is repeated, and marked invalid.

    Args:
        recordings: Recordings of all episodes, one for each finger; see `episodes_of`.
        frames: Frames of a clip.
        spacing: Time between the frames of a clip, s; at least one step.
        size: Height and width of the resized frames, pixels.
        cutting: Options of the samples.
        cache_mb: Resized frames kept in each process, MB.
        columns: Further columns of the rows, cut from the first finger; None for none.

    Attributes:
        robot: Sizes of the demonstrations.
        episodes: Episodes in the order of their names.

    Raises:
        DataError: The recordings are not demonstrations, or do not agree, see `episodes_of` and
            `check_alike`; or one lacks its reference press.
    """

    provides = frozenset({"action_chunk"})
    is_touch: ClassVar[bool] = False

    def __init__(
        self,
        recordings: Iterable[Recording],
        frames: int,
        spacing: float,
        size: tuple[int, int],
        cutting: Cutting,
        cache_mb: float = 512,
        columns: CutColumns | None = None,
    ) -> None:
        self.episodes = episodes_of(recordings)
        first = check_alike(self.episodes, cutting.camera)
        kept = [each.fingers[name] for each in self.episodes for name in first.fingers]
        super().__init__(kept, frames, spacing, 0.0, size, cutting.image_size, cache_mb, columns)
        self.cutting = cutting
        tasks = {str(each.labels["task"]) for each in kept if "task" in each.labels}
        self.robot = _robot(first, cutting, max(1, round(spacing / first.period)), tasks)
        self.facts = self.robot.facts
        self.strides[:] = self.robot.stride
        pressed = cutting.reference_press and cutting.touch == "frames"
        self._gains = [gain_of(one.labels, one.key) for one in kept] if pressed else None
        steps = [len(each.times) for each in self.episodes]
        fingers = len(first.fingers)
        self.index = np.concatenate(
            [np.stack([np.full(n, fingers * i), np.arange(n)], 1) for i, n in enumerate(steps)]
        ).astype(np.int32)
        self._tokens: Tensor | None = None

    def ranges(self) -> dict[str, tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Least and largest ``state``, ``action`` and ``force`` of all steps, by column."""
        columns: dict[str, list[NDArray[Any]]] = {
            "state": [each.state for each in self.episodes],
            "action": [each.action for each in self.episodes],
        }
        if self.cutting.touch == "force":
            columns["force"] = [each.force() for each in self.episodes]
        return {
            name: (np.concatenate(rows).min(0), np.concatenate(rows).max(0))
            for name, rows in columns.items()
        }

    def remember(self, encode: Encode) -> None:
        """Computes the tokens of every touch once; samples then hold these in place of frames.

        Args:
            encode: The frozen encoder, as a function; see `Encode`.
        """
        if self.cutting.touch != "frames" or self._tokens is not None:
            return
        tokens: Tensor | None = None
        for start in range(0, len(self), _BATCH):
            some = self._encoded(range(start, min(start + _BATCH, len(self))), encode)
            if tokens is None:
                tokens = _room((len(self), *some.shape[1:]))
            tokens[start : start + len(some)] = some
        self._tokens = tokens
        self._cache.clear("touch")

    def _encoded(self, samples: Sequence[int], encode: Encode) -> Tensor:
        touches = [self._touch(sample) for sample in samples]
        frames, background = (
            torch.stack([one for touch in touches for one in touch[key]])
            for key in ("frames", "background")
        )
        names = [name for touch in touches for name in touch["sensor"]]
        tokens = encode(frames, background, names).to(torch.float16)
        return tokens.view(len(samples), -1, *tokens.shape[1:])

    def _read(self, clip: int, group: int) -> dict[str, Any]:
        number, step = self.index[clip].tolist()
        episode = self.episodes[number // len(self.robot.fingers)]
        seen = np.maximum(np.arange(step + 1 - self.cutting.observations, step + 1), 0)
        ahead = np.arange(step, step + self.cutting.horizon)
        chunk, valid = take_steps(episode.action, ahead)
        row: dict[str, Any] = {
            "state": torch.from_numpy(episode.state[seen]),
            "action_chunk": torch.from_numpy(chunk),
            "action_chunk_valid": torch.from_numpy(valid),
            "action": -1,
            "text": self.recordings[number].text or "",
            "group": group,
            "clip": clip,
            **(self.columns.cut(self.recordings[number], self.rows(clip)) if self.columns else {}),
        }
        if self.robot.image_size:
            row["images"] = self._images(number, seen)
        if self.cutting.touch == "force":
            row["forces"] = torch.from_numpy(episode.force()[seen])
        elif self.cutting.touch == "frames" and self._tokens is not None:
            row["tokens"] = self._tokens[clip]
        elif self.cutting.touch == "frames":
            row |= self._touch(clip)
        return row

    def _touch(self, clip: int) -> dict[str, tuple[Any, ...]]:
        """Frames, background and sensor of each finger."""
        first = int(self.index[clip, 0])
        numbers = range(first, first + len(self.robot.fingers))
        rows = self.rows(clip).tolist()
        return {
            "frames": tuple(self._clip(number, rows) for number in numbers),
            "background": tuple(
                torch.from_numpy(self._background(n)).movedim(-1, 0) for n in numbers
            ),
            "sensor": self.robot.sensors,
        }

    def _clip(self, number: int, rows: Sequence[int]) -> Tensor:
        frames = self.recordings[number].frames
        read = self._frames(("touch", number), frames, rows, self.size)
        if self._gains is not None:
            read = with_gain(read, self._background(number), self._gains[number])
        return torch.from_numpy(read).movedim(-1, -3)

    def _images(self, number: int, steps: NDArray[np.int64]) -> Tensor:
        recording, size = self.recordings[number], (self.image_size, self.image_size)
        assert recording.image is not None
        rows = [view_of(recording, int(step)) for step in steps]
        read = self._frames(("image", number), recording.image, rows, size)
        return torch.from_numpy(read).movedim(-1, -3)


def _room(shape: tuple[int, ...]) -> Tensor:
    """Allocates float16: in memory, or above `_IN_MEMORY` bytes in an unnamed temporary file."""
    if 2 * math.prod(shape) <= _IN_MEMORY:
        return torch.empty(shape, dtype=torch.float16)
    with tempfile.TemporaryFile() as file:
        return torch.from_numpy(np.memmap(file, np.float16, "w+", shape=shape))


def _robot(first: Demonstration, cutting: Cutting, stride: int, tasks: AbstractSet[str]) -> Robot:
    sensors = tuple(spec(one.sensor).name for one in first.fingers.values())
    return Robot(
        fingers=tuple(first.fingers),
        sensors=sensors,
        state_size=first.state.shape[1],
        action_size=first.action.shape[1],
        rate=round(1 / first.period, 6),
        horizon=cutting.horizon,
        observations=cutting.observations,
        stride=stride,
        touch=cutting.touch,
        image_size=cutting.image_size if cutting.camera else 0,
        reference_press=cutting.reference_press,
        tasks=tuple(sorted(tasks)),
    )
