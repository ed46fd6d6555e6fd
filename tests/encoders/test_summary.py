"""The summary of a clip, against numpy on the states of each block."""

import math

import numpy as np
import pytest
import torch
from torch import nn

from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.summary import encode_summary, summary_width
from tactileforge.encoders.tactile_vit import TactileViT


def inputs(encoder: TactileViT | PlainViT) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rng = torch.Generator().manual_seed(1)
    frames = torch.randint(0, 256, (3, encoder.frames, 3, 40, 48), generator=rng)
    frames = frames.to(torch.uint8)
    return frames, frames[:, 0], encoder.sensor_ids(["digit"] * 3)


def states(encoder: nn.Module, *given: torch.Tensor) -> list[np.ndarray]:
    """Output of each block, by rerunning the blocks one by one."""
    seen: list[torch.Tensor] = []
    blocks = encoder.transformer.blocks  # type: ignore[union-attr]
    hook = blocks[0].register_forward_pre_hook(lambda _m, x: seen.append(x[0]))  # type: ignore
    with torch.no_grad():
        encoder(*given)
        hook.remove()
        for block in blocks:  # type: ignore[union-attr]
            seen.append(block(seen[-1]))
    return [state.double().numpy() for state in seen[1:]]


@pytest.mark.parametrize(("depth", "chosen"), [(2, [0, 1]), (4, [0, 1, 2, 3]), (6, [0, 2, 3, 5])])
def test_it_has_means_of_quarters_and_deviations_of_blocks(depth: int, chosen: list[int]) -> None:
    encoder = TactileViT("tiny", depth=depth, image_size=64, patch=16).eval()
    given = inputs(encoder)
    with torch.no_grad():
        tokens, projected, summary = encode_summary(encoder, *given)
    wanted = []
    for state in (states(encoder, *given)[number] for number in chosen):
        patches = state[:, encoder.prefix :].reshape(3, 2, 4, 4, encoder.width)
        quarters = patches.reshape(3, 2, 2, 2, 2, 2, encoder.width).mean((1, 3, 5))
        spread = patches.reshape(3, -1, encoder.width).std(1)
        wanted.append(np.concatenate([quarters.reshape(3, -1), spread], 1))
    np.testing.assert_allclose(summary.numpy(), np.concatenate(wanted, 1), atol=2e-5)
    assert summary.shape[1] == summary_width(encoder) == len(chosen) * 5 * encoder.width
    with torch.no_grad():
        plain = encoder(*given)
    assert torch.equal(tokens, plain[0])
    assert torch.equal(projected, plain[1])


def test_a_second_stream_is_summarised_like_a_block() -> None:
    encoder = TactileViT("tiny", depth=1, image_size=64, photo_stream=True).eval()
    with torch.no_grad():
        tokens, _, summary = encode_summary(encoder, *inputs(encoder))
    assert summary.shape == (3, summary_width(encoder)) == (3, 2 * 5 * 192)
    patches = tokens[:, encoder.prefix :, 192:].numpy()  # its tokens are the second half
    cells = patches.reshape(3, 2, 2, 2, 2, 2, 192).mean((1, 3, 5)).reshape(3, -1)
    wanted = np.concatenate([cells, patches.std(1)], 1)
    np.testing.assert_allclose(summary[:, 5 * 192 :].numpy(), wanted, atol=2e-5)


def test_no_hook_is_left() -> None:
    encoder = TactileViT("tiny", depth=2, image_size=32)
    frames, background, rows = inputs(encoder)
    with pytest.raises(IndexError):
        encode_summary(encoder, frames, background, rows + 1000)
    assert not any(block._forward_hooks for block in encoder.transformer.blocks)


def test_an_encoder_without_a_class_token_and_one_without_blocks() -> None:
    encoder = PlainViT("tiny", depth=2, image_size=32, patch=16).eval()
    given = inputs(encoder)
    assert encode_summary(encoder, *given)[2].shape == (3, summary_width(encoder))

    class Bare(nn.Module):
        grid, width = (1, 2, 2), 5

        def forward(self, *_: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            return torch.arange(20.0).view(1, 4, 5), torch.zeros(1, 7)

    summary = encode_summary(Bare(), *given)[2]
    assert summary.shape == (1, summary_width(Bare())) == (1, 25)
    assert summary[0, :20].tolist() == list(range(20))
    assert summary[0, 20].item() == pytest.approx(math.sqrt(31.25))
