"""timm imports torchvision, and not every build of it fits every build of torch."""

import importlib.util
from pathlib import Path
from typing import Any

import pytest
import torch

#: Operators that torchvision names on import, whether its library could be loaded or not.
_NAMED = (
    "nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
    "qnms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
)


def _declare_operators() -> Any:
    """Declares the operators of a torchvision whose library does not fit this torch.

    The networks of timm use none of them. It is done here and not in the package: a user has a
    torchvision that fits.
    """
    found = importlib.util.find_spec("torchvision")
    if found is None or found.origin is None:
        return None
    try:
        for library in Path(found.origin).parent.glob("_C*.so"):
            torch.ops.load_library(library)
        torch.ops.torchvision.nms  # noqa: B018
        return None
    except (OSError, AttributeError, RuntimeError):
        declared = torch.library.Library("torchvision", "DEF")
        for operator in _NAMED:
            declared.define(operator)
        return declared


#: Kept: the operators are gone with it.
_LIBRARY = _declare_operators()


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)
