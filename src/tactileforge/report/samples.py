"""Outputs of a trained module on some clips: embeddings, forces, reconstructions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.contracts import Batch, Recording
from tactileforge.data.batches.clips import Clips, Skipped, collate
from tactileforge.data.labels.augment import fill_captions
from tactileforge.heads.decoder import Reconstruction
from tactileforge.report.strips import kind_of, residuals, share
from tactileforge.training.module import TouchModule
from tactileforge.util.bars import Bar

#: Number of clips at once.
_BATCH = 16
#: Steps of integrated gradients.
_STEPS = 8


@dataclass(frozen=True)
class ForceReading:
    """Forces of labelled clips, frames 2..T.

    Attributes:
        measured: float32 (n, T - 1, 3), newton; NaN along axes without a label.
        predicted: float32 (n, T - 1, 3), newton.
        clips: int64 (n,), numbers of the clips in their split.
    """

    measured: NDArray[np.float32]
    predicted: NDArray[np.float32]
    clips: NDArray[np.int64]


@dataclass(frozen=True)
class ClipSample:
    """Embedded clips of a split.

    Attributes:
        clips: int64 (n,), numbers of the clips in their split.
        cls: float32 (n, projected), projected class tokens.
        moved: float32 (n,), mean absolute change from the first frame, grey levels.
    """

    clips: NDArray[np.int64]
    cls: NDArray[np.float32]
    moved: NDArray[np.float32]


class _Row(NamedTuple):
    """One clip: its caption, class token and motion, and its forces of frames 2..T, N."""

    caption: str
    cls: NDArray[np.float32]
    moved: NDArray[np.float32]
    measured: NDArray[np.float32]
    forces: dict[str, NDArray[np.float32]]


@contextmanager
def quiet(module: TouchModule, seed: int = 0) -> Iterator[None]:
    """Evaluation mode without gradients, with a fixed seed and untouched outer random state."""
    devices = [module.device] if module.device.type == "cuda" else []
    # of each part: frozen ones are in evaluation mode while the rest trains
    modes = [(part, part.training) for part in module.modules()]
    module.eval()
    try:
        with torch.no_grad(), torch.random.fork_rng(devices):
            torch.manual_seed(seed)
            yield
    finally:
        for part, training in modes:
            part.training = training


def spread(
    clips: Clips, count: int, keep: Callable[[Recording], bool] = lambda _: True
) -> list[int]:
    """Chooses at most ``count`` clips, spread evenly over the recordings passed by ``keep``."""
    which = clips.index[:, 0]
    numbers = [int(n) for n in np.unique(which) if keep(clips.recordings[n])]
    if len(numbers) > count:
        numbers = [numbers[i] for i in np.linspace(0, len(numbers) - 1, count).round().astype(int)]
    chosen: list[int] = []
    for place, number in enumerate(numbers):
        members = np.flatnonzero(which == number)
        # what short recordings leave over goes to those after them
        quota = (count - len(chosen)) // (len(numbers) - place)
        chosen += members[spread_places(len(members), quota)].tolist()
    return chosen


def clip_title(clips: Clips, clip: int) -> str:
    """Sensor, object and key of the recording of a clip, as far as they are known."""
    recording = clips.recordings[clips.index[clip, 0]]
    return " · ".join(filter(None, (recording.sensor, recording.object, recording.key)))


def whole_key(recording: Recording) -> str:
    """Key of a recording without the suffix of a part, see `Recording.part`."""
    return re.sub(r"(\[\d+:\d+\])+$", "", recording.key)


def spread_places(length: int, count: int) -> NDArray[np.int64]:
    """Indices spread over ``0..length - 1``: the middles of ``count`` equal parts."""
    count = min(length, count)
    return ((np.arange(count) + 0.5) * length / max(1, count)).astype(np.int64)


def batches(module: TouchModule, clips: Clips, which: Sequence[int]) -> Iterator[Batch]:
    """Small batches of clips on the module's device, prepared as in validation."""
    for start in range(0, len(which), _BATCH):
        batch = collate([clips[clip] for clip in which[start : start + _BATCH]])
        fill_captions(batch)
        yield {k: v.to(module.device) if isinstance(v, Tensor) else v for k, v in batch.items()}


class ClipReader:
    """Runs the module on clips of a split, once for each clip.

    Args:
        module: The trained module.
        clips: Clips of the split.
        forces: Objectives whose heads predict `heads.force.Forces`.
        skipped: Recordings that could not be read; grows by a line for each new one.
    """

    def __init__(
        self, module: TouchModule, clips: Clips, forces: Sequence[str], skipped: Skipped
    ) -> None:
        self.clips = clips
        self._module, self._forces, self._skipped = module, forces, skipped
        self._asked: dict[int, int] = {}
        self._rows: dict[int, _Row] = {}

    def embed(self, which: Sequence[int]) -> ClipSample:
        """Returns class tokens and motion of clips, ordered by number."""
        places = np.unique(self._read(which))
        rows = [self._rows[place] for place in places.tolist()]
        return ClipSample(
            places, np.stack([row.cls for row in rows]), np.stack([row.moved for row in rows])
        )

    def captions(self, which: Sequence[int]) -> list[str]:
        """Returns captions of clips, in their order; "" for none."""
        return [self._rows[clip].caption for clip in self._read(which)]

    def vectors(self, which: Sequence[int]) -> NDArray[np.float32]:
        """Returns projected class tokens of clips, (n, projected), in their order."""
        return np.stack([self._rows[clip].cls for clip in self._read(which)])

    def forces(self, which: Sequence[int], key: str) -> ForceReading | None:
        """Returns measured forces and those of one head; None without a labelled clip."""
        kept = [clip for clip in self._read(which) if np.isfinite(self._rows[clip].measured).any()]
        if not kept:
            return None
        rows = [self._rows[clip] for clip in kept]
        measured = np.stack([row.measured for row in rows])
        return ForceReading(measured, np.stack([row.forces[key] for row in rows]), np.array(kept))

    def _read(self, which: Sequence[int]) -> list[int]:
        """Runs clips and returns their numbers; an unreadable clip is replaced by another one."""
        missing = [clip for clip in which if clip not in self._asked]
        read: list[int] = []
        # a few clips are read while others are shown: a line of their own would tell nothing
        bar = Bar(total=len(missing), desc="report", unit="clip", disable=len(missing) <= _BATCH)
        with quiet(self._module), bar:
            for batch in batches(self._module, self.clips, missing):
                self._skipped |= batch["skipped"]
                numbers = batch["clip"].tolist()  # those that were read, not those asked for
                self._rows |= zip(numbers, self._rows_of(batch), strict=True)
                read += numbers
                bar.update(len(numbers))
        self._asked |= zip(missing, read, strict=True)
        return [self._asked[clip] for clip in which]

    def _rows_of(self, batch: Batch) -> Iterator[_Row]:
        views = self._module.encoder.views(batch)
        frames = batch["frames"].float()
        scale = batch["force_scale"][:, None]
        heads = {key: self._module.heads[key](views, batch) for key in self._forces}
        columns = [
            views.full.cls.float(),
            (frames - frames[:, :1]).abs().mean((1, 2, 3, 4)),
            torch.where(batch["force_valid"][:, None], batch["force"][:, 1:], torch.nan),
            *(head.force.float() * scale for head in heads.values()),
        ]
        arrays = (column.cpu().numpy() for column in columns)
        rows = zip(batch["text"], *arrays, strict=True)
        for caption, cls, moved, measured, *forces in rows:
            yield _Row(caption, cls, moved, measured, dict(zip(heads, forces, strict=True)))


def liveliest(clips: Clips, seen: ClipSample, count: int) -> list[int]:
    """Chooses clips with much motion, of different recordings: sensors in turn, new objects first.

    A clip of a new object is preferred to one with up to four times its motion.
    """
    queues: dict[str, list[tuple[float, int]]] = {}
    used: set[int] = set()
    for place in np.argsort(-seen.moved, kind="stable").tolist():
        clip = int(seen.clips[place])
        recording = int(clips.index[clip, 0])
        if recording not in used:
            used.add(recording)
            queue = queues.setdefault(clips.recordings[recording].sensor, [])
            queue.append((float(seen.moved[place]), clip))
    chosen: list[int] = []
    shown: set[str | None] = set()
    while len(chosen) < count and any(queues.values()):
        for _, queue in sorted(queues.items()):
            names = [clips.recordings[clips.index[clip, 0]].object for _, clip in queue]
            fresh = (
                i
                for i, (moved, _) in enumerate(queue)
                if names[i] not in shown and moved >= queue[0][0] / 4
            )
            if queue:
                place = next(fresh, 0)
                shown.add(names[place])
                chosen.append(queue.pop(place)[1])
    return chosen[:count]


def predictions(
    module: TouchModule, clips: Clips, which: Sequence[int]
) -> tuple[Tensor, dict[str, Any]]:
    """Patches of one batch of clips, and the predictions of every head, by objective."""
    with quiet(module):
        batch = next(batches(module, clips, which))
        views = module.encoder.views(batch)
        return views.patches, {key: head(views, batch) for key, head in module.heads.items()}


def saliency(module: TouchModule, clips: Clips, which: Sequence[int]) -> Tensor | None:
    """Share of each patch in the distance of a clip's vector from the untouched gel's.

    Integrated gradients (Sundararajan et al. 2017) of the squared distance of the two projected
    class tokens, along the straight line from the gel at rest to the clip. The shares of a clip sum
    to the squared distance, to a few per cent; one below 0 makes it smaller.

    Returns:
        float (n, slots, N); None for an encoder without patches or gradients.
    """
    encoder: Any = module.encoder
    if not (hasattr(encoder, "encode") and hasattr(encoder, "pool_tokens")):
        return None
    with quiet(module):
        batch = next(batches(module, clips, which))
        still = batch["background"][:, None].expand_as(batch["frames"])
        rest, sensor = (
            encoder.views({**batch, "frames": still}),
            encoder.sensor_ids(batch["sensor"]),
        )
        start, untouched = rest.patches, rest.full.cls.float()
        change = encoder.views(batch).patches - start
        out = torch.zeros(change.shape[:-1], device=change.device)
        for step in range(_STEPS):
            patches = start + (step + 0.5) / _STEPS * change
            with torch.enable_grad():
                patches.requires_grad_()
                moved = encoder.pool_tokens(encoder.encode(patches, sensor)).float() - untouched
                if not moved.requires_grad:  # a network that keeps no gradients
                    return None
                (gradient,) = torch.autograd.grad(moved.square().sum(), patches)
            out += (gradient * change).sum(-1) / _STEPS
        return out


def explained(
    module: TouchModule, clips: Clips, which: Sequence[int], keys: Sequence[str]
) -> dict[str, float]:
    """Share of the variance of hidden pixels explained by reconstructions, over all clips, by kind.

    Args:
        module: The trained module.
        clips: Clips of the split.
        which: Numbers of the clips to reconstruct.
        keys: Objectives whose heads predict `heads.decoder.Reconstruction`.
    """
    sums: dict[str, Tensor] = {}
    with quiet(module):
        for batch in batches(module, clips, which if keys else []):
            views = module.encoder.views(batch)
            for key in keys:
                reconstruction: Reconstruction = module.heads[key](views, batch)
                if kind := kind_of(reconstruction, module.encoder.frames):
                    sums[kind] = sums.get(kind, torch.zeros(2)) + residuals(
                        reconstruction, kind
                    ).sum(0)
    return {kind: share(residual) for kind, residual in sums.items()}
