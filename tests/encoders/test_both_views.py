"""Both views in one pass of the encoder: the numbers and gradients of two passes."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from tactileforge.encoders.backbone import Backbone, TactileViews
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.encoders.transformer import Transformer
from tactileforge.testing import batch

SMALL: dict[str, Any] = {"size": "tiny", "depth": 2, "frames": 4, "image_size": 32}
STEMS: dict[str, Any] = {"stems": 2, "stem_depth": 1, "sensors": {"digit": 1, "gelsight": 0}}
ENCODERS: dict[str, tuple[type[Backbone], dict[str, Any]]] = {
    "tactile_vit": (TactileViT, {}),
    "no sensor tokens, a learned key": (TactileViT, {"sensor_tokens": 0, "bias_kv": True}),
    "plain_vit": (PlainViT, {}),
    "registers and a class token": (PlainViT, {"registers": 2, "class_token": True}),
    "pooled norm": (PlainViT, {"norm": "pooled", "projected": 16}),
    "stems": (PlainViT, STEMS | {"positions": "learned", "class_token": True}),
}


def values(encoder: Backbone, both: bool) -> tuple[list[torch.Tensor], dict[str, torch.Tensor]]:
    """Readings of both views by heads, and the gradients of the encoder's weights."""
    torch.manual_seed(3)
    made = batch(4, frames=4, image=32) | {"sensor": ["digit", "gelsight"] * 2}
    torch.manual_seed(4)
    views: TactileViews = encoder.views(made, 0.5)
    if both:
        views.compute_both()
    seen = [views.full.tokens, views.full.cls, views.masked.tokens, views.masked.cls]
    encoder.zero_grad()
    sum((x * torch.linspace(-1, 1, x.shape[-1])).sum() for x in seen).backward()  # type: ignore[union-attr]
    grads = {k: p.grad.clone() for k, p in encoder.named_parameters() if p.grad is not None}
    return [*seen, views.masked.kept, views.masked.masked], grads


@pytest.mark.parametrize("name", ENCODERS)
def test_one_pass_has_the_numbers_of_two(name: str) -> None:
    torch.manual_seed(0)
    kind, options = ENCODERS[name]
    encoder: Any = kind(**SMALL, **options)
    passes: list[int] = []
    encoder.transformer.register_forward_hook(lambda *_: passes.append(1))
    (alone, first), (together, second) = values(encoder, False), values(encoder, True)
    assert len(passes) == 3  # two, then one
    torch.testing.assert_close(together, alone, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(second, first, rtol=1e-4, atol=1e-3)


def test_the_photo_stream_is_told_apart_too() -> None:
    torch.manual_seed(0)
    encoder = TactileViT(**SMALL, photo_stream=True).eval()
    alone, together = values(encoder, False)[0], values(encoder, True)[0]
    torch.testing.assert_close(together, alone, rtol=1e-4, atol=1e-5)


def test_sequences_side_by_side_do_not_see_each_other() -> None:
    torch.manual_seed(0)
    stack = Transformer(8, 2, 2)
    x, other = torch.randn(3, 5, 8), torch.randn(3, 4, 8)
    for second in (other, 100 * other):
        got = stack(torch.cat([x, second], dim=1), lengths=(5, 4))
        torch.testing.assert_close(got[:, :5], stack(x), rtol=1e-4, atol=1e-5)


def test_a_mask_hides_keys_in_every_block() -> None:
    torch.manual_seed(0)
    stack = Transformer(8, 3, 2)
    x = torch.randn(2, 6, 8)
    seen = torch.tensor([[True] * 4 + [False] * 2] * 2)[:, None, None]
    torch.testing.assert_close(stack(x, seen)[:, :4], stack(x[:, :4]), rtol=1e-4, atol=1e-5)
