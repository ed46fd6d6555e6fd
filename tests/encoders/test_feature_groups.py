"""Groups of features, each against an independent computation."""

import numpy as np
import pytest
import torch

from tactileforge.encoders.feature_groups import (
    check_groups,
    encode_groups,
    group_sizes,
    low_pass_difference,
    picture_statistics,
)
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.summary import encode_summary
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError


@pytest.fixture(scope="module")
def encoder() -> TactileViT:
    torch.manual_seed(0)
    return TactileViT("tiny", depth=2, image_size=64, photo_stream=True).eval()


def inputs(frames: int = 4) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rng = torch.Generator().manual_seed(1)
    clips = torch.randint(0, 256, (3, frames, 3, 48, 64), generator=rng).to(torch.uint8)
    still = torch.randint(0, 256, (3, 3, 48, 64), generator=rng).to(torch.uint8)
    return clips, still, torch.ones(3, dtype=torch.int64)


def test_each_has_the_size_that_is_told_in_that_order(encoder: TactileViT) -> None:
    with torch.no_grad():
        groups = encode_groups(encoder, *inputs(), check_groups(encoder, None))
    assert list(groups) == ["summary", "photographs", "difference", "statistics"]
    assert {name: values.shape[1] for name, values in groups.items()} == group_sizes(encoder)
    assert all(values.dtype == torch.float32 for values in groups.values())
    plain = PlainViT("tiny", depth=1, image_size=32)
    assert list(group_sizes(plain)) == ["summary", "difference", "statistics"]


def test_the_difference_is_cell_means_in_grey_levels() -> None:
    clips, still, _ = inputs()
    found = low_pass_difference(clips, still).view(3, 2, 3, 8, 8).numpy()
    last = clips[:, -1].double().numpy()
    for half, other in enumerate((still, clips[:, 0])):
        change = last - other.double().numpy()
        cells = change.reshape(3, 3, 8, 6, 8, 8).mean((3, 5))
        np.testing.assert_allclose(found[:, half], cells, atol=1e-4)


def test_twice_the_change_is_twice_the_difference() -> None:
    still = torch.full((1, 3, 48, 64), 100, dtype=torch.uint8)
    weak, strong = (torch.full((1, 4, 3, 48, 64), 100 + n, dtype=torch.uint8) for n in (30, 60))
    once, twice = (low_pass_difference(clip, still) for clip in (weak, strong))
    assert once[0, :192].tolist() == [30.0] * 192
    assert torch.equal(twice, 2 * once)


def test_statistics_are_of_the_last_frame_less_the_background() -> None:
    clips, still, _ = inputs()
    clips[:, -1] = still
    clips[1, -1] = (still[1].float() + 10).clamp(max=255).to(torch.uint8)
    change = clips[1, -1].float() - still[1].float()
    found = picture_statistics(clips, still)
    moved = (found[1, :3] - found[0, :3]) * 0.2686  # deviation of the first channel's normalisation
    assert moved[0].item() == pytest.approx(change[0].mean().item() / 255, rel=0.02)
    clips[:, 0] = 0  # earlier frames do not count
    assert torch.equal(picture_statistics(clips, still), found)


def test_the_summary_is_that_of_the_encoder(encoder: TactileViT) -> None:
    given = inputs()
    with torch.no_grad():
        found = encode_groups(encoder, *given, ["summary"])
        assert list(found) == ["summary"]
        assert torch.equal(found["summary"], encode_summary(encoder, *given)[2])


def test_photographs_are_maps_of_their_network_alone_or_beside(encoder: TactileViT) -> None:
    given = inputs()
    with torch.no_grad():
        beside = encode_groups(encoder, *given, ["summary", "photographs"])["photographs"]
        patches = encoder.patchify(encoder.preprocess(*given))
        stream = encoder.photo_stream
        assert stream is not None
        maps = (stream.maps(patches, None) / stream.deviation).numpy()
        cells = maps.reshape(3, 2, 2, 2, 2, 2, 472).mean((1, 3, 5)).reshape(3, -1)
        wanted = np.concatenate([cells, maps.reshape(3, -1, 472).std(1)], 1)
        np.testing.assert_allclose(beside.numpy(), wanted, atol=2e-5)
        encoder.transformer.register_forward_pre_hook(lambda *_: pytest.fail("it ran"))
        alone = encode_groups(encoder, *given, ["photographs"])["photographs"]
        encoder.transformer._forward_pre_hooks.clear()
    torch.testing.assert_close(alone, beside)
    assert not stream.project._forward_pre_hooks


def test_without_networks_none_is_run() -> None:
    class Unused(torch.nn.Module):
        grid, width = (1, 2, 2), 5

    groups = encode_groups(Unused(), *inputs(), ["statistics", "difference"])
    assert list(groups) == ["difference", "statistics"]


def test_names_are_checked(encoder: TactileViT) -> None:
    assert check_groups(encoder, ["statistics", "summary"]) == ("summary", "statistics")
    with pytest.raises(ConfigError, match=r"photograph.*did you mean 'photographs'"):
        check_groups(encoder, ["photograph"])
    with pytest.raises(ConfigError, match="photographs"):
        check_groups(PlainViT("tiny", depth=1, image_size=32), ["photographs"])
    for wrong in ("summary", []):
        with pytest.raises(ConfigError, match="give a list of names"):
            check_groups(encoder, wrong)
