"""Heads by classes of the user's own, in files and runs."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

import tactileforge
from tactileforge import api
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError, PluginError
from tactileforge.hub.creating import create
from tactileforge.hub.header import read_header
from tactileforge.hub.pack import pack_run
from tactileforge.plugins import local
from tactileforge.verbs import _typed

SMALL = {"size": "tiny", "depth": 1, "image_size": 32, "patch": 16, "frames": 2}
CLIP = np.random.default_rng(0).integers(0, 256, (2, 40, 40, 3), np.uint8)
LEFT = rf"head grasp is left out: {__name__}:Grasp is of somebody's own, .*code={__name__}:G"


class Grasp(nn.Module):
    def __init__(self, encoder, classes: int = 2) -> None:
        super().__init__()
        self.linear = nn.Linear(encoder.projected, classes)

    def forward(self, views, batch):
        return self.linear(views.full.cls)


class Wants(Grasp):
    def __init__(self, encoder, text_encoder) -> None:
        super().__init__(encoder)


class NearZero(nn.Module):
    head, needs = Grasp, frozenset()

    def forward(self, prediction, batch):
        return prediction.square().mean(), {}


class Net(TactileViT):
    """An encoder of one's own."""


@pytest.fixture(autouse=True)
def _forgets():
    before = dict(local._known)
    yield
    local._known.clear()
    local._known.update(before)


def test_a_head_of_ones_own_is_saved_and_comes_back_with_its_class(tmp_path: Path) -> None:
    model = create("tactile_vit", **SMALL)
    model.add_head("grasp", Grasp, classes=3)
    fingerprint = model.fingerprint
    folder = model.save_pretrained(tmp_path / "out")
    wanted = model.read_head("grasp", CLIP, "first", "digit")
    assert wanted.shape == (1, 3)
    assert f"| heads | grasp ({__name__}:Grasp) |" in (folder / "README.md").read_text()

    local._known.clear()  # another process
    with pytest.warns(UserWarning, match=LEFT) as told:
        rest = tactileforge.load(folder)
    assert len(told) == 1
    assert "\n" not in str(told[0].message)
    assert (list(rest.heads), rest.fingerprint) == ([], fingerprint)
    assert torch.equal(rest.encode(CLIP, "first", "digit"), model.encode(CLIP, "first", "digit"))
    again = tactileforge.load(rest.save(tmp_path / "rest.safetensors"))  # no warning
    assert again.header.heads == {}

    model = tactileforge.load(folder, classes={f"{__name__}:Grasp": Grasp})
    assert isinstance(model.heads["grasp"], Grasp)
    assert torch.equal(model.read_head("grasp", CLIP, "first", "digit"), wanted)
    assert model.fingerprint == fingerprint


def test_a_class_of_a_function_and_a_name_of_the_package_are_heads_too() -> None:
    class Own(Grasp):
        pass

    model = create("tactile_vit", **SMALL)
    assert isinstance(model.add_head("own", Own), Own)
    assert model.add_head("classify", classes=4).linear.out_features == 4
    assert model.add_head("typed", f"{__name__}:Grasp", classes=5).linear.out_features == 5


@pytest.mark.parametrize(
    ("name", "head", "options", "message"),
    [
        ("classify", Grasp, {}, "no class of a head of this name that is made of the encoder"),
        ("mine", Wants, {}, "made of the encoder alone"),
        ("mine", Grasp, {"clases": 3}, "did you mean 'classes'"),
        ("mine", Grasp, {"classes": "/etc/passwd"}, "a model file names no file"),
        ("mine", "no_such:Head", {}, "there is no module 'no_such'"),
        ("mine", "", {}, "unknown head 'mine'"),
        ("a.b", Grasp, {}, "use letters, digits and underscores"),
        ("there", Grasp, {}, "the model has a head 'there'"),
    ],
)
def test_heads_that_cannot_be_kept_are_refused(name, head, options, message) -> None:
    model = create("tactile_vit", **SMALL)
    model.add_head("there", Grasp)
    with pytest.raises((ConfigError, DataError, PluginError), match=message):
        model.add_head(name, head, **options)
    assert list(model.heads) == ["there"]


def test_another_class_of_that_name_is_not_taken_for_it(tmp_path: Path) -> None:
    model = create("tactile_vit", **SMALL)
    model.add_head("grasp", Grasp)
    file = model.save(tmp_path / "a.safetensors")
    local._known.clear()
    with pytest.raises(DataError, match="head grasp: these are not the weights"):
        tactileforge.load(file, classes={f"{__name__}:Grasp": type("Grasp", (Other,), {})})
    with pytest.raises(PluginError, match="has no forward"):
        tactileforge.load(file, classes={f"{__name__}:Grasp": dict})


class Other(Grasp):
    def __init__(self, encoder, classes: int = 7) -> None:
        super().__init__(encoder, classes)


@pytest.mark.parametrize("given", [Net, f"{__name__}:Net", "{}/own_network.py:Net"])
def test_an_encoder_of_ones_own_is_created_saved_and_loaded(given, tmp_path: Path) -> None:
    text = "from tactileforge.encoders import TactileViT\n\n\nclass Net(TactileViT):\n    pass\n"
    (tmp_path / "own_network.py").write_text(text)
    given = given if isinstance(given, type) else given.format(tmp_path)
    model = create(given, num_classes=3, **SMALL)
    path = model.save(tmp_path / "own.safetensors")
    name = read_header(path).encoder["name"]
    assert str(tmp_path) not in path.read_bytes()[:20000].decode("latin")
    local._known.clear()
    with pytest.raises(PluginError, match=r"of somebody's own.*classes="):
        tactileforge.load(path)
    found = tactileforge.load(path, classes={name: Net})
    assert torch.equal(found.encode(CLIP, "first", "digit"), model.encode(CLIP, "first", "digit"))


@pytest.mark.slow
def test_the_head_of_a_run_is_packed(tmp_path: Path) -> None:
    words = ["scale=demo", "encoder.image_size=32", "batch.size=4", "batch.workers=0"]
    words += ["data.scenes=3", "data.val=1", "data.size=32", "trainer.max_steps=2"]
    words += [f"objective=[pixel,{__name__}:NearZero]", "head.near_zero.classes=3"]
    module = api.train(tactileforge.compose("mae", words), tmp_path)
    model = tactileforge.load(pack_run(tmp_path, tmp_path / "a.safetensors"))
    assert isinstance(model.heads["near_zero"], Grasp)
    assert torch.equal(
        model.heads["near_zero"].linear.weight, module.heads["near_zero"].linear.weight
    )
    assert model.read_head("near_zero", CLIP, "first", "gelsight_mini").shape == (1, 3)

    local._known.clear()
    with pytest.raises(PluginError, match=r"was made with .*Grasp.*classes="):
        tactileforge.train(resume=tmp_path)
    for made in (tmp_path, tmp_path / "a.safetensors"):
        with pytest.warns(
            UserWarning, match=rf"head near_zero is left out: {__name__}:Grasp is of"
        ):
            assert list(tactileforge.load(made).heads) == ["pixel"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # the head of an objective is given with it
        found = tactileforge.load(tmp_path, classes={f"{__name__}:NearZero": NearZero})
    assert isinstance(found.heads["near_zero"], Grasp)
    local._known.clear()
    more = {"max_steps": 3}
    run = tactileforge.train(
        resume=tmp_path, classes={f"{__name__}:NearZero": NearZero}, trainer=more
    )
    assert run.module.global_step == 3


def test_the_verbs_take_classes_as_load_does() -> None:
    local._known.clear()
    own = {"mine:Grasp": Grasp, "./net.py:NearZero": NearZero}
    assert _typed(["seed=1"], {"classes": own, "out": "x"}) == ["seed=1", "out=x"]
    assert [local.find(name) for name in own] == [Grasp, NearZero]
    # options of the bench, and a word of the command line
    assert _typed([], {"classes": {"root": "a b"}}) == ["classes.root='a b'"]
    assert _typed([f"code={__name__}:NearZero"], {}) == []
    with pytest.raises(PluginError, match="code=no_such:Thing: there is no module"):
        _typed([], {"code": ["no_such:Thing"]})
