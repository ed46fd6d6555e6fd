"""Every shipped plugin of every kind passes the command for its users."""

import re
from functools import cache
from importlib.metadata import packages_distributions

import pytest
from tactileforge_published import resnet

from tactileforge.cli import dispatch
from tactileforge.encoders import efficientnet_lite
from tactileforge.plugins import registry
from tactileforge.plugins.distributions import is_ours
from tactileforge.testing import general, modules

SHIPPED = sorted(
    (one.kind.removesuffix("s"), one.name)
    for one in registry.list_plugins()
    if one.kind in (*registry.KINDS, *registry.MODULES) and is_ours(one.distribution)
)
_CLIP = ("image_size=32", "frames=2")
SMALL_DENOISER = {"channels": [16, 32], "step_width": 16}
_DECODER = ("width=32", "depth=1", "heads=2")
#: Options that make data and networks small enough for a test.
SMALL = {
    ("dataset", "sim"): ("scenes=3", "val=1", "size=32", "indenters=few", "sensors=[digit]"),
    ("dataset", "sim_array"): ("scenes=2", "val=1"),
    ("encoder", "efficientnet_lite"): ("image_size=64",),
    ("encoder", "plain_vit"): ("size=tiny", "depth=1", *_CLIP),
    ("encoder", "resnet18"): ("image_size=64",),
    ("encoder", "tactile_cnn"): ("image_size=64",),
    ("encoder", "tactile_vit"): ("size=tiny", "depth=1", *_CLIP),
    ("encoder", "vqgan"): ("channels=[32,32]", "attention=[1]", "blocks=1", "image_size=16"),
    ("head", "diffusion_policy"): tuple(f"{k}={v}" for k, v in SMALL_DENOISER.items()),
    ("head", "pixel"): _DECODER,
    ("head", "diff"): _DECODER,
    ("head", "jepa"): _DECODER,
    ("head", "dino"): ("prototypes=64", "hidden=64", "bottleneck=16"),
}
#: Objectives that need no labels, and what they cannot be asked.
FREE = ("pixel", "diff", "jepa", "dino", "distill")
UNLABELLED = {"unlabelled samples change nothing", "labels are counted", "missing key is named"}


#: Read once for all of them: whose modules are installed.
owners = cache(packages_distributions)


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    """Makes the networks around the plugins small: the U-Net below a loss, a ResNet's stages."""
    monkeypatch.setattr(general, "packages_distributions", owners)
    monkeypatch.setitem(modules.SMALL_HEADS, "diffusion_policy", SMALL_DENOISER)
    monkeypatch.setattr(resnet, "_WIDTH", 32)
    monkeypatch.setattr(resnet, "_STAGES", (8, 16, 24, 32))
    monkeypatch.setattr(resnet, "_BLOCKS", 1)


@pytest.fixture
def few_blocks(monkeypatch):
    """Six blocks of Lite0, of sixteen: whole, ``touch.tiny`` is exported with it (test_squash.py).

    One has a shortcut, one is not expanded, and kernels are of both sizes.
    """
    stages = ((3, 1, 1, 16, 1), (3, 2, 2, 24, 2), (5, 2, 2, 40, 1), (3, 2, 2, 112, 1))
    monkeypatch.setattr(efficientnet_lite, "_STAGES", (*stages, (5, 2, 2, 320, 1)))
    monkeypatch.setattr(efficientnet_lite, "_MAPS", (3, 4, 5))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "name"), SHIPPED, ids=["-".join(one) for one in SHIPPED])
def test_it_passes_its_check(kind, name, capsys, request):
    if name == "tactile_cnn":
        request.getfixturevalue("few_blocks")
    words = ["check", name, "--kind", kind, *SMALL.get((kind, name), ())]
    failed = dispatch("plugins", words)
    out = capsys.readouterr().out
    assert not failed, out
    assert ", 0 failed, " in out.splitlines()[-1]
    skipped = set(re.findall(r"^ *skipped +(.+?)(?: *: |$)", out, re.M))
    if kind in ("head", "objective"):
        assert skipped == (UNLABELLED if kind == "objective" and name in FREE else set()), out


def test_every_kind_is_among_them():
    kinds = {kind for kind, _ in SHIPPED}
    assert kinds == {kind.removesuffix("s") for kind in (*registry.KINDS, *registry.MODULES)}
