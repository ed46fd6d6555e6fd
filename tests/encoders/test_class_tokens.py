"""The class token alone, without the rest of the last block."""

from typing import Any

import pytest
import torch

from tactileforge.encoders.backbone import Backbone
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.encoders.transformer import Transformer

TACTILE = {"size": "tiny", "frames": 4, "image_size": 32}
PLAIN = {"size": "tiny", "frames": 4, "image_size": 32, "class_token": True}
ENCODERS: dict[str, tuple[type[Backbone], dict[str, Any]]] = {
    "AnyTouch 2": (TactileViT, TACTILE),
    "ImageBind": (TactileViT, TACTILE | {"bias_kv": True, "norm_in": False, "sensor_tokens": 0}),
    "two streams": (TactileViT, TACTILE | {"depth": 1, "photo_stream": True}),
    "no blocks": (TactileViT, TACTILE | {"depth": 0}),
    "class": (PlainViT, PLAIN | {"pool": "class", "registers": 2}),
    "class, pooled": (PlainViT, PLAIN | {"pool": "class", "norm": "pooled", "projected": 8}),
    "stems": (
        PlainViT,
        PLAIN
        | {"pool": "class", "stems": 2, "stem_depth": 2, "sensors": {"digit": 0, "gelsight": 1}},
    ),
    "only stems": (
        PlainViT,
        PLAIN
        | {"pool": "class", "stems": 2, "stem_depth": 6, "sensors": {"digit": 0, "gelsight": 1}},
    ),
    "mean": (PlainViT, PLAIN),
    "mean, no class token": (PlainViT, PLAIN | {"class_token": False}),
}


@pytest.mark.parametrize("kind", ENCODERS)
def test_it_is_that_of_the_whole_view(kind: str) -> None:
    plugin, options = ENCODERS[kind]
    encoder = plugin(**options).eval()
    for parameter in encoder.parameters():  # no scale, bias or position stays at 0 or 1
        torch.nn.init.normal_(parameter, std=0.1)
    frames = torch.randint(0, 256, (3, 4, 3, 40, 50), dtype=torch.uint8)
    inputs = frames, frames[:, 0], encoder.sensor_ids(["digit", "gelsight", "digit"])
    with torch.no_grad():
        tokens, projected = encoder(*inputs)
        first, alone = encoder.class_tokens(*inputs)
    torch.testing.assert_close(first, tokens[:, 0], atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(alone, projected, atol=1e-5, rtol=1e-4)


def test_the_last_block_is_spared_the_other_tokens() -> None:
    transformer = Transformer(width=8, depth=3, heads=2)
    lengths = []
    for block in transformer.blocks:
        block.mlp.register_forward_hook(lambda _, inputs, out: lengths.append(out.shape[1]))
    assert transformer(torch.randn(2, 5, 8), only=slice(3, 4)).shape == (2, 1, 8)
    assert lengths == [5, 5, 1]
