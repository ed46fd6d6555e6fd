"""Every published layout goes from a file to an encoder and back, or is refused for a reason."""

import math
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file
from tactileforge_published import Converted, convert, read_tensors, recognise
from torch import Tensor
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.encoders.backbone import Backbone
from tactileforge.errors import ConfigError
from tactileforge.testing import batch

State = dict[str, Tensor]
DECODER = {
    "decoder_embed.weight": (512, 512),
    "decoder_pos_embed": (1, 197, 512),
    "mask_token": (1, 1, 512),
    "touch_decoder_blocks.0.layer_norm1.weight": (512,),
}


def anytouch2(p: ModuleType, frames: int) -> dict[str, tuple[int, ...]]:
    """A whole file: the touch encoder with its decoders, and CLIP's text tower."""
    touch = p.anytouch2(frames, 192, 2) | DECODER
    return p.under("touch_mae_model.", touch) | p.clip_text()


def anytouch1(p: ModuleType) -> dict[str, tuple[int, ...]]:
    touch = p.anytouch1(192, 2) | DECODER
    touch["video_patch_embedding.weight"] = (192, 3, 3, 14, 14)
    touch["video_position_embedding.weight"] = (257, 192)
    touch["touch_model.embeddings.patch_embedding.weight"] = (192, 3, 14, 14)
    vision = p.hf_tower("vision_model", 64, 1, (3, 14, 14), 257)
    rest = p.clip_text() | {"visual_projection.weight": (768, 64), "cross_sensor_head.bias": (1,)}
    return p.under("touch_mae_model.", touch) | vision | rest


def clip(p: ModuleType) -> dict[str, tuple[int, ...]]:
    tower = p.hf_tower("vision_model", 192, 2, (3, 16, 16), 17)
    return tower | p.clip_text() | {"visual_projection.weight": (512, 192)}


def sparsh(p: ModuleType, prefix: str, *rest: str, **options: Any) -> dict[str, tuple[int, ...]]:
    encoder = p.sparsh(width=192, depth=2, **options)
    return p.under(prefix, encoder) | dict.fromkeys(rest, (3, 4))


VIDEO = (3, 2, 16, 16)
TEACHER = "teacher_encoder.backbone."
# name, frames, length of tokens without the class and sensor tokens, and the file's table
FILES: dict[str, tuple[str, int, int, Callable[[ModuleType], dict[str, tuple[int, ...]]]]] = {
    "anytouch2, 4 frames": ("anytouch2", 4, 392, lambda p: anytouch2(p, 4)),
    "anytouch2, 2 frames": ("anytouch2", 2, 196, lambda p: anytouch2(p, 2)),
    "anytouch2, filtered": ("anytouch2", 4, 392, lambda p: p.anytouch2(4, 192, 2)),
    "anytouch1": ("anytouch1", 3, 256, anytouch1),
    "anytouch1, probe": ("anytouch1", 3, 256, lambda p: p.anytouch1(192, 2)),
    "mae": ("sparsh_mae", 2, 300, lambda p: sparsh(p, "encoder.", "decoder.norm.weight")),
    "dino": (
        "sparsh_dino",
        2,
        300,
        lambda p: (
            sparsh(p, TEACHER, "dino_loss.center", registers=1)
            | sparsh(p, "student_encoder.backbone.", registers=1)
        ),
    ),
    "dinov2": (
        "sparsh_dinov2",
        2,
        300,
        lambda p: sparsh(p, TEACHER, "ibot_patch_loss.center", registers=1),
    ),
    "ijepa": (
        "sparsh_ijepa",
        2,
        300,
        lambda p: (
            sparsh(p, "target_encoder.backbone.", "predictor.norm.weight")
            | sparsh(p, "context_encoder.backbone.")
        ),
    ),
    "vjepa, sines": (
        "sparsh_vjepa",
        4,
        600,
        lambda p: sparsh(p, "target_encoder.backbone.", patch=VIDEO),
    ),
    "vjepa, learned": (
        "sparsh_vjepa",
        4,
        600,
        lambda p: (
            sparsh(p, "target_encoder.", patch=VIDEO) | {"target_encoder.pos_embed": (1, 600, 192)}
        ),
    ),
    "sparsh for a task": ("sparsh", 2, 300, lambda p: sparsh(p, "model_encoder.")),
    "t3": ("t3", 1, 196, lambda p: p.t3((1, 1), "digit", "mini")),
    "unitouch": ("unitouch", 1, 16, lambda p: p.unitouch(192, 2)),
    "tvl": ("tvl", 1, 16, lambda p: p.tvl(192, 2)),
    "feelanyforce": ("feelanyforce", 1, 256, lambda p: p.feelanyforce()),
    "sparsh-x": ("sparsh_x", 2, 196, lambda p: p.sparsh_x()),
    "unit": ("unit", 1, 1280, lambda p: p.unit()),
    "univtac": ("univtac", 1, 64, lambda p: p.univtac()),
    "clip": ("clip", 1, 16, clip),
    "openclip": ("clip", 1, 16, lambda p: p.openclip(192, 2)),
}


def state_of(p: ModuleType, case: str) -> State:
    """The tensors of a file; the dict is new, the tensors are shared among tests."""
    return dict(_state_of(p, case))


@cache
def _state_of(p: ModuleType, case: str) -> State:
    state: State = p.fill(FILES[case][3](p))
    if case == "sparsh-x":
        state |= p.sparsh_x_numbers()
    for key in [key for key in state if key.endswith("patch_embed.proj.weight")]:
        prefix = key.removesuffix("patch_embed.proj.weight")
        if f"{prefix}norm.weight" in state and f"{prefix}pos_embed" not in state:
            axes = 3 if state[key].ndim == 5 else 2
            state[f"{prefix}pos_embed.frequency_bands"] = p.bands(192, axes)
    return state


@cache
def converted_of(p: ModuleType, case: str) -> Converted:
    """The file of a case, converted; shared among tests."""
    return convert(state_of(p, case))


def made(encoder: Backbone, size: int = 2) -> Batch:
    return batch(size, frames=encoder.frames, image=48) | {"sensor": ["digit", "gelsight_mini"]}


@pytest.mark.slow
@pytest.mark.parametrize("case", FILES)
def test_from_file_to_encoder_and_back(published: ModuleType, case: str, tmp_path: Path) -> None:
    name, frames, length, _ = FILES[case]
    torch.save({"model": state_of(published, case), "epoch": 3}, tmp_path / "file.pth")
    state = read_tensors(tmp_path / "file.pth")
    assert recognise(state).name == name
    converted = convert(state)
    assert converted.name == name
    listed = [key for names in converted.unused.values() for key in names]
    assert len(listed) == len(set(listed))
    assert set(listed) <= state.keys()

    encoder = converted.build()
    assert encoder.frames == frames
    assert (encoder.spacing > 0) == (frames > 1)
    views = encoder.views(made(encoder))
    with torch.no_grad():
        full, masked = views.full, views.masked
    assert full.tokens.shape == (2, encoder.prefix + length, encoder.width)
    assert full.cls.shape == (2, encoder.projected)
    assert torch.isfinite(full.tokens).all()
    assert torch.isfinite(full.cls).all()
    hidden = masked.masked.shape[1] / (masked.masked.shape[1] + masked.kept.shape[1])
    assert hidden == pytest.approx(0.75)

    save_file(encoder.state_dict(), tmp_path / "ours.safetensors")
    again = convert(state).build()
    for parameter in again.parameters():
        torch.nn.init.zeros_(parameter)
    again.load_state_dict(load_file(tmp_path / "ours.safetensors"), strict=True)
    with torch.no_grad():
        assert torch.equal(again.views(made(again)).full.tokens, full.tokens)


@pytest.mark.parametrize("case", FILES)
def test_each_tensor_of_the_encoder_matters(published: ModuleType, case: str) -> None:
    """No tensor can be left out, have another shape, or be followed by an unknown one."""
    state = state_of(published, case)
    unused = {key for names in converted_of(published, case).unused.values() for key in names}
    used = [key for key in state if key not in unused]
    for key in used:
        with pytest.raises(ConfigError):
            convert({k: v for k, v in state.items() if k != key})
    for key in used[::11]:
        longer = torch.zeros(5, *state[key].shape)
        with pytest.raises(ConfigError):
            convert(state | {key: longer})
    stray = used[0].rpartition(".")[0] + ".stray.weight"
    with pytest.raises(ConfigError, match=r"unexpected: .*stray\.weight"):
        convert(state | {stray: torch.zeros(2)})


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
@pytest.mark.parametrize("case", FILES)
def test_a_copy_in_half_the_bits_is_the_same_model(
    published: ModuleType, case: str, dtype: torch.dtype, back: bool, tmp_path: Path
) -> None:
    """Also one cast back to float32 later."""
    state = state_of(published, case)
    half = {key: x.to(dtype).to(x.dtype if back else dtype) for key, x in state.items()}
    torch.save({"model": half}, tmp_path / "half.pth")
    whole, copied = converted_of(published, case), convert(read_tensors(tmp_path / "half.pth"))
    assert copied.name == whole.name
    ours, theirs = (dict(one.encoder_config) for one in (copied, whole))
    lengths = [one.pop("length", None) or 0.0 for one in (ours, theirs)]
    assert lengths[0] == pytest.approx(lengths[1], rel=2e-2)
    assert ours == theirs
    eps = torch.finfo(dtype).eps
    for key, tensor in whole.state.items():
        assert copied.state[key].dtype == torch.float32
        torch.testing.assert_close(copied.state[key], tensor, rtol=2 * eps, atol=2 * eps)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float16, torch.bfloat16])
def test_other_fixed_positions_are_no_rounding(published: ModuleType, dtype: torch.dtype) -> None:
    state = state_of(published, "mae")
    for other in (10000 ** -(torch.arange(48) / 47), 9000 ** -(torch.arange(48) / 48)):
        state["encoder.pos_embed.frequency_bands"] = other.expand(2, -1).to(dtype)
        with pytest.raises(ConfigError, match="frequency_bands"):
            convert(state)


@pytest.mark.slow
@pytest.mark.parametrize("case", FILES)
def test_tensors_of_odd_shapes_are_named(
    published: ModuleType, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = state_of(published, case)
    convert(state)
    # numbers are finite, and copied: once is enough
    finite = torch.ones((), dtype=torch.bool)
    monkeypatch.setattr(torch, "isfinite", lambda _: finite)
    monkeypatch.setattr(Tensor, "clone", lambda tensor, **_: tensor)
    alike = {re.sub(r"\d+", "0", key): key for key in state}  # of all layers, the last
    for key in alike.values():
        for odd in (torch.zeros(()), torch.zeros(0), torch.zeros(2, 0, 3), state[key][None]):
            try:
                convert(state | {key: odd})
            except ConfigError:
                continue


def test_what_is_missing_is_named(published: ModuleType) -> None:
    state = state_of(published, "anytouch2, 4 frames")
    del state["touch_mae_model.touch_model.encoder.layers.1.mlp.fc1.bias"]
    with pytest.raises(ConfigError, match=r"whole AnyTouch 2 file; missing: .*1\.mlp\.fc1\.bias"):
        convert(state)


def test_a_number_that_is_none_is_refused(published: ModuleType) -> None:
    state = state_of(published, "mae")
    state["encoder.norm.bias"] = torch.full((192,), float("nan"))
    with pytest.raises(ConfigError, match=r"norm\.bias is not finite"):
        convert(state)


@pytest.mark.parametrize("dtype", [torch.int64, torch.complex64])
def test_weights_that_are_no_real_numbers_are_named(
    published: ModuleType, dtype: torch.dtype
) -> None:
    state = published.fill(published.anytouch2(2, width=192, depth=1))
    key = "touch_model.post_layernorm.weight"
    with pytest.raises(ConfigError, match=rf"real numbers, not {key} \({dtype}\)"):
        convert(state | {key: state[key].to(dtype)})


def test_another_model_is_refused_with_the_nearest(published: ModuleType) -> None:
    state = state_of(published, "mae")
    del state["encoder.blocks.0.ls1.gamma"]
    with pytest.raises(ConfigError, match=r"Nearest: Sparsh MAE lacks blocks\.0\.ls1\.gamma"):
        recognise(state)
    with pytest.raises(ConfigError, match=r"it has fc\.bias, fc\.weight"):
        recognise({"fc.weight": torch.zeros(2, 2), "fc.bias": torch.zeros(2)})


def test_fixed_positions_of_another_kind_are_refused(published: ModuleType) -> None:
    state = state_of(published, "mae")
    state["encoder.pos_embed.frequency_bands"] = torch.ones(2, 48)
    with pytest.raises(ConfigError, match="frequency_bands"):
        convert(state)


def test_options_replace_what_is_inferred(published: ModuleType) -> None:
    state = state_of(published, "clip")
    assert convert(state, {"activation": "quick_gelu"}).encoder_config["activation"] == "quick_gelu"
    with pytest.raises(ConfigError, match="did you mean 'activation'"):
        convert(state, {"activatoin": "quick_gelu"})


def test_force_head_comes_with_its_encoder(published: ModuleType) -> None:
    head = {
        f"head.pooler.cross_attention_block.{name}.{kind}": torch.zeros(2)
        for name in ("norm1", "xattn.q", "xattn.kv", "xattn.proj", "norm2", "mlp.fc1", "mlp.fc2")
        for kind in ("weight", "bias")
    }
    head |= {
        f"head.probe.{i}.{kind}": torch.zeros(2) for i in (0, 2) for kind in ("weight", "bias")
    }
    head["head.pooler.query_tokens"] = torch.zeros(1, 1, 2)
    encoder = published.fill(published.under("tactile_model.", published.anytouch2(4, 192, 1)))
    converted = convert(encoder | head)
    assert converted.head is not None
    assert len(converted.head) == 19
    assert "force head: 19 tensors" in converted.report
    with pytest.raises(ConfigError, match="a force head of AnyTouch 2 but no encoder"):
        convert(head)


def test_clip_is_that_of_transformers(published: ModuleType) -> None:
    transformers = pytest.importorskip("transformers")
    config = transformers.CLIPVisionConfig(
        hidden_size=192,
        intermediate_size=768,
        num_hidden_layers=2,
        num_attention_heads=3,
        projection_dim=40,
        image_size=64,
        patch_size=16,
        hidden_act="quick_gelu",
    )
    reference = transformers.CLIPVisionModelWithProjection(config).eval()
    encoder = convert(reference.state_dict(), {"activation": "quick_gelu"}).build()
    images = torch.randint(0, 256, (2, 1, 3, 64, 64), dtype=torch.uint8)
    with torch.no_grad():
        tokens, cls = encoder(images, images[:, 0], torch.zeros(2, dtype=torch.long))
        pixels = encoder.preprocess(images, images[:, 0])[:, 0]
        theirs = reference(pixel_values=pixels)
    torch.testing.assert_close(cls, theirs.image_embeds, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(tokens, theirs.last_hidden_state, atol=1e-5, rtol=1e-4)


def test_openclip_is_the_same_network_in_other_names(published: ModuleType) -> None:
    theirs = state_of(published, "openclip")
    tower = "vision_model"
    hf = {
        f"{tower}.embeddings.class_embedding": theirs["visual.class_embedding"],
        f"{tower}.embeddings.patch_embedding.weight": theirs["visual.conv1.weight"],
        f"{tower}.embeddings.position_embedding.weight": theirs["visual.positional_embedding"],
        "visual_projection.weight": theirs["visual.proj"].T,
    }
    pairs = {"pre_layrnorm": "ln_pre", "post_layernorm": "ln_post"}
    for i in range(2):
        block, layer = f"transformer.resblocks.{i}", f"encoder.layers.{i}"
        pairs |= {f"{layer}.layer_norm1": f"{block}.ln_1", f"{layer}.layer_norm2": f"{block}.ln_2"}
        pairs |= {
            f"{layer}.mlp.fc1": f"{block}.mlp.c_fc",
            f"{layer}.mlp.fc2": f"{block}.mlp.c_proj",
        }
        pairs |= {f"{layer}.self_attn.out_proj": f"{block}.attn.out_proj"}
        for kind in ("weight", "bias"):
            parts = theirs[f"visual.{block}.attn.in_proj_{kind}"].chunk(3)
            for name, part in zip("qkv", parts, strict=True):
                hf[f"{tower}.{layer}.self_attn.{name}_proj.{kind}"] = part
    for ours, other in pairs.items():
        for kind in ("weight", "bias"):
            hf[f"{tower}.{ours}.{kind}"] = theirs[f"visual.{other}.{kind}"]
    first, two = convert(theirs), convert(hf)
    assert first.encoder_config == two.encoder_config
    assert all(torch.equal(first.state[key], two.state[key]) for key in two.state)


def test_unitouch_is_torchs_attention_on_two_equal_frames(published: ModuleType) -> None:
    """Written out with `nn.MultiheadAttention` and a Conv3d, as its trunk is published."""
    state = state_of(published, "unitouch")
    encoder = convert(state).build()
    p = {key.removeprefix("model."): value for key, value in state.items()}
    image = torch.randn(2, 3, 56, 56)
    stem, trunk, head = (
        "modality_preprocessors.touch",
        "modality_trunks.touch.blocks",
        "modality_heads.touch",
    )
    x = F.conv3d(
        image[:, :, None].repeat(1, 1, 2, 1, 1),
        p[f"{stem}.rgbt_stem.proj.1.weight"],
        stride=(2, 14, 14),
    )
    x = torch.cat([p[f"{stem}.cls_token"].expand(2, -1, -1), x.flatten(2).transpose(1, 2)], dim=1)
    x = x + p[f"{stem}.pos_embedding_helper.pos_embed"]
    with torch.no_grad():
        for i in range(2):
            own = {k.removeprefix(f"{trunk}.{i}."): v for k, v in p.items() if f"{trunk}.{i}." in k}
            attention = torch.nn.MultiheadAttention(192, 3, add_bias_kv=True, batch_first=True)
            names = attention.state_dict().keys()
            attention.load_state_dict({name: own[f"attn.{name}"] for name in names})
            y = F.layer_norm(x, (192,), own["norm_1.weight"], own["norm_1.bias"], 1e-6)
            x = x + attention(y, y, y)[0]
            y = F.layer_norm(x, (192,), own["norm_2.weight"], own["norm_2.bias"], 1e-6)
            y = F.gelu(F.linear(y, own["mlp.fc1.weight"], own["mlp.fc1.bias"]))
            x = x + F.linear(y, own["mlp.fc2.weight"], own["mlp.fc2.bias"])
        y = F.layer_norm(x[:, 0], (192,), p[f"{head}.0.weight"], p[f"{head}.0.bias"], 1e-6)
        scale = p["modality_postprocessors.touch.1.log_logit_scale"].exp()
        want = scale * F.normalize(F.linear(y, p[f"{head}.2.weight"]), dim=-1)
        tokens = encoder.encode(encoder.patchify(image[:, None]), torch.zeros(2, dtype=torch.long))
        got = encoder.pool_tokens(tokens)
    torch.testing.assert_close(tokens, x, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(got, want, atol=1e-4, rtol=1e-3)


def timm_block(x: Tensor, p: State, name: str, heads: int, eps: float) -> Tensor:
    """A block as timm has it."""
    q = {key.removeprefix(f"{name}."): x for key, x in p.items() if key.startswith(f"{name}.")}
    width = x.shape[-1]

    def norm(x: Tensor, which: str) -> Tensor:
        return F.layer_norm(x, (width,), q[f"{which}.weight"], q[f"{which}.bias"], eps)

    def linear(x: Tensor, which: str) -> Tensor:
        return F.linear(x, q[f"{which}.weight"], q[f"{which}.bias"])

    parts = linear(norm(x, "norm1"), "attn.qkv").reshape(*x.shape[:2], 3, heads, -1).unbind(2)
    query, key, value = (part.transpose(1, 2) for part in parts)
    weights = (query @ key.transpose(-1, -2) / (width / heads) ** 0.5).softmax(-1)
    x = x + linear((weights @ value).transpose(1, 2).flatten(2), "attn.proj")
    return x + linear(F.gelu(linear(norm(x, "norm2"), "mlp.fc1")), "mlp.fc2")


def timm_stem(image: Tensor, p: State, name: str) -> Tensor:
    """Patches by convolution, class token, positions."""
    weight, bias = (p[f"{name}patch_embed.proj.{kind}"] for kind in ("weight", "bias"))
    x = F.conv2d(image, weight, bias, stride=16).flatten(2).transpose(1, 2)
    x = torch.cat([p[f"{name}cls_token"].expand(len(x), -1, -1), x], dim=1)
    return x + p[f"{name}pos_embed"]


def test_tvl_is_timms_transformer(published: ModuleType) -> None:
    state = state_of(published, "tvl")
    encoder = convert(state).build()
    p = {key.removeprefix("tactile_encoder."): value for key, value in state.items()}
    image = torch.randn(2, 3, 64, 64)
    x = timm_stem(image, p, "")
    for i in range(2):
        x = timm_block(x, p, f"blocks.{i}", 3, 1e-6)
    pooled = F.layer_norm(x[:, 1:].mean(1), (192,), p["fc_norm.weight"], p["fc_norm.bias"], 1e-6)
    want = F.normalize(F.linear(pooled, p["head.weight"], p["head.bias"]), dim=-1)
    with torch.no_grad():
        tokens = encoder.encode(encoder.patchify(image[:, None]), torch.zeros(2, dtype=torch.long))
        torch.testing.assert_close(tokens, x, atol=1e-4, rtol=1e-4)
        torch.testing.assert_close(encoder.pool_tokens(tokens), want, atol=1e-5, rtol=1e-4)


def test_the_temperature_of_training_is_read(published: ModuleType) -> None:
    """The file keeps the logarithm of its inverse."""
    state = state_of(published, "tvl")
    for kept, expected in ((math.log(50), 0.02), (2000.0, None), (math.nan, None)):
        found = convert(state | {"logit_scale": torch.tensor(kept)}).temperature
        assert found == (expected and pytest.approx(expected))
    without = {key: value for key, value in state.items() if key != "logit_scale"}
    assert convert(without).temperature is None


def test_t3_is_a_stem_of_timm_and_a_trunk(published: ModuleType) -> None:
    p = state_of(published, "t3")
    encoder = convert(p).build()
    assert encoder.sensors == {"digit": 0, "mini": 1, "gelsight_mini": 1}
    image = torch.randn(1, 3, 224, 224)
    with torch.no_grad():
        for stem, row in (("digit", 0), ("mini", 1)):
            x = timm_stem(image, p, f"encoders.{stem}.")
            x = timm_block(x, p, f"encoders.{stem}.blocks.0", 12, 1e-6)
            x = timm_block(x, p, "trunk.blocks.0", 12, 1e-5)
            x = F.layer_norm(x, (768,), p["trunk.norm.weight"], p["trunk.norm.bias"], 1e-5)
            tokens = encoder.encode(encoder.patchify(image[:, None]), torch.tensor([row]))
            torch.testing.assert_close(tokens, x, atol=1e-4, rtol=1e-4)
            torch.testing.assert_close(encoder.pool_tokens(tokens), x[:, 0], atol=1e-4, rtol=1e-4)


def test_a_stem_whose_mean_is_not_published_is_refused(published: ModuleType) -> None:
    state = state_of(published, "t3")
    state = {key.replace("encoders.mini", "encoders.minii"): x for key, x in state.items()}
    with pytest.raises(ConfigError, match="T3 stem 'minii'; did you mean 'mini'"):
        convert(state)


def test_another_shape_is_named(published: ModuleType) -> None:
    state = state_of(published, "anytouch2, 4 frames")
    layer = "touch_mae_model.touch_model.encoder.layers.1"
    with pytest.raises(
        ConfigError, match=r"shapes: .*layers\.1\.mlp\.fc1\.bias gives \(5,\), not \(768,\)"
    ):
        convert(state | {f"{layer}.mlp.fc1.bias": torch.zeros(5)})
    with pytest.raises(ConfigError, match=r"do not fit: .*k_proj\.weight \(192, 5\)"):
        convert(state | {f"{layer}.self_attn.k_proj.weight": torch.zeros(192, 5)})
