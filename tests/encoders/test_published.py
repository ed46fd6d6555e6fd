"""The architecture is AnyTouch 2's: the published model's outputs for deterministic weights.

The numbers were made with the authors' own classes, whose weights were filled by the formula below;
they are facts about the published architecture, not weights.
"""

import pytest
import torch
from torch import Tensor

from tactileforge.encoders.published import anytouch2
from tactileforge.encoders.tactile_vit import TactileViT

# mean, standard deviation, largest magnitude, first four and last four values of each output
GOLDEN = {
    (4, "hidden"): (-0.15698135, 3.38284322, 16.67404366),
    (4, "proj"): (0.03835790, 1.02856356, 4.83310986),
    (4, "cls"): (0.05033021, 1.02644145, 3.05182052),
    (2, "cls"): (0.03539060, 1.01444157, 3.08700037),
}
ENDS = {
    (4, "hidden"): (
        [2.29107571, 0.95381176, -1.69061720, 0.12694412],
        [-3.11914277, -0.99548852, -2.92023158, -2.88947296],
    ),
    (4, "proj"): (
        [0.18647230, -0.10319887, 0.92936659, -0.42311314],
        [0.45484516, -1.65833569, 0.87069100, -0.01372290],
    ),
    (4, "cls"): (
        [0.18647240, -0.10319895, 0.92936695, -0.42311352],
        [1.08161473, -0.55890501, 1.53395450, -0.42820340],
    ),
    (2, "cls"): (
        [0.22606251, -0.13682750, 0.76275945, -0.35626930],
        [0.12440503, -0.12099999, 1.65871692, -0.47239960],
    ),
}


def noise(count: int, i: int) -> Tensor:
    """The fill: frac(sin(12.9898 j + 78.233 i) * 43758.5453) - 0.5 in float64."""
    j = torch.arange(count, dtype=torch.float64)
    x = torch.sin(12.9898 * j + 78.233 * i) * 43758.5453
    return x - x.floor() - 0.5


def published_shapes(frames: int) -> dict[str, tuple[int, ...]]:
    positions = frames // 2 * 196 + 1
    shapes: dict[str, tuple[int, ...]] = {
        "sensor_token": (20, 5, 768),
        "new_position_ids": (1, positions),
        "touch_model.embeddings.class_embedding": (768,),
        "touch_model.embeddings.patch_embedding.weight": (768, 3, 2, 16, 16),
        "touch_model.embeddings.position_embedding.weight": (positions, 768),
        "touch_projection.weight": (512, 768),
    }
    norms = ["touch_model.pre_layrnorm", "touch_model.post_layernorm"]
    linears = {}
    for i in range(12):
        layer = f"touch_model.encoder.layers.{i}"
        norms += [f"{layer}.layer_norm1", f"{layer}.layer_norm2"]
        linears |= {f"{layer}.self_attn.{x}_proj": (768, 768) for x in ("q", "k", "v", "out")}
        linears |= {f"{layer}.mlp.fc1": (3072, 768), f"{layer}.mlp.fc2": (768, 3072)}
    for name in norms:
        shapes |= {f"{name}.weight": (768,), f"{name}.bias": (768,)}
    for name, shape in linears.items():
        shapes |= {f"{name}.weight": shape, f"{name}.bias": shape[:1]}
    return shapes


def published_state(frames: int) -> dict[str, Tensor]:
    state = {}
    for i, (key, shape) in enumerate(sorted(published_shapes(frames).items())):
        count = torch.Size(shape).numel()
        if key == "new_position_ids":
            state[key] = torch.arange(count)[None]
            continue
        r = noise(count, i)
        if key.endswith("weight") and len(shape) > 1 and not key.endswith("embedding.weight"):
            value = r * (12 / (count / shape[0])) ** 0.5
        elif len(shape) > 1:
            value = 0.1 * r
        else:
            value = 1 + 0.2 * r if key.endswith("weight") else 0.1 * r
        state[key] = value.reshape(shape).float()
    return state


def outputs(frames: int) -> dict[str, Tensor]:
    encoder = TactileViT("base", frames=frames).eval()
    state = published_state(frames)
    assert len(state) == 202
    encoder.load_state_dict(anytouch2(state), strict=True)
    shape = (2, frames, 3, 224, 224)
    clip = (4 * noise(torch.Size(shape).numel(), 1000)).reshape(shape).float()
    with torch.no_grad():
        hidden = encoder.encode(encoder.patchify(clip), torch.tensor([1, 3]))
        proj = encoder.project(encoder.norm_out(hidden))
    return {"hidden": hidden, "proj": proj, "cls": proj[:, 0]}


@pytest.mark.parametrize("frames", [4, 2])
def test_outputs_are_those_of_the_published_model(frames: int) -> None:
    made = outputs(frames)
    for (case, name), (mean, std, absmax) in GOLDEN.items():
        if case != frames:
            continue
        x = made[name].double()
        first, last = ENDS[case, name]
        assert x.mean().item() == pytest.approx(mean, abs=1e-4)
        assert x.std().item() == pytest.approx(std, abs=1e-4)
        assert x.abs().max().item() == pytest.approx(absmax, abs=1e-4)
        torch.testing.assert_close(x.flatten()[:4].tolist(), first, atol=1e-4, rtol=0)
        torch.testing.assert_close(x.flatten()[-4:].tolist(), last, atol=1e-4, rtol=0)


def test_number_of_parameters_is_the_published_one() -> None:
    count = sum(p.numel() for p in TactileViT("base", frames=4).parameters())
    assert count == 87_009_792


def test_a_missing_tensor_is_named() -> None:
    state = published_state(2)
    del state["touch_model.encoder.layers.3.mlp.fc1.bias"]
    with pytest.raises(KeyError, match=r"layers\.3\.mlp\.fc1\.bias"):
        anytouch2(state)
