"""The origin of a NaN: the first operation with one from finite numbers."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

#: Folders of the files that are not the author's: torch, and this package.
_NOT_THEIRS = (str(Path(torch.__file__).parent), str(Path(__file__).parent))


class NanWatch(TorchFunctionMode):
    """Notes the first operation with NaN from inputs without one.

    Example:
        >>> with NanWatch() as watch:
        ...     _ = torch.zeros(0).mean()
        >>> watch.cause.partition(" at ")[0]
        'mean of an empty set, which is 0/0,'
    """

    def __init__(self) -> None:
        super().__init__()
        self.cause = ""

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Any,
        args: tuple[Any, ...] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        """Computes an operation, and looks at its result."""
        if self.cause or "empty" in getattr(func, "__name__", ""):  # what is not written yet
            return func(*args, **(kwargs or {}))
        with torch._C.DisableTorchFunction():
            given = _tensors([args, kwargs])
            blank = not any(map(_has_nan, given))  # before it, as it may write into its input
            words = _words(func, given)
        result = func(*args, **(kwargs or {}))
        with torch._C.DisableTorchFunction():
            if blank and any(map(_has_nan, _tensors(result))):
                self.cause = f"{words} at {_place()}"
        return result


def cause_of_nan(loss: Callable[[], Tensor]) -> str:
    """The cause of NaN in a loss, or else in its gradients, as the end of a message.

    Args:
        loss: Computes the loss.

    Returns:
        ``: NaN comes from ...``; "" where there is none.
    """
    with NanWatch() as watch:
        value = loss()
    if watch.cause:
        return f": NaN comes from {watch.cause}"
    if not value.requires_grad:
        return ""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")  # of the place, which the error does not name
        try:
            with torch.autograd.detect_anomaly():
                torch.autograd.backward(loss())
        except RuntimeError as error:
            lines = re.findall(
                r'File "(.+)", line (\d+)', "".join(str(one.message) for one in said)
            )
            theirs = [(file, line) for file, line in lines if not file.startswith(_NOT_THEIRS)]
            place = f" at {Path(theirs[-1][0]).name}:{theirs[-1][1]}" if theirs else ""
            why = "0 times infinity, as of a root at 0"
            return f": NaN comes from the gradient{place} ({why}): {error}"
    return ""


def _words(func: Callable[..., Any], given: list[Tensor]) -> str:
    name = getattr(func, "__name__", str(func)).strip("_")
    if any(tensor.numel() == 0 for tensor in given):
        return f"{name} of an empty set, which is 0/0,"
    if name in ("div", "truediv", "true_divide", "divide", "rtruediv"):
        return "0/0 (of an empty set? divide by count.clamp(min=1))"
    return name


def _tensors(value: Any) -> list[Tensor]:
    if isinstance(value, Tensor):
        return [value]
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [tensor for one in value for tensor in _tensors(one)]
    return []


def _has_nan(tensor: Tensor) -> bool:
    return bool(torch.isnan(tensor.detach()).any())


def _place() -> str:
    """File and line of the operation's caller."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_code.co_filename.startswith(_NOT_THEIRS):
        frame = frame.f_back
    return f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}" if frame else "?"
