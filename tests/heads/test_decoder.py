"""The decoder of masked tubes: where its tokens lie, and that it learns from neighbours."""

import pytest
import torch

from tactileforge.contracts import Batch
from tactileforge.encoders.relative import Relative
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.heads.decoder import MaskedDecoder


@pytest.mark.parametrize("relative", ["none", "neighbours"])
def test_tokens_lie_at_their_places(batch: Batch, relative: Relative) -> None:
    """Input of the transformer, token by token, and the outputs that are predictions."""
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
                torch.testing.assert_close(read[row, 6 + 16 * slot + spot], expected)
            for m, spot in enumerate(features.masked[row].tolist()):
                token = 6 + 16 * slot + spot
                torch.testing.assert_close(read[row, token], decoder.mask_token + place[slot, spot])
                expected = decoder.predict(decoder.norm(given[row, token]))
                torch.testing.assert_close(made[row, slot, m], expected)
