"""Outputs of a trained module on some clips: embeddings, forces, reconstructions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.contracts import Batch, Recording
from tactileforge.data.batches.clips import Clips, Skipped, collate
from tactileforge.data.labels.augment import fill_captions
from tactileforge.heads.decoder import Reconstruction
from tactileforge.heads.force import Forces
from tactileforge.module import TouchModule
from tactileforge.report.pictures import kind_of, residuals, share

_BATCH = 16


@dataclass(frozen=True)
class ForceReading:
    """Forces of labelled clips, frames 2..T.

    Attributes:
        measured: float32 (n, T - 1, 3), newton; NaN along axes without a label.
        predicted: float32 (n, T - 1, 3), newton.
        clips: int64 (n,), which clips.
    """

    measured: NDArray[np.float32]
    predicted: NDArray[np.float32]
    clips: NDArray[np.int64]


@dataclass(frozen=True)
class ClipSample:
    """Clips as the encoder sees them.

    Attributes:
        clips: int64 (n,), which clips.
        cls: float32 (n, projected), projected class tokens.
        moved: float32 (n,), mean change from the first frame, in grey levels.
    """

    clips: NDArray[np.int64]
    cls: NDArray[np.float32]
    moved: NDArray[np.float32]


@contextmanager
def quiet(module: TouchModule, seed: int = 0) -> Iterator[None]:
    """Evaluation mode, no gradients, the same random numbers each time; none used up outside."""
    devices = [module.device] if module.device.type == "cuda" else []
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
    """At most ``count`` clips, shared out evenly over the recordings that are kept."""
    which = clips.index[:, 0]
    numbers = [int(n) for n in np.unique(which) if keep(clips.recordings[n])]
    if len(numbers) > count:
        numbers = [numbers[i] for i in np.linspace(0, len(numbers) - 1, count).round().astype(int)]
    chosen: list[int] = []
    for place, number in enumerate(numbers):
        members = np.flatnonzero(which == number)
        quota = (count - len(chosen)) // (len(numbers) - place)
        chosen += members[spread_places(len(members), quota)].tolist()
    return chosen


def whole_key(recording: Recording) -> str:
    """Key of the recording that a part was cut from (see `Recording.part`), or its own."""
    return re.sub(r"(\[\d+:\d+\])+$", "", recording.key)


def spread_places(length: int, count: int) -> NDArray[np.int64]:
    """``count`` places spread over ``0..length - 1``: the middles of equal parts."""
    count = min(length, count)
    return ((np.arange(count) + 0.5) * length / max(1, count)).astype(np.int64)


def batches(module: TouchModule, clips: Clips, which: Sequence[int]) -> Iterator[Batch]:
    """Small batches of clips, on the module's device, as the encoder gets them in validation."""
    for start in range(0, len(which), _BATCH):
        batch = collate([clips[clip] for clip in which[start : start + _BATCH]])
        fill_captions(batch)
        yield {k: v.to(module.device) if isinstance(v, Tensor) else v for k, v in batch.items()}


def embed_clips(
    module: TouchModule, clips: Clips, which: Sequence[int], skipped: Skipped
) -> ClipSample:
    """Embeds clips; one that cannot be read is left out, and ``skipped`` grows by a line.

    Args:
        module: The trained module.
        clips: The split that the clips belong to.
        which: Clips to embed.
        skipped: Recordings that could not be read.
    """
    rows, moved, numbers = [], [], []
    with quiet(module):
        for batch in batches(module, clips, which):
            skipped |= batch["skipped"]
            rows.append(module.encoder.views(batch).full.cls.float().cpu().numpy())
            change = batch["frames"].float() - batch["frames"][:, :1].float()
            moved.append(change.abs().mean((1, 2, 3, 4)).cpu().numpy())
            numbers.append(batch["clip"].cpu().numpy())
    places, first = np.unique(np.concatenate(numbers), return_index=True)
    return ClipSample(places, np.concatenate(rows)[first], np.concatenate(moved)[first])


def liveliest(clips: Clips, seen: ClipSample, count: int) -> list[int]:
    """Clips that change much, of different recordings: sensors in turn, and new objects first.

    A clip of a new object is taken before one that changes up to four times as much.
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
    """The patches of one batch of clips, and the predictions of every head, by objective."""
    with quiet(module):
        batch = next(batches(module, clips, which))
        views = module.encoder.views(batch)
        return views.patches, {key: head(views, batch) for key, head in module.heads.items()}


def explained(
    module: TouchModule, clips: Clips, which: Sequence[int], keys: Sequence[str]
) -> dict[str, float]:
    """Share of the variance of hidden pixels that reconstructions explain over all clips, by kind.

    Args:
        module: The trained module.
        clips: The split that the clips belong to.
        which: Clips to reconstruct.
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


def read_forces(
    module: TouchModule, clips: Clips, which: Sequence[int], key: str
) -> ForceReading | None:
    """Forces as measured and as one head predicts them; None without a labelled clip.

    Args:
        module: The trained module.
        clips: The split that the clips belong to.
        which: Clips to read.
        key: The objective; its head predicts `heads.force.Forces`.
    """
    measured, predicted, numbers = [], [], []
    with quiet(module):
        for batch in batches(module, clips, which):
            forces: Forces = module.heads[key](module.encoder.views(batch), batch)
            valid = batch["force_valid"][:, None]
            scaled = forces.force.float() * batch["force_scale"][:, None]
            true = torch.where(valid, batch["force"][:, 1:], torch.nan)
            kept = batch["force_valid"].any(1)
            predicted.append(scaled[kept].cpu().numpy())
            measured.append(true[kept].cpu().numpy())
            numbers.append(batch["clip"][kept].cpu().numpy())
    if not sum(map(len, numbers)):
        return None
    return ForceReading(*(np.concatenate(part) for part in (measured, predicted, numbers)))
