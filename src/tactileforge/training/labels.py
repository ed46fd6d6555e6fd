"""Counts the labels of each objective in training, and warns of objectives without any."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from collections.abc import Set as AbstractSet

from torch import Tensor

from tactileforge.contracts import AXES, Batch

log = logging.getLogger(__name__)

#: Batches of an objective after which it is warned of, if none of them had a label.
PATIENCE = 20


class Labels:
    """Counts of labelled clips of each objective, on this process.

    Args:
        counts: Earlier counts to continue from; None starts at 0.

    Attributes:
        counts: For each objective that needs labels: its ``batches`` and ``clips`` so far, its
            ``labelled`` clips, and for forces the clips labelled along ``x``, ``y`` and ``z``.
    """

    def __init__(self, counts: Mapping[str, Mapping[str, int]] | None = None) -> None:
        self.counts = {key: dict(count) for key, count in (counts or {}).items()}

    def add(self, key: str, needs: AbstractSet[str], batch: Batch) -> None:
        """Counts a batch on the host, and warns of an objective without labels.

        Args:
            key: Name of the objective.
            needs: Labels that the objective needs; see `contracts.Objective`.
            batch: Batch in the format of `tactileforge.contracts`.
        """
        if not needs:
            return
        count = self.counts.setdefault(key, dict.fromkeys(("batches", "clips", "labelled"), 0))
        count["batches"] += 1
        count["clips"] += len(batch["group"])
        count["labelled"] += sum(known(batch, needs))
        if "force" in needs:
            met = batch["force_valid"].sum(0).tolist()
            for axis, number in zip(AXES, met, strict=True):
                count[axis] = count.get(axis, 0) + int(number)
        if count["batches"] == PATIENCE and (line := self.missing(key)):
            log.warning(line)

    def missing(self, key: str, has_ended: bool = False) -> str:
        """Problem with the labels of an objective; "" without one, or before `PATIENCE` batches.

        Args:
            key: Name of the objective.
            has_ended: Whether no more batches come, so that few batches are judged too.
        """
        count = self.counts.get(key)
        if count is None or (count["batches"] < PATIENCE and not has_ended):
            return ""
        extent = f"its first {count['batches']} batches ({count['clips']} clips)"
        if not count["labelled"] and count["batches"] < PATIENCE:
            return f"objective {key!r} has seen no label in {extent}: it has no loss"
        if not count["labelled"]:
            return (
                f"objective {key!r} has seen no label in {extent}: it learns nothing. Give sources "
                "that have its labels a share (batch.shares), or leave it out of objective=[...]"
            )
        blind = [axis for axis in AXES if not count.get(axis, 1)]
        if blind and count["batches"] >= PATIENCE:
            return (
                f"objective {key!r} has seen no force along {' and '.join(blind)} in {extent}: it "
                "learns only the other axes"
            )
        return ""


def known(batch: Batch, needs: AbstractSet[str]) -> list[bool]:
    """Whether each clip has every needed label, on the host.

    Args:
        batch: Batch in the format of `tactileforge.contracts`.
        needs: Labels that an objective needs; see `contracts.Objective`.

    Example:
        >>> known({"text": ["a ball", ""]}, {"text"})
        [True, False]
    """
    rows = [[_has(batch, label) for label in need.split("|")] for need in needs]
    every = [[any(clip) for clip in zip(*row, strict=True)] for row in rows]
    return [all(clip) for clip in zip(*every, strict=True)]


def _has(batch: Batch, label: str) -> list[bool]:
    if label == "text":
        return [bool(text) for text in batch["text"]]
    value: Tensor = batch[f"{label}_valid"] if f"{label}_valid" in batch else batch[label] >= 0
    present: list[bool] = value.reshape(len(value), -1).any(1).tolist()
    return present
