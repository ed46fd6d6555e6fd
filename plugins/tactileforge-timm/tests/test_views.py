"""Masked views and sensor tokens."""

import pytest
import timm
import torch
from tactileforge_timm.encoder import TimmEncoder
from tactileforge_timm.token_choice import choose_tokens
from timm.models import Eva

from tactileforge.errors import ConfigError

TRANSFORMERS = (
    "vit_tiny_patch16_224",
    "vit_small_patch16_dinov3",
    "deit_tiny_distilled_patch16_224",
)
OTHERS = ("resnet18", "swin_tiny_patch4_window7_224", "beit_base_patch16_224")


def made(model, **options):
    side = {"swin_tiny_patch4_window7_224": 224, "beit_base_patch16_224": 64}.get(model, 64)
    return TimmEncoder(model, frames=2, image_size=side, **options).eval()


def batch(encoder):
    frames = torch.randint(0, 256, (2, 2, 3, *encoder.image_size), dtype=torch.uint8)
    return {"frames": frames, "background": frames[:, 0], "sensor": ["digit", "gelsight"]}


@pytest.mark.parametrize("join", ["tokens", "mean", "concat"])
@pytest.mark.parametrize("model", TRANSFORMERS)
@torch.no_grad()
def test_with_every_patch_kept_the_tokens_are_those_of_the_full_view(model, join):
    encoder = made(model, join=join)
    views = encoder.views(batch(encoder))
    count = encoder.grid[1] * encoder.grid[2]
    kept = torch.arange(count).expand(2, -1)
    got = encoder.encode(views.patches, views.sensor, kept)
    torch.testing.assert_close(got, views.full.tokens, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("join", ["tokens", "mean"])
@pytest.mark.parametrize("model", [*TRANSFORMERS, *OTHERS])
@torch.no_grad()
def test_nothing_of_a_hidden_patch_reaches_the_masked_view(model, join):
    if join == "mean" and model in OTHERS[1:]:
        pytest.skip("as in join=tokens, and slow")
    encoder = made(model, join=join)
    given = batch(encoder)
    torch.manual_seed(1)
    first = encoder.views(given)
    side = encoder.patch
    changed = given["frames"].clone()
    rows = encoder.grid[2]
    for clip, places in enumerate(first.masked.masked):
        for place in places.tolist():
            top, left = place // rows * side, place % rows * side
            changed[clip, :, :, top : top + side, left : left + side] = 0
    torch.manual_seed(1)
    second = encoder.views(given | {"frames": changed})
    assert torch.equal(first.masked.kept, second.masked.kept)
    torch.testing.assert_close(first.masked.tokens, second.masked.tokens)
    torch.testing.assert_close(first.masked.cls, second.masked.cls)
    assert not torch.allclose(first.full.cls, second.full.cls)
    slots, keep = encoder.grid[0], first.masked.kept.shape[1]
    assert first.masked.tokens.shape == (2, encoder.prefix + slots * keep, encoder.projected)


@torch.no_grad()
def test_hidden_patches_of_a_transformer_are_not_embedded():
    """As timm's blocks on the visible patches alone, with their positions."""
    encoder = made("vit_tiny_patch16_224")
    torch.nn.init.normal_(encoder.network.pos_embed)
    views = encoder.views(batch(encoder))
    masked = views.masked
    net = encoder.network
    frames = encoder.preprocess(views.batch["frames"], views.batch["background"])
    for clip in range(2):
        for slot in range(2):
            x = net.patch_embed(frames[clip, slot][None]) + net.pos_embed[:, 1:]
            x = x[:, masked.kept[clip]]
            x = torch.cat([net.cls_token + net.pos_embed[:, :1], x], 1)
            want = net.norm(net.blocks(x))[0, 1:]
            keep = masked.kept.shape[1]
            got = masked.tokens[clip, 1 + slot * keep : 1 + (slot + 1) * keep]
            torch.testing.assert_close(got, want, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("model", ["vit_small_patch14_reg4_dinov2", "vit_small_patch16_dinov3"])
@torch.no_grad()
def test_added_tokens_stand_where_register_tokens_stand(model):
    """A network with registers is one without, given their values as tokens of a sensor."""
    whole = timm.create_model(model, num_classes=0, img_size=112).eval()
    count = whole.reg_token.shape[1]
    name = "num_reg_tokens" if isinstance(whole, Eva) else "reg_tokens"
    without = timm.create_model(model, num_classes=0, img_size=112, **{name: 0}).eval()
    torch.nn.init.normal_(whole.reg_token)
    state = {key: x for key, x in whole.state_dict().items() if key != "reg_token"}
    without.load_state_dict(state)
    choice = choose_tokens(without, 1, count)
    x = torch.randn(2, 3, 112, 112)
    with choice.choosing(None, whole.reg_token.expand(2, -1, -1)):
        got = without.forward_features(x)
    torch.testing.assert_close(got, whole.forward_features(x), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("model", TRANSFORMERS[:2])
@torch.no_grad()
def test_tokens_of_the_sensor_tell_sensors_apart(model):
    encoder = made(model, sensor_tokens=3)
    torch.nn.init.normal_(encoder.sensor_table)
    given = batch(encoder)
    rows = encoder.sensor_ids(["digit", "gelsight"])
    tokens, vector = encoder(given["frames"], given["background"], rows)
    slots, down, right = encoder.grid
    assert encoder.prefix == encoder.layout.prefix + 3
    assert tokens.shape[1] == encoder.prefix + slots * down * right
    other = encoder(given["frames"], given["background"], rows.flip(0))
    assert not torch.allclose(vector, other[1])
    # the vector is that of the network: without the sensor's own tokens
    tokens[:, encoder.layout.prefix : encoder.prefix] = 1e6
    torch.testing.assert_close(encoder.pool_tokens(tokens), vector)
    assert encoder.views(given).masked.tokens.shape[1] > encoder.prefix


def test_a_sensor_without_a_row_is_an_error_or_universal():
    encoder = TimmEncoder("test_vit", sensor_tokens=1, sensors={"digit": 0})
    with pytest.raises(ConfigError, match=r"'mine'.*Known: digit"):
        encoder.sensor_ids(["mine"])
    encoder.unknown_sensor = "universal"
    assert encoder.sensor_ids(["mine", "digit"]).tolist() == [19, 0]
    assert TimmEncoder("test_vit").sensor_ids(["mine"]).tolist() == [0]


@torch.no_grad()
def test_some_clips_take_the_universal_tokens():
    encoder = TimmEncoder("test_vit", sensor_tokens=1, image_size=32)
    assert encoder.views(batch(encoder), universal=1.0).sensor.tolist() == [19, 19]
    assert encoder.views(batch(encoder), universal=0.0).sensor.tolist() == [1, 0]
