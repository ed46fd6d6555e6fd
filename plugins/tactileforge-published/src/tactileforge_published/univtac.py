"""UniVTAC's tactile encoder: a ResNet-18 trained on simulated touch."""

from __future__ import annotations

from tactileforge.encoders import AS_THEY_ARE
from tactileforge_published.layout import (
    ConversionPlan,
    Keys,
    State,
    WeightLayout,
    norms,
)

#: Height and width of frames: a policy on it has maps of 8 x 8, and its decoders rebuild 256 x 256.
_IMAGE = 256


def _plan(state: State) -> ConversionPlan:
    keys: Keys = norms({"project": "fc"})
    places = [(f"stages.{i}.{j}.", f"layer{i + 1}.{j}.") for i in range(4) for j in range(2)]
    for ours, theirs in [("", ""), *places]:  # the first convolution has no block around it
        for i in (1, 2) if ours else (1,):
            keys |= {f"{ours}conv{i}.weight": f"{theirs}conv{i}.weight"}
            keys |= _norm(f"{ours}bn{i}", f"{theirs}bn{i}")
    for stage in (1, 2, 3):
        ours, theirs = (f"{x}.0.downsample" for x in (f"stages.{stage}", f"layer{stage + 1}"))
        keys |= {f"{ours}.0.weight": f"{theirs}.0.weight"} | _norm(f"{ours}.1", f"{theirs}.1")
    options = {
        "frames": 1,
        "spacing": 0.0,
        "image_size": _IMAGE,
        "projected": len(state["fc.weight"]),
        "pixels": dict(AS_THEY_ARE),
    }
    return ConversionPlan("resnet18", options, keys)


def _norm(ours: str, theirs: str) -> Keys:
    kinds = ("weight", "bias", "running_mean", "running_var")
    return {f"{ours}.{kind}": f"{theirs}.{kind}" for kind in kinds}


LAYOUT = WeightLayout(
    name="univtac",
    title="UniVTAC's encoder",
    marks={
        "conv1.weight": (64, 3, 7, 7),
        "layer1.0.conv1.weight": (64, 64, 3, 3),
        "layer4.1.conv2.weight": (512, 512, 3, 3),
        "fc.weight": (None, 512),
    },
    plan=_plan,
    prefixes=("backbone.",),
    beside="decoders.marker.ffn.2.weight",
    unused={"*num_batches_tracked": "count of training"},
    outside="decoders of images, depth, markers and pose",
)
