"""FeelAnyForce and Sparsh-X: each against another implementation of the publication."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch
from tactileforge_published import convert, recognise
from tactileforge_published.feelanyforce import force_head
from tactileforge_published.heads import regressor_decoder
from tactileforge_published.importing import import_published
from torch import Tensor
from torch.nn import functional as F

import tactileforge
from tactileforge.encoders.backbone import Backbone
from tactileforge.encoders.preprocess import Preprocess
from tactileforge.errors import ConfigError

State = dict[str, Tensor]


def block(x: Tensor, p: State, name: str, heads: int) -> Tensor:
    """A block of DINOv2: torch's own attention, and both branches scaled."""
    own = {k.removeprefix(f"{name}."): v for k, v in p.items() if k.startswith(f"{name}.")}
    width = x.shape[-1]
    attention = torch.nn.MultiheadAttention(width, heads, batch_first=True)
    attention.load_state_dict(
        {
            "in_proj_weight": own["attn.qkv.weight"],
            "in_proj_bias": own["attn.qkv.bias"],
            "out_proj.weight": own["attn.proj.weight"],
            "out_proj.bias": own["attn.proj.bias"],
        }
    )
    y = F.layer_norm(x, (width,), own["norm1.weight"], own["norm1.bias"], 1e-6)
    x = x + own["ls1.gamma"] * attention(y, y, y)[0]
    y = F.layer_norm(x, (width,), own["norm2.weight"], own["norm2.bias"], 1e-6)
    y = F.gelu(F.linear(y, own["mlp.fc1.weight"], own["mlp.fc1.bias"]))
    return x + own["ls2.gamma"] * F.linear(y, own["mlp.fc2.weight"], own["mlp.fc2.bias"])


def cubic_weights(side: int, wanted: int) -> Tensor:
    """Matrix (wanted, side) of Keys' cubic with a = -.75, at the scale of ``wanted + .1``."""
    matrix = torch.zeros(wanted, side, dtype=torch.float64)
    for row in range(wanted):
        at = (row + 0.5) * side / (wanted + 0.1) - 0.5
        first = int(np.floor(at))
        for near in range(first - 1, first + 3):
            d = abs(at - near)
            inner = 1.25 * d**3 - 2.25 * d**2 + 1
            outer = -0.75 * d**3 + 3.75 * d**2 - 6 * d + 3
            matrix[row, min(max(near, 0), side - 1)] += inner if d <= 1 else outer
    return matrix


def dinov2_class(image: Tensor, p: State, depth: int, heads: int) -> Tensor:
    """Normed class token of a DINOv2 of another picture size."""
    kinds = (p[f"patch_embed.proj.{kind}"] for kind in ("weight", "bias"))
    x = F.conv2d(image, *kinds, stride=14)
    side, wanted = int((p["pos_embed"].shape[1] - 1) ** 0.5), x.shape[-1]
    grid = p["pos_embed"][0, 1:].double().view(side, side, -1)
    matrix = cubic_weights(side, wanted)
    grid = torch.einsum("ij,jkc,lk->ilc", matrix, grid, matrix).float().flatten(0, 1)
    x = x.flatten(2).mT + grid
    first = (p["cls_token"] + p["pos_embed"][:, :1]).expand(len(x), -1, -1)
    x = torch.cat([first, x], dim=1)
    for i in range(depth):
        x = block(x, p, f"blocks.{i}", heads)
    return F.layer_norm(x[:, 0], x.shape[-1:], p["norm.weight"], p["norm.bias"], 1e-6)


def regressed(x: Tensor, state: State) -> Tensor:
    """Head of FeelAnyForce, by torch's weight norm."""
    for number, place in enumerate((0, 3, 6, 9, 12)):
        own = {kind: state[f"regressor.regressor.{place}.{kind}"] for kind in ("weight_v", "bias")}
        out, given = own["weight_v"].shape
        linear = torch.nn.utils.parametrizations.weight_norm(torch.nn.Linear(given, out))
        linear.load_state_dict(
            {
                "bias": own["bias"],
                "parametrizations.weight.original0": state[f"regressor.regressor.{place}.weight_g"],
                "parametrizations.weight.original1": own["weight_v"],
            }
        )
        x = linear(x)
        if number < 4:
            norm = (state[f"regressor.regressor.{place + 1}.{x}"] for x in ("weight", "bias"))
            x = F.gelu(F.layer_norm(x, (out,), *norm))
    return x


def run(encoder: Backbone, pixels: Tensor) -> tuple[Tensor, Tensor]:
    """Tokens and vector of preprocessed frames (B, T, 3, H, W)."""
    zeros = torch.zeros(len(pixels), dtype=torch.int64)
    tokens = encoder.encode(encoder.patchify(pixels), zeros)
    return tokens, encoder.pool_tokens(tokens)


@pytest.mark.parametrize("side", [37, 16, 5])
def test_feelanyforce_is_dinov2_with_a_head(published: ModuleType, side: int) -> None:
    state = published.fill(published.feelanyforce(side=side))
    converted = convert(state)
    p = {k.removeprefix("tactile_backbone."): v for k, v in state.items()}
    image = published.noise(2 * 3 * 224 * 224, 1000).view(2, 3, 224, 224).float() * 4
    decoder = regressor_decoder(192)
    assert converted.head is not None
    decoder.load_state_dict(converted.head)
    assert "force head: 18 tensors" in converted.report
    with torch.no_grad():
        want = dinov2_class(image, p, 2, 3) if side != 16 else None
        tokens, vector = run(converted.build(), image[:, None])
        if want is not None:
            torch.testing.assert_close(vector, want, atol=2e-5, rtol=1e-5)
        assert torch.equal(vector, tokens[:, 0])
        torch.testing.assert_close(decoder(vector), regressed(vector, state), atol=1e-5, rtol=1e-5)


@pytest.mark.slow
def test_feelanyforce_at_its_published_size(published: ModuleType) -> None:
    state = published.fill(published.feelanyforce(768, 12))
    converted = convert(state)
    count = sum(x.numel() for x in converted.state.values())
    # 86,580,480 of DINOv2's ViT-B/14, less its mask token, and 256 positions for 1369
    assert count == 86_580_480 - 768 - (1369 - 256) * 768
    image = published.noise(3 * 224 * 224, 1000).view(1, 3, 224, 224).float() * 4
    with torch.no_grad():
        want = dinov2_class(
            image, {k.removeprefix("tactile_backbone."): v for k, v in state.items()}, 12, 12
        )
        torch.testing.assert_close(
            run(converted.build(), image[:, None])[1], want, atol=5e-5, rtol=1e-4
        )


def test_frames_of_feelanyforce_lie_between_black_bars(published: ModuleType) -> None:
    """Differences about 127 of 320 x 240 pixels, in 320 x 320, then a resize and a norm."""
    encoder = convert(published.fill(published.feelanyforce())).build()
    pixels: Preprocess = encoder.pixels
    frame = torch.randint(0, 256, (1, 1, 3, 240, 320), dtype=torch.uint8)
    still = torch.randint(60, 190, (1, 3, 240, 320), dtype=torch.uint8)
    square = torch.zeros(1, 3, 320, 320)
    square[..., 40:280, :] = (frame[:, 0].float() - still + 127).clamp(0, 255) / 255
    want = F.interpolate(square, (224, 224), mode="bilinear", antialias=True)
    mean, std = (
        torch.tensor(row).view(3, 1, 1)
        for row in (
            (0.36541664600372314, 0.3716222047805786, 0.36927229166030884),
            (0.21197719871997833, 0.2151239663362503, 0.21367691457271576),
        )
    )
    got = pixels(frame, still)[:, 0]
    torch.testing.assert_close(got, (want - mean) / std, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(got[0, :, 0, 0], (-mean / std).flatten(), atol=1e-5, rtol=1e-5)


def test_what_is_wrong_in_a_head_of_feelanyforce_is_named(published: ModuleType) -> None:
    state = published.fill(published.feelanyforce())
    name = "regressor.regressor.3.weight_g"
    with pytest.raises(ConfigError, match=rf"head of FeelAnyForce; missing: {name}; .*: nothing"):
        convert({key: x for key, x in state.items() if key != name})
    with pytest.raises(ConfigError, match=r"unexpected: regressor\.regressor\.13\.bias"):
        convert(state | {"regressor.regressor.13.bias": torch.zeros(3)})
    with pytest.raises(ConfigError, match=rf"do not fit: {name} \(256,\)"):
        convert(state | {name: torch.ones(256)})
    with pytest.raises(ConfigError, match=r"not finite: 3\.weight"):
        force_head(state | {name: torch.full((256, 1), torch.nan)})


def test_sparsh_x_is_two_stacks_of_dinov2_on_two_frames(published: ModuleType) -> None:
    """Newest frame first, each normalised, sine positions, a register in front."""
    state = published.fill(published.sparsh_x()) | published.sparsh_x_numbers()
    encoder = convert(state).build()
    newest_first = published.noise(2 * 6 * 224 * 224, 1000).view(2, 6, 224, 224).float() + 0.5
    x = (newest_first - state["img_avg"]) / state["img_div"]
    kinds = (state[f"patch_embed.img.proj.{kind}"] for kind in ("weight", "bias"))
    x = F.conv2d(x, *kinds, stride=16).flatten(2).mT
    places = torch.stack(torch.meshgrid(torch.arange(14), torch.arange(14), indexing="ij"), -1)
    angle = places.flatten(0, 1)[..., None] * published.bands(192, 2)
    x = x + torch.cat([angle.sin(), angle.cos()], -1).flatten(1)
    x = torch.cat([state["register_tokens"].expand(2, -1, -1), x], dim=1)
    with torch.no_grad():
        for name in ("blocks.0.img", "blocks.1.img", "fusion_blocks.0"):
            x = block(x, state, name, 3)
        want = F.layer_norm(x, (192,), state["norm.weight"], state["norm.bias"], 1e-6)[:, 1:]
        oldest_first = newest_first.view(2, 2, 3, 224, 224).flip(1)
        tokens, _ = run(encoder, oldest_first)
    torch.testing.assert_close(tokens, want, atol=5e-5, rtol=1e-4)


@pytest.mark.parametrize("prefix", ["", "teacher_encoder.backbone."])
def test_other_kinds_of_sparsh_x_are_refused_by_name(published: ModuleType, prefix: str) -> None:
    own = published.under(prefix, published.sparsh_x())
    numbers = published.sparsh_x_numbers()
    images = published.fill(own) | {prefix + key: value for key, value in numbers.items()}
    assert recognise(images).name == "sparsh_x"
    sound = {f"{prefix}patch_embed.mic.proj.weight": torch.zeros(192, 1, 16, 16)}
    register = f"{prefix}register_tokens"
    with pytest.raises(ConfigError, match=r"Sparsh-X of other senses .*facebook/sparsh-x-img"):
        convert(images | sound | {register: torch.zeros(2, 1, 192)})
    shared = f"{prefix}fusion_blocks.0."
    whole = {key.replace(shared, f"{shared}img."): value for key, value in images.items()}
    with pytest.raises(ConfigError, match=r"exchanges bottleneck tokens .*facebook/sparsh-x-img"):
        convert(whole | sound | {f"{prefix}bottleneck": torch.zeros(1, 4, 192)})
    half = {key: value for key, value in images.items() if key != f"{prefix}norm.weight"}
    with pytest.raises(ConfigError, match=r"Nearest: Sparsh-X \(images\) lacks norm\.weight"):
        convert(half)


@pytest.mark.slow
def test_forces_of_feelanyforce_are_newton_on_a_mini(
    published: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "cache"))
    state = published.fill(published.feelanyforce(768, 12))
    state["regressor.regressor.12.weight_g"] *= 5
    file = tmp_path / "checkpoint_v1.pth.tar"
    torch.save({"state_dict": state, "epoch": 3, "config": {"num_labels": 3}}, file)
    with pytest.raises(ConfigError, match=r"sensor of FeelAnyForce's forces 'digit'"):
        import_published("feelanyforce", file, sensor="digit")
    import_published("feelanyforce", file)
    model = tactileforge.load("feelanyforce")
    noise = np.random.default_rng(0).integers(0, 256, (3, 1, 240, 320, 3), dtype=np.uint8)
    frames, still = noise[:2], noise[2, 0]
    with pytest.warns(UserWarning, match="no calibration= of this unit"):
        force = model.force(frames, still, "gelsight_mini", unit="uncalibrated")
    assert force.shape == (2, 1, 3)
    with torch.no_grad():
        want = regressed(model.encode(frames, still, "gelsight_mini"), state)[:, None]
    assert want.abs().max() < 15
    assert want.std() > 0.1
    torch.testing.assert_close(force, want, atol=1e-4, rtol=1e-4)
