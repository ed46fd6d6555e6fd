"""The decoder of masked tubes: places of its tokens, and learning from neighbours."""

import pytest
import torch

from tactileforge.contracts import Batch
from tactileforge.encoders.relative import Relative
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.heads.decoder import MaskedDecoder


@pytest.mark.parametrize("relative", ["none", "neighbours"])
def test_tokens_lie_at_their_places(batch: Batch, relative: Relative) -> None:
    """Input of the transformer, token by token, and the outputs used as predictions."""
    torch.manual_seed(0)
    encoder = TactileViT("tiny", frames=4, image_size=64, depth=1)
    decoder = MaskedDecoder(encoder, 32, 1, 4, relative=relative)
    features = encoder.views(batch).masked
    seen: list[torch.Tensor] = []
    decoder.transformer.register_forward_hook(lambda _, args, out: seen.extend([args[0], out]))
    made = decoder(features)
    read, given = seen
    visible = decoder.embed(features.tokens)
    place = decoder.position.flatten(1, 2)
    for row in range(len(read)):
        for slot in range(2):
            for k, spot in enumerate(features.kept[row].tolist()):
                expected = visible[row, 6 + 4 * slot + k] + place[slot, spot]
                token = 4 * slot + k if relative == "none" else 16 * slot + spot
                torch.testing.assert_close(read[row, 6 + token], expected)
            for m, spot in enumerate(features.masked[row].tolist()):
                last = 12 * slot + m
                token = 2 * 4 + last if relative == "none" else 16 * slot + spot
                expected = decoder.mask_token + place[slot, spot]
                torch.testing.assert_close(read[row, 6 + token], expected)
                hidden = given[row, last if relative == "none" else 6 + token]
                expected = decoder.predict(decoder.norm(hidden))
                torch.testing.assert_close(made[row, slot, m], expected)


def test_the_order_of_tokens_does_not_count(batch: Batch) -> None:
    """A bias by offset of 0 changes nothing but the order: the same predictions and gradients."""
    torch.manual_seed(0)
    encoder = TactileViT("tiny", frames=4, image_size=64, depth=1)
    plain, biased = (MaskedDecoder(encoder, 32, 2, 4, relative=r) for r in ("none", "zero"))
    biased.load_state_dict(plain.state_dict(), strict=False)
    features = encoder.views(batch).masked
    made, expected = plain(features), biased(features)
    torch.testing.assert_close(made, expected)
    for out in (made, expected):
        out.square().mean().backward(retain_graph=True)
    right = dict(biased.named_parameters())
    for name, parameter in plain.named_parameters():
        torch.testing.assert_close(parameter.grad, right[name].grad, msg=name)
