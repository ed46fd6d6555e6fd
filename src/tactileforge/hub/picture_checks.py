"""Checks of the pictures that a program gives, once a background."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

#: Pixels between those that tell one background from another, and backgrounds that are remembered.
_STEP, _KEPT = 16, 256


class PictureChecks:
    """Looks at each background once: a stream gives the same one with every clip."""

    def __init__(self) -> None:
        self._seen: set[int] = set()

    def __call__(
        self, background: Any, sensor: str | Sequence[str] | None, stacklevel: int = 3
    ) -> None:
        """Warn of a background that is mirrored, on its side, or of other colours for its sensor.

        Args:
            background: uint8 (H, W, 3) or (3, H, W), or a batch; words and None are passed over.
            sensor: Name of the sensor; None and lists are passed over.
            stacklevel: Level of the caller, as in `warnings.warn`.
        """
        if torch.compiler.is_compiling() or not isinstance(sensor, str):
            return
        if not isinstance(background, np.ndarray | Tensor) or background.ndim not in (3, 4):
            return
        from tactileforge.checks.doors import background_lines  # not while a model is loaded

        still = background if background.ndim == 3 else background[0]
        if still.dtype not in (np.uint8, torch.uint8) or 3 not in (still.shape[0], still.shape[-1]):
            return  # refused elsewhere, with what was expected
        still = still if still.shape[-1] == 3 else still.swapaxes(0, 1).swapaxes(1, 2)
        few = still[::_STEP, ::_STEP]
        mark = hash((sensor, bytes(few.cpu().numpy() if isinstance(few, Tensor) else few.copy())))
        if mark in self._seen:
            return
        if len(self._seen) >= _KEPT:
            self._seen.clear()
        self._seen.add(mark)
        picture = still.cpu().numpy() if isinstance(still, Tensor) else still
        for line in background_lines(np.ascontiguousarray(picture), sensor):
            warnings.warn(f"{line}. checks=False is silent", stacklevel=stacklevel + 1)
