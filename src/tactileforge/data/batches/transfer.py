"""Batches on their way to a device: pinned on the host, copied beside what the device computes."""

from __future__ import annotations

import torch
from torch import Tensor

from tactileforge.contracts import Batch


class Transfer:
    """Copies batches to a card on a stream of its own.

    The host runs ahead of the card, so the copy of the next batch starts while the card still
    computes; its step waits for the copy, on the card. Elsewhere than on a card a batch is copied
    as it is.
    """

    def __init__(self) -> None:
        self._stream: torch.cuda.Stream | None = None

    def __call__(self, batch: Batch, device: torch.device) -> Batch:
        """The batch with its tensors on a device; the host does not wait."""
        if device.type != "cuda":
            return _moved(batch, device)
        if self._stream is None:
            self._stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]
        with torch.cuda.stream(self._stream):
            batch = _moved(pin(batch), device)
        consumer = torch.cuda.current_stream(device)
        consumer.wait_stream(self._stream)
        for value in batch.values():
            if isinstance(value, Tensor):
                value.record_stream(consumer)  # its memory is not used again before the step ends
        return batch


def pin(batch: Batch) -> Batch:
    """The batch in memory that a card reads by itself; what is there already stays."""
    return {
        key: value.pin_memory() if isinstance(value, Tensor) and _pageable(value) else value
        for key, value in batch.items()
    }


def _pageable(x: Tensor) -> bool:
    return x.device.type == "cpu" and not x.is_pinned()


def _moved(batch: Batch, device: torch.device) -> Batch:
    return {
        key: value.to(device, non_blocking=True) if isinstance(value, Tensor) else value
        for key, value in batch.items()
    }
