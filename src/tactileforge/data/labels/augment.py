"""Augmentation with consistent labels: a mirrored touch has a mirrored force.

Flips are drawn on the host, together with the change of labels and captions; the pixels follow on
the device. Pictures of taxel arrays stay unchanged: their colours are forces, and a mirrored force
has another colour.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.contracts import ACTIONS, Batch
from tactileforge.data.labels import displacement
from tactileforge.sensors.specs import spec

#: Phrases of captions by action; "" stands for an unknown one.
PHRASES = {
    "press": "pressing",
    "leave": "leaving",
    "slide_left": "sliding left",
    "slide_right": "sliding right",
    "slide_up": "sliding up",
    "slide_down": "sliding down",
    "rotate_cw": "rotating clockwise",
    "rotate_ccw": "rotating counter-clockwise",
    "": "touching",
}
_SWAPS = {
    "horizontal": (("slide_left", "slide_right"), ("rotate_cw", "rotate_ccw")),
    "vertical": (("slide_up", "slide_down"), ("rotate_cw", "rotate_ccw")),
}


def _swap(pairs: tuple[tuple[str, str], ...]) -> Tensor:
    table = list(range(len(ACTIONS)))
    for a, b in pairs:
        i, j = ACTIONS.index(a), ACTIONS.index(b)
        table[i], table[j] = j, i
    return torch.tensor([*table, -1])  # the last entry keeps -1, unknown


def flip_labels(batch: Batch, horizontal: Tensor, vertical: Tensor) -> None:
    """Flip forces and actions of flipped clips, in place.

    A horizontal flip negates the x shear and swaps left with right, a vertical one negates the y
    shear and swaps up with down; either swaps clockwise with counter-clockwise.

    Args:
        batch: Batch on the host.
        horizontal: bool (B,), clips mirrored left to right.
        vertical: bool (B,), clips mirrored top to bottom.
    """
    for axis, (name, flipped) in enumerate((("horizontal", horizontal), ("vertical", vertical))):
        swapped = _swap(_SWAPS[name])[batch["action"]]
        batch["action"] = torch.where(flipped, swapped, batch["action"])
        sign = torch.where(flipped, -1.0, 1.0)
        # not in place: others may still hold the tensor
        batch["force"] = batch["force"].clone()
        batch["force"][..., axis] *= sign[:, None]


def fill_captions(batch: Batch) -> None:
    """Replace ``{action}`` in captions by the phrase of the clip's action, in place."""
    actions = [ACTIONS[i] if i >= 0 else "" for i in batch["action"].tolist()]
    batch["text"] = [
        text.replace("{action}", PHRASES[action])
        for text, action in zip(batch["text"], actions, strict=True)
    ]


class Augment(nn.Module):
    """Flips and colour jitter of whole clips: all frames and the background are treated alike.

    Clips of taxel arrays stay unchanged, and clips paired with one are not flipped.

    Args:
        horizontal: Probability of a flip left to right.
        vertical: Probability of a flip top to bottom.
        jitter: Largest relative change of brightness, contrast and saturation; 0 for none.
    """

    def __init__(self, horizontal: float = 0.5, vertical: float = 0.5, jitter: float = 0.0) -> None:
        super().__init__()
        self.horizontal = horizontal
        self.vertical = vertical
        self.jitter: nn.Module | None = None
        if jitter:
            # imported here: kornia takes seconds, and most recipes have no jitter
            from kornia.augmentation import ColorJiggle, VideoSequential

            self.jitter = VideoSequential(
                ColorJiggle(jitter, jitter, jitter, 0.0, p=0.8),
                data_format="BTCHW",
                same_on_frame=True,
            )

    def labels(self, batch: Batch) -> Batch:
        """Draw the flips on the host, and flip the labels accordingly.

        Clips of one matching group are flipped alike: a pair of one action stays one. Adds
        ``flip``, bool (B, 2): horizontal, vertical; and ``coded``, bool (B,): clips of taxel
        arrays.
        """
        group = batch["group"]
        coded = torch.tensor([spec(name).kind == "array" for name in batch["sensor"]])
        fixed = coded | ((group[:, None] == group) & (group >= 0) & coded).any(1)
        draw = torch.rand(len(group), 2)
        first = (group[:, None] == group).int().argmax(dim=1)
        # drawn for all clips: so the random numbers used do not depend on the pairs
        draw = torch.where((group >= 0)[:, None], draw[first], draw)
        flip = (draw < torch.tensor([self.horizontal, self.vertical])) & ~fixed[:, None]
        flip_labels(batch, flip[:, 0], flip[:, 1])
        return batch | {"flip": flip, "coded": coded}

    @torch.no_grad()
    def forward(self, batch: Batch) -> Batch:
        """Flip and jitter the pixels on the device; frames and background stay uint8."""
        clip = torch.cat([batch["background"][:, None], batch["frames"]], dim=1)
        for axis, dim in ((0, -1), (1, -2)):
            flipped = batch["flip"][:, axis, None, None, None, None]
            clip = torch.where(flipped, clip.flip(dim), clip)
        if self.jitter is not None:
            jittered: Any = self.jitter(clip.float() / 255)
            jittered = (jittered * 255).round().clamp(0, 255).to(torch.uint8)
            clip = torch.where(batch["coded"][:, None, None, None, None], clip, jittered)
        moved: Batch = {"background": clip[:, 0], "frames": clip[:, 1:]}
        if "surface" in batch:
            moved["surface"] = _mirrored(batch["surface"], batch["flip"])
        return batch | moved


def _mirrored(surface: Tensor, flip: Tensor) -> Tensor:
    for axis in (0, 1):
        flipped = flip[:, axis, None, None, None, None]
        surface = torch.where(flipped, displacement.mirror_displacement(surface, axis), surface)
    return surface
