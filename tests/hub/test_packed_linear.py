import copy
import pickle
from types import SimpleNamespace

import pytest
import torch
from torch import nn
from torch.nn import functional as F

from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.hub.packed_linear import PackedLinears, can_pack

packs = pytest.mark.skipif(not can_pack(), reason="this torch has no oneDNN")


class Calls:
    """Counts packings and packed products."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        can_pack()  # is not counted
        self.packed = self.used = 0
        pack, use = torch.ops.mkldnn._reorder_linear_weight, torch.ops.mkldnn._linear_pointwise

        def counted_pack(weight: torch.Tensor) -> object:
            self.packed += 1
            return pack(weight)

        def counted_use(*args: object) -> object:
            self.used += 1
            return use(*args)

        monkeypatch.setattr(torch.ops.mkldnn, "_reorder_linear_weight", counted_pack)
        monkeypatch.setattr(torch.ops.mkldnn, "_linear_pointwise", counted_use)


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Calls:
    return Calls(monkeypatch)


@packs
@pytest.mark.parametrize("kind", [TactileViT, PlainViT])
@pytest.mark.parametrize("batch", [1, 3])
def test_the_numbers_stay(kind: type[nn.Module], batch: int, calls: Calls) -> None:
    encoder = kind(size="tiny", frames=4, image_size=32).eval()
    linears = sum(isinstance(module, nn.Linear) for module in encoder.modules())
    frames = torch.randint(0, 256, (batch, 4, 3, 40, 50), dtype=torch.uint8)
    inputs = frames, frames[:, 0], encoder.sensor_ids(["digit"] * batch)
    packed = PackedLinears()
    with torch.no_grad():
        expected = encoder(*inputs)
        for _ in range(2):
            with packed:
                outputs = encoder(*inputs)
            for mine, theirs in zip(expected, outputs, strict=True):
                assert (mine - theirs).abs().max() < 1e-5
    assert (calls.packed, calls.used) == (linears, 2 * linears)


CHANGES = {
    "an operation": lambda layer: layer.weight.mul_(2),
    "a state": lambda layer: layer.load_state_dict({"weight": 2 * layer.weight}),
    "data": lambda layer: layer.weight.data.mul_(2),
    "other data": lambda layer: setattr(layer.weight, "data", 2 * layer.weight.data),
    "a parameter": lambda layer: setattr(layer, "weight", nn.Parameter(2 * layer.weight)),
}


@packs
@pytest.mark.parametrize("change", CHANGES)
def test_a_weight_that_changed_is_packed_again(change: str, calls: Calls) -> None:
    layer, x = nn.Linear(300, 200, bias=False), torch.randn(4, 300)
    with torch.no_grad(), PackedLinears():
        before = layer(x)
        CHANGES[change](layer)
        torch.testing.assert_close(layer(x), 2 * before)
    assert calls.packed == 2


@packs
def test_training_is_noticed(calls: Calls) -> None:
    layer, x = nn.Linear(8, 4), torch.randn(4, 8)
    packed = PackedLinears()
    optimizer = torch.optim.SGD(layer.parameters(), lr=0.1)
    for step in range(1, 4):
        with packed:
            layer(x).square().sum().backward()  # gradients are kept, so nothing is packed
        optimizer.step()
        with torch.no_grad(), packed:
            torch.testing.assert_close(layer(x), x @ layer.weight.T + layer.bias)
        assert calls.used == calls.packed == step


@packs
def test_what_cannot_be_packed_is_computed_as_ever(
    calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    layer = nn.Linear(8, 4)
    with torch.inference_mode():
        inference = nn.Linear(8, 4)
    x = torch.randn(2, 8)
    with torch.no_grad(), PackedLinears():
        assert copy.deepcopy(layer).double()(x.double()).dtype == torch.float64
        assert layer(x[:0]).shape == (0, 4)
        assert inference(x).shape == (2, 4)
        assert F.linear(x, layer.weight[:2]).shape == (2, 2)
        turned = nn.Parameter(layer.weight.T.contiguous().T)
        assert F.linear(x, turned, layer.bias).shape == (2, 4)
        assert F.linear(x, nn.Parameter(torch.ones(8))).shape == (2,)
        assert F.linear(x, layer.weight, bias=layer.bias).shape == (2, 4)
        with torch.autocast("cpu", torch.bfloat16):
            assert layer(x).dtype == torch.bfloat16
        monkeypatch.setattr(torch.backends.mkldnn, "enabled", False)
        assert torch.equal(layer(x), torch.addmm(layer.bias, x, layer.weight.T))
    with PackedLinears():
        assert layer(x).requires_grad
    assert calls.packed == 0


@pytest.mark.parametrize("change", ["absent", "other arguments", "other numbers"])
def test_a_torch_with_other_operators(change: str, monkeypatch: pytest.MonkeyPatch) -> None:
    known = {
        "absent": {},
        "other arguments": {"_reorder_linear_weight": lambda: None},
        "other numbers": {
            "_reorder_linear_weight": lambda weight: weight,
            "_linear_pointwise": lambda x, weight, *rest: x @ weight.T,
        },
    }[change]
    monkeypatch.setattr(torch.ops, "mkldnn", SimpleNamespace(**known))
    can_pack.cache_clear()
    assert not can_pack()
    layer, x = nn.Linear(8, 4), torch.randn(2, 8)
    with torch.no_grad(), PackedLinears():
        assert torch.equal(layer(x), torch.addmm(layer.bias, x, layer.weight.T))
    can_pack.cache_clear()


@packs
def test_copies_start_empty() -> None:
    packed, layer, x = PackedLinears(), nn.Linear(8, 4), torch.randn(2, 8)
    with torch.no_grad(), packed:
        layer(x)
    assert len(packed._packed) == 1
    for other in (copy.deepcopy(packed), pickle.loads(pickle.dumps(packed))):
        assert isinstance(other, PackedLinears)
        assert not other._packed
