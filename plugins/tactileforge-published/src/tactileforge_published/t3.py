"""T3: a stem for each type of sensor, and a shared trunk."""

from __future__ import annotations

from typing import Any

from tactileforge.errors import ConfigError, check_names
from tactileforge_published.layout import (
    ConversionPlan,
    Keys,
    State,
    WeightLayout,
    blocks,
    depth_of,
    norms,
    square,
)
from tactileforge_published.sparsh import TIMM_BLOCK

#: Mean and standard deviation of the images of each stem, from T3's configurations of its data
#: sets. A stem of several sets has the numbers of the first: VisGel, tippur23 (first cylinder),
#: cnc. The Mini's are from AnyTouch 2's evaluation, as T3 has different ones for every set.
_NORMS = {
    "digit": ((0.42094, 0.44041, 0.44151), (0.14661, 0.08972, 0.09041)),
    "gs_tag": ((0.51808, 0.50300, 0.51457), (0.13893, 0.11343, 0.13497)),
    "gs_green": ((0.36917, 0.51738, 0.51782), (0.13530, 0.11039, 0.10001)),
    "gs_black": ((0.46676, 0.45028, 0.45292), (0.08171, 0.06973, 0.08618)),
    "gs_360_v2": ((0.48141, 0.24831, 0.30964), (0.07714, 0.07175, 0.07466)),
    "mini": ((0.02172, 0.04152, 0.04152), (0.10158, 0.14423, 0.12185)),
    "wedge": ((0.24580, 0.30085, 0.35867), (0.18356, 0.14779, 0.18460)),
    "finray": ((0.01000, 0.04490, 0.07897), (0.06394, 0.14283, 0.20100)),
    "svelte": ((0.41175, 0.26801, 0.02041), (0.26641, 0.19636, 0.09754)),
    "densetact": ((0.20997, 0.28465, 0.26797), (0.29838, 0.36981, 0.33362)),
}
#: Our name of the type of sensor of a stem.
_ALSO = {"gs_tag": "gelsight", "gs_black": "gelslim", "mini": "gelsight_mini"}


def _plan(state: State) -> ConversionPlan:
    stems = sorted({key.split(".")[1] for key in state if key.startswith("encoders.")})
    if not stems:
        raise ConfigError("T3: a trunk without stems; give the folder, with encoders/ in it")
    check_names("T3 stem", stems, _NORMS, "Its mean is not published.")
    first = f"encoders.{stems[0]}"
    width = len(state["trunk.norm.weight"])
    if width != 768:
        raise ConfigError(f"T3: {width} wide; only the medium model (768) has its heads published")
    embed = _tensor(state, f"{first}.patch_embed.proj.weight")
    positions = _tensor(state, f"{first}.pos_embed").shape[1]
    stem_depth = depth_of(state, f"{first}.blocks")
    trunk = depth_of(state, "trunk.blocks")
    keys = norms({"norm_out": "trunk.norm"})
    keys |= blocks("transformer.blocks", "trunk.blocks", trunk, TIMM_BLOCK)
    change = {}
    for i, stem in enumerate(stems):
        keys |= _stem(f"stems.{i}", f"encoders.{stem}", stem_depth)
        change[f"stems.{i}.class_token"] = lambda x: x.flatten()
        # timm keeps an axis of length 1 for the batch
        change[f"stems.{i}.position"] = lambda x: x[0]
        change[f"stems.{i}.embed.weight"] = lambda x: x.flatten(1)
    # a sensor may be named by T3's name of its stem, or by our name of its type
    sensors = {stem: i for i, stem in enumerate(stems)}
    sensors |= {_ALSO[stem]: i for stem, i in sensors.items() if stem in _ALSO}
    options: dict[str, Any] = {
        "size": "base",
        "depth": stem_depth + trunk,
        "frames": 1,
        "spacing": 0.0,
        "image_size": square(positions - 1, "T3") * embed.shape[-1],
        "patch": embed.shape[-1],
        "tube": 1,
        "positions": "learned",
        "class_token": True,
        "layer_scale": None,
        "stems": len(stems),
        "stem_depth": stem_depth,
        "sensors": sensors,
        # torch's default in the trunk; its stems have timm's, see `plain_vit`
        "eps": 1e-5,
        "pool": "class",
        "pixels": {
            "offset": None,
            "fit": "cover",
            "filter": "bilinear",
            "edge": 256,
            "mean": [list(_NORMS[stem][0]) for stem in stems],
            "std": [list(_NORMS[stem][1]) for stem in stems],
        },
    }
    return ConversionPlan("plain_vit", options, keys, change)


def _tensor(state: State, key: str) -> Any:
    if key not in state:
        raise ConfigError(f"not a whole T3 model; missing: {key}")
    return state[key]


def _stem(ours: str, theirs: str, depth: int) -> Keys:
    keys: Keys = {
        f"{ours}.class_token": f"{theirs}.cls_token",
        f"{ours}.position": f"{theirs}.pos_embed",
    }
    keys |= norms({f"{ours}.embed": f"{theirs}.patch_embed.proj"})
    return keys | blocks(f"{ours}.transformer.blocks", f"{theirs}.blocks", depth, TIMM_BLOCK)


LAYOUT = WeightLayout(
    name="t3",
    title="T3 (the folder with trunk.pth and encoders/)",
    marks={
        "trunk.norm.weight": (None,),
        "trunk.norm.bias": (None,),
        "trunk.blocks.0.attn.qkv.weight": (None, None),
    },
    plan=_plan,
)
