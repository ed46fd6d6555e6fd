"""Operators of a call with a kernel on a card, counted on a CPU without a card.

Counted is what the dispatcher hands to the kernels of a device, forward, backward and update,
except views and empty tensors. Operators on a list of tensors (``_foreach``, fused AdamW) count
once: on a card they are one kernel, or a few for many tensors. The count depends on the depth, not
on the width or the picture: `small` is as deep as `base`.

Run: python launches.py
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import torch
from common import save
from torch.utils._python_dispatch import TorchDispatchMode
from train_subjects import Case, build

#: Operators that compute nothing: new memory, other shapes, and numbers read by the host.
_NOTHING: tuple[str, ...] = (
    "empty",
    "new_empty",
    "resize",
    "set_",
    "detach",
    "lift",
    "_unsafe_view",
)
_NOTHING += ("_reshape_alias", "is_", "_local_scalar_dense", "as_strided", "_record_function")

SUBJECTS = ("pixel+diff", "videomae", "all five")


class Launches(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """Counts launches of operators in its block.

    Attributes:
        names: Counts by name of the operator.
        backward: Counts of the backward pass (True), and of all else.
    """

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.names: Counter[str] = Counter()
        self.backward: Counter[bool] = Counter()

    def __torch_dispatch__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        name = func.overloadpacket.__name__
        if not func.is_view and not name.startswith(_NOTHING):
            self.names[name] += 1
            self.backward[torch._C._current_autograd_node() is not None] += 1
        return func(*args, **(kwargs or {}))

    @property
    def total(self) -> int:
        """Number of launches."""
        return sum(self.names.values())


def count(subject: str, size: str = "small") -> Launches:
    """Counts a training step: forward, backward, clipping and fused AdamW, in float32.

    Args:
        subject: One of `SUBJECTS`.
        size: Size of the encoder.
    """
    built = build(Case(subject, size, batch=2, image=32))
    parameters = [p for p in built.module.parameters() if p.requires_grad]
    optimizer = torch.optim.AdamW(parameters, lr=1e-4, fused=True)

    def step() -> None:
        torch.autograd.backward(built.loss(built.batch))
        torch.nn.utils.clip_grad_norm_(parameters, 1.0)
        optimizer.step()
        optimizer.zero_grad()

    step()  # the first one fills the averages of AdamW
    found = Launches()
    with found:
        step()
    return found


def main() -> None:
    torch.set_num_threads(1)
    found = {name: count(name) for name in SUBJECTS}
    ours = found["pixel+diff"].total
    save(
        "launches",
        {
            "what": "operators that launch in a training step as deep as base, float32",
            "launches": {name: one.total for name, one in found.items()},
            "of the backward pass": {name: one.backward[True] for name, one in found.items()},
            "pixel+diff, multiple of videomae": round(ours / found["videomae"].total, 3),
            "all five, multiple of pixel+diff": round(found["all five"].total / ours, 3),
            "by name": {name: dict(one.names.most_common(20)) for name, one in found.items()},
        },
    )


if __name__ == "__main__":
    main()
