"""The encoder, against timm's own forward with the same weights on the same input."""

import copy

import pytest
import timm
import torch
from tactileforge_timm.encoder import TimmEncoder
from timm.data import resolve_model_data_config

from tactileforge.errors import ConfigError
from tactileforge.testing import check

#: Model, size of its input here, tokens before its places, and whether it is a transformer of one
#: width.
MODELS = {
    "vit_tiny_patch16_224": (64, 1, True),
    "vit_small_patch14_reg4_dinov2": (42, 5, True),
    "vit_small_patch16_dinov3": (48, 5, True),
    "deit_tiny_distilled_patch16_224": (48, 2, True),
    "test_vit": (160, 1, True),
    "resnet18": (64, 0, False),
    "efficientnet_b0": (64, 0, False),
    "convnext_atto": (96, 0, False),
    "mobilenetv3_small_050": (64, 0, False),
}
DIGIT = torch.zeros(1, dtype=torch.int64)


def clip(encoder, count=None):
    """One clip of noise, at the encoder's size."""
    shape = (1, count or encoder.frames, 3, *encoder.image_size)
    frames = torch.randint(0, 256, shape, dtype=torch.uint8)
    return frames, frames[:, 0]


def settle(network):
    """Random norms and positions: those of new networks hide a mistake."""
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.normal_(std=0.1)
            module.running_var.uniform_(0.8, 1.2)
            torch.nn.init.uniform_(module.weight, 0.8, 1.2)
    for name, parameter in network.named_parameters():
        if name.endswith(("pos_embed", "cls_token", "reg_token")):
            torch.nn.init.normal_(parameter, std=0.5)


def theirs(encoder, model, **options):
    """The network as timm makes it, with the weights of ours."""
    network = timm.create_model(model, num_classes=0, **options).eval()
    network.load_state_dict(encoder.network.state_dict())
    return network


def their_input(network, frames):
    facts = resolve_model_data_config(network)
    mean, std = (torch.tensor(facts[key]).view(3, 1, 1) for key in ("mean", "std"))
    return (frames.float() / 255 - mean) / std


def as_tokens(found):
    return found if found.ndim == 3 else found.flatten(2).mT


@pytest.mark.parametrize("model", MODELS)
@torch.no_grad()
def test_tokens_and_vector_of_a_frame_are_those_of_timm(model):
    size, prefix, tokens = MODELS[model]
    encoder = TimmEncoder(model, frames=1, image_size=size).eval()
    settle(encoder.network)
    network = theirs(encoder, model, **({"img_size": size} if tokens else {}))
    frames, still = clip(encoder)
    got, vector = encoder(frames, still, DIGIT)
    x = their_input(network, frames[0])
    torch.testing.assert_close(got, as_tokens(network.forward_features(x)), rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(vector, network(x), rtol=1e-5, atol=1e-5)
    assert (encoder.prefix, encoder.takes_tokens) == (prefix, tokens)
    assert encoder.project(got)[:, encoder.prefix :].shape[-1] == encoder.projected


@torch.no_grad()
def test_dinov2_at_another_size_is_that_of_dynamic_size(tmp_path):
    model = "vit_small_patch14_dinov2"
    network = timm.create_model(model, num_classes=0, dynamic_img_size=True).eval()
    settle(network)
    torch.save(network.state_dict(), tmp_path / "weights.pth")
    encoder = TimmEncoder(
        model, path=str(tmp_path / "weights.pth"), frames=1, image_size=(56, 42)
    ).eval()
    assert encoder.grid == (1, 4, 3)
    frames, still = clip(encoder)
    x = their_input(network, frames[0])
    got, vector = encoder(frames, still, DIGIT)
    torch.testing.assert_close(got, network.forward_features(x), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(vector, network(x), rtol=1e-4, atol=1e-4)


def test_size_and_normalization_are_its_own():
    for model, side in (("vit_small_patch14_dinov2", 518), ("test_vit", 160), ("resnet18", 224)):
        with torch.device("meta"):
            encoder = TimmEncoder(model)
        assert encoder.image_size == (side, side)
    encoder = TimmEncoder("test_vit")
    facts = resolve_model_data_config(encoder.network)
    assert encoder.pixels.mean.flatten().tolist() == pytest.approx(list(facts["mean"]))
    assert encoder.pixels.std.flatten().tolist() == pytest.approx(list(facts["std"]))
    assert (encoder.pixels.filter, encoder.pixels.offset) == (facts["interpolation"], None)
    other = TimmEncoder("test_vit", preprocess={"offset": 130, "mean": None})
    assert other.pixels.offset == 130
    assert torch.equal(other.pixels.mean, encoder.pixels.mean)


@pytest.mark.parametrize("model", ["vit_tiny_patch16_224", "resnet18"])
@torch.no_grad()
def test_frames_are_joined_over_time(model):
    size = MODELS[model][0]
    made = {
        join: TimmEncoder(model, frames=3, image_size=size, join=join).eval()
        for join in ("tokens", "mean", "concat")
    }
    single = TimmEncoder(model, frames=1, image_size=size).eval()
    for encoder in made.values():
        encoder.network.load_state_dict(single.network.state_dict())
    frames, still = clip(made["mean"])
    each = [single(frames[:, t : t + 1], still, DIGIT) for t in range(3)]
    prefix, tokens = single.prefix, torch.cat([x for x, _ in each])
    vectors = torch.cat([x for _, x in each])
    close = torch.testing.assert_close

    got, vector = made["tokens"](frames, still, DIGIT)
    close(got[0, prefix:], tokens[:, prefix:].flatten(0, 1))
    close(got[0, :prefix], tokens[:, :prefix].mean(0))
    close(vector[0], vectors.mean(0))  # pooling is linear in these two
    assert made["tokens"].grid == (3, *single.grid[1:])

    got, vector = made["mean"](frames, still, DIGIT)
    close(got[0], tokens.mean(0))
    close(vector[0], vectors.mean(0))

    got, vector = made["concat"](frames, still, DIGIT)
    close(got[0], torch.cat(list(tokens), 1))
    close(vector[0], vectors.flatten())
    assert (made["concat"].width, made["concat"].projected) == (3 * single.width,) * 2


@pytest.mark.parametrize(
    ("model", "side"),
    [("hiera_tiny_224", 224), ("selecsls42", 256), ("swin_s3_tiny_224", 224)],
)
@torch.no_grad()
def test_layouts_that_timm_does_not_declare_are_recognized(model, side):
    encoder = TimmEncoder(model, frames=1).eval()
    assert encoder.image_size == (side, side)
    frames, still = clip(encoder)
    got, vector = encoder(frames, still, DIGIT)
    x = their_input(encoder.network, frames[0])
    found = encoder.network.forward_features(x)
    want = found.flatten(1, 2) if "swin" in model else as_tokens(found)
    torch.testing.assert_close(got, want, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(vector, encoder.network(x), rtol=1e-4, atol=1e-5)


def test_features_that_are_no_map_are_refused():
    encoder = TimmEncoder("coat_tiny", frames=1).eval()
    with pytest.raises(ConfigError, match="model=coat_tiny: its features have the shape list"):
        encoder(*clip(encoder), DIGIT)


def test_a_last_layer_gives_vectors_and_tokens_one_width():
    for model, join in (("test_vit", "concat"), ("mobilenetv3_small_050", "tokens")):
        encoder = TimmEncoder(model, frames=2, image_size=64, join=join, projected=7).eval()
        tokens, vector = encoder(*clip(encoder), DIGIT)
        assert vector.shape == (1, 7)
        assert encoder.project(tokens).shape == (*tokens.shape[:2], 7)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"model": "resnet18", "sensor_tokens": 2}, "resnet18 takes no tokens; give 0"),
        ({"model": "test_vit", "join": "sum"}, r"encoder\.join 'sum'.*Known: concat, mean, tokens"),
        ({"model": "vit_tiny_patch16_224", "image_size": 50}, "do not divide|cannot build it"),
        ({"model": "resnet18", "image_size": 50}, "do not divide"),
        ({"model": "mobilenetv3_small_050", "join": "concat"}, "join=tokens or join=mean"),
        ({"model": "test_vit", "image_size": [1, 2, 3]}, "give height and width"),
        ({"model": "test_vit", "frames": 0}, r"encoder\.frames=0"),
        ({"model": "test_vit", "sensor_tokens": 1, "sensors": {"x": 19}}, "raise sensor_rows"),
        ({"model": "test_vit", "lora": 2, "lora_layers": ["nope"]}, "no such layer; known: .*qkv"),
        ({"model": "test_vit", "preprocess": {"scale": 2}}, "scale"),
    ],
)
def test_what_does_not_fit_is_an_error_of_a_line(options, said):
    with pytest.raises(ConfigError, match=said) as error:
        TimmEncoder(**options)
    assert "\n" not in str(error.value)


def test_norms_keep_their_statistics_where_they_are_fixed():
    for fixed in (True, False):
        encoder = TimmEncoder("resnet18", frames=1, image_size=64, fixed_norms=fixed).train()
        before = encoder.network.bn1.running_mean.clone()
        encoder(*clip(encoder), DIGIT)
        assert torch.equal(before, encoder.network.bn1.running_mean) is fixed
        assert encoder.network.training


@pytest.mark.parametrize("model", ["test_vit", "resnet18"])
@torch.no_grad()
def test_lora_starts_without_effect_and_trains_alone(model):
    pytest.importorskip("peft")
    plain = TimmEncoder(model, frames=1, image_size=64).eval()
    encoder = TimmEncoder(model, frames=1, image_size=64, lora=4).eval()
    state = plain.network.state_dict()
    own = encoder.network.state_dict()
    encoder.network.load_state_dict(
        {k: state.get(k.replace(".base_layer", ""), x) for k, x in own.items()}
    )
    frames, still = clip(encoder)
    torch.testing.assert_close(encoder(frames, still, DIGIT), plain(frames, still, DIGIT))
    trained = {name for name, x in encoder.network.named_parameters() if x.requires_grad}
    assert trained
    assert all("lora_" in name for name in trained)
    for name, x in encoder.network.named_parameters():
        if "lora_B" in name:
            x.normal_()
    assert not torch.allclose(encoder(frames, still, DIGIT)[1], plain(frames, still, DIGIT)[1])


def test_lora_of_some_layers():
    pytest.importorskip("peft")
    encoder = TimmEncoder("test_vit", lora=2, lora_layers=["attn.qkv"])
    names = {n.split(".lora_")[0] for n, _ in encoder.named_parameters() if ".lora_" in n}
    count = len(encoder.network.blocks)
    assert names == {f"network.blocks.{i}.attn.qkv" for i in range(count)}


@torch.no_grad()
def test_another_size_and_number_of_frames_take_the_same_weights():
    before = TimmEncoder("test_vit", frames=2, image_size=64).eval()
    settle(before.network)
    after = TimmEncoder("test_vit", frames=3, image_size=(96, 64)).eval()
    after.load_state_dict(before.state_for(after))
    network = theirs(before, "test_vit", img_size=64)
    network.set_input_size(img_size=(96, 64))
    torch.testing.assert_close(after.network.pos_embed, network.pos_embed)
    assert before.network.pos_embed.shape != after.network.pos_embed.shape
    joined = TimmEncoder("test_vit", frames=3, image_size=64, join="concat", projected=8)
    two = TimmEncoder("test_vit", frames=2, image_size=64, join="concat", projected=8)
    with pytest.raises(ConfigError, match="leave frames and image_size out"):
        two.state_for(joined)


@torch.no_grad()
def test_a_copy_is_independent():
    """As EMA copies are: every weight of the copy is its own."""
    encoder = TimmEncoder("mobilenetv3_small_050", frames=1, image_size=64).eval()
    other = copy.deepcopy(encoder)
    frames, still = clip(encoder)
    before = encoder.project(encoder(frames, still, DIGIT)[0])
    for x in other.parameters():
        x.zero_()
    torch.testing.assert_close(encoder.project(encoder(frames, still, DIGIT)[0]), before)
    assert not other.project(other(frames, still, DIGIT)[0]).any()


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"model": "test_vit", "image_size": 32, "sensor_tokens": 2},
        {"model": "test_resnet", "image_size": 64, "join": "mean"},
    ],
    ids=lambda options: options["model"],
)
def test_conformance(options):
    failed = [one for one in check("encoder", "timm", **options) if one.status == "failed"]
    assert not failed


@pytest.mark.slow
def test_conformance_of_the_tower():
    options = {"model": "test_vit", "image_size": 32, "frozen": False}
    failed = [one for one in check("encoder", "timm_image", **options) if one.status == "failed"]
    assert not failed
