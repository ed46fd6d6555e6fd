"""Every shipped plugin of every kind passes the command for its users."""

import re

import pytest

from tactileforge.cli import dispatch
from tactileforge.encoders import efficientnet_lite
from tactileforge.plugins import registry
from tactileforge.plugins.distributions import is_ours

SHIPPED = sorted(
    (one.kind.removesuffix("s"), one.name)
    for one in registry.list_plugins()
    if one.kind in (*registry.KINDS, *registry.MODULES) and is_ours(one.distribution)
)
_CLIP = ("image_size=32", "frames=2")
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
    ("head", "diffusion_policy"): ("channels=[16,32]", "step_width=16"),
    ("head", "pixel"): _DECODER,
    ("head", "diff"): _DECODER,
    ("head", "jepa"): _DECODER,
    ("head", "dino"): ("prototypes=64", "hidden=64", "bottleneck=16"),
}
#: Objectives that need no labels, and what they cannot be asked.
FREE = ("pixel", "diff", "jepa", "dino", "distill")
UNLABELLED = {"unlabelled samples change nothing", "labels are counted", "missing key is named"}


@pytest.fixture
def few_blocks(monkeypatch):
    """Half of the blocks of Lite0: whole, it is exported with ``touch.tiny`` (test_squash.py)."""
    stages = tuple(
        (*row[:-1], min(row[-1], 1 + (row[3] == 24))) for row in efficientnet_lite._STAGES
    )
    monkeypatch.setattr(efficientnet_lite, "_STAGES", stages)
    monkeypatch.setattr(efficientnet_lite, "_MAPS", (3, 5, 7))


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
