"""Transfer of batches to a device: pinned memory, and copies beside the computation."""

from __future__ import annotations

import torch
from torch import Tensor

from tactileforge.contracts import Batch


class Transfer:
    """Copy of batches to a CUDA device on a stream of its own.

    The host runs ahead of the device, so the copy of the next batch starts while the device still
    computes; the step of that batch waits for the copy, on the device. To other devices, a batch is
    copied at once.
    """

    def __init__(self) -> None:
        self._stream: torch.cuda.Stream | None = None

    def __call__(self, batch: Batch, device: torch.device) -> Batch:
        """Copy the tensors of a batch to a device; the host does not wait."""
        if device.type != "cuda":
            return _moved(batch, device)
        if self._stream is None:
            self._stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]
        with torch.cuda.stream(self._stream):
            # from pageable memory, a copy blocks the host whatever non_blocking says
            batch = _moved(pin(batch), device)
        consumer = torch.cuda.current_stream(device)
        # on the device: the host goes on at once
        consumer.wait_stream(self._stream)
        for value in batch.values():
            if isinstance(value, Tensor):
                # the allocator knows only the stream of the copy: without this, it could hand the
                # memory to the next copy while the step still reads it (torch.Tensor.record_stream)
                value.record_stream(consumer)
        return batch


def pin(batch: Batch) -> Batch:
    """Pin the tensors of a batch on the host."""
    return {
        # a loader has pinned most of them already, and what is on the device cannot be
        key: value.pin_memory()
        if isinstance(value, Tensor) and value.device.type == "cpu" and not value.is_pinned()
        else value
        for key, value in batch.items()
    }


def _moved(batch: Batch, device: torch.device) -> Batch:
    return {
        key: value.to(device, non_blocking=True) if isinstance(value, Tensor) else value
        for key, value in batch.items()
    }
