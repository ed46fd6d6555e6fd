"""Verbs from Python: arguments of the command line in, objects out."""

import sys
from pathlib import Path

import pytest
import torch
from made_files import make_files

import tactileforge
from tactileforge.cli._verbs import Actions
from tactileforge.encoders import TactileViT
from tactileforge.errors import ConfigError
from tactileforge.pages import Shown
from tactileforge.plugins import registry
from tactileforge.verbs import words

SMALL = ["scale=tiny", "debug=steps", "batch.size=2", "encoder.image_size=32", "encoder.depth=1"]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


class Mine:
    """A class of the user's."""


@pytest.mark.parametrize(
    ("overrides", "keys", "made"),
    [
        (["seed=1", "data.root=a b"], {}, ["seed=1", "data.root='a b'"]),
        ([], {"recipe": "mae", "seed": 3}, ["recipe=mae", "seed=3"]),
        ([], {"objective": ["pixel", "diff"]}, ["objective=[pixel,diff]"]),
        ([], {"optim": {"lr": 1e-3, "betas": [0, 1]}}, ["optim.lr=0.001", "optim.betas=[0,1]"]),
        ([], {"data": {"name": "shards", "root": Path("a b")}}, ["data=shards", "data.root='a b'"]),
        ([], {"init": None, "freeze": True}, ["init=null", "freeze=true"]),
        ([], {"data.root": "~x,y"}, ["data.root='~x,y'"]),
        ([], {"resume": tactileforge.Run("runs/a")}, ["resume='runs/a'"]),
        ([], {"objective": [Mine]}, [f"objective=[{__name__}:Mine]"]),
    ],
)  # fmt: skip
def test_keywords_are_the_words_of_the_command_line(overrides, keys, made):
    assert words(overrides, keys) == made


@pytest.mark.slow
def test_a_run_has_its_numbers_its_report_and_its_model():
    make_files("DIR", Path())
    run = tactileforge.train(
        *SMALL, objective=["pixel"], data={"name": "recordings", "root": Path("DIR"), "val": 0.3}
    )
    assert run.folder.parent == Path("runs/anytouch2")
    assert run.report.is_file()
    assert run.metrics["train/pixel"] > 0
    assert run.config["objective"]["pixel"]["name"] == "pixel"
    assert run.module is not None
    assert run.module.global_step == 2
    assert run.model().encode is not None
    assert "<iframe srcdoc=" in run._repr_html_()
    assert tactileforge.Run(run.folder).metrics == run.metrics
    # goes on in its folder, and there alone
    longer = tactileforge.train(resume=run, trainer={"max_steps": 3})
    assert (longer.folder.resolve(), longer.module.global_step) == (run.folder.resolve(), 3)
    own = tactileforge.Run(run.folder).config
    own = own | {"resume": str(run.folder), "trainer": own["trainer"] | {"max_steps": 4}}
    assert tactileforge.train(own).module.global_step == 4
    with pytest.raises(ConfigError, match="goes on with its own configuration"):
        tactileforge.train(tactileforge.compose("anytouch2", [f"resume={run.folder}"]))


@pytest.mark.slow
def test_an_encoder_is_passed_as_an_instance():
    """Its run has a copy of it, and starts at its weights."""
    make_files("DIR", Path())
    own = TactileViT(size="tiny", depth=1, image_size=32)
    before = {name: value.clone() for name, value in own.state_dict().items()}
    run = tactileforge.train(
        "scale=tiny", "debug=steps", "batch.size=2", "optim.lr=0", encoder=own, objective=["pixel"],
        data={"name": "recordings", "root": Path("DIR"), "val": 0.3},
    )  # fmt: skip
    trained = run.module.encoder
    assert isinstance(trained, TactileViT)
    assert trained is not own
    for name, value in own.state_dict().items():
        torch.testing.assert_close(value, before[name], rtol=0, atol=0)
        torch.testing.assert_close(trained.state_dict()[name], value, rtol=0, atol=0)


def test_packing_gives_a_data_set_for_training():
    make_files("DIR", Path())
    packed = tactileforge.pack(data={"name": "recordings", "root": Path("DIR")}, out="shards")
    assert [row["split"] for row in packed.rows] == ["train", "val"]
    assert packed.rows[0]["recordings"] > 0
    assert "<table>" in packed._repr_html_()
    found = registry.build("datasets", {"name": "shards", "root": str(Path(packed))})
    assert len(list(found.recordings("train"))) == packed.rows[0]["recordings"]


@pytest.mark.slow
def test_inspection_gives_its_page_and_findings():
    make_files("DIR", Path())
    shown = tactileforge.inspect(data={"name": "recordings", "root": Path("DIR")}, out="a.html")
    assert shown.page == Path("a.html")
    assert "recordings" in str(shown.value)
    assert shown._repr_html_().startswith("<iframe srcdoc=")


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: tactileforge.train("+optimizer.lr=1"), "did you mean 'optim.lr'?"),
        (lambda: tactileforge.train(optimizer={"lr": 1}), "did you mean 'optim.lr'?"),
        (lambda: tactileforge.train(recipe="anytuch2"), "did you mean 'anytouch2'?"),
        (lambda: tactileforge.train("scale"), "'scale': give 'key=value'"),
        (lambda: tactileforge.train({"a": 1}, seed=1), "takes no overrides"),
        (lambda: tactileforge.pack(data="sim"), "give out=..."),
        (lambda: tactileforge.pack(data="sim", out="o", foo=1), "unknown key 'foo'"),
        (lambda: tactileforge.bench(modle=["pixels"]), "did you mean 'model'?"),
    ],
)
def test_a_slip_is_a_line(call, said):
    with pytest.raises(ConfigError) as error:
        call()
    assert said in str(error.value)
    assert "\n" not in str(error.value)
    assert not any(Path().iterdir())


@pytest.mark.parametrize(
    ("verb", "package"),
    [
        ("bench", "tactileforge-bench"),
        ("inspect", "tactileforge-inspect"),
        ("simulate", "tactileforge-sim"),
        ("calibrate", "tactileforge-live"),
    ],
)
def test_without_its_package_a_verb_says_how_to_get_it(verb, package, monkeypatch):
    monkeypatch.setattr(registry, "names", lambda kind: [])
    monkeypatch.setattr(Actions, "added", {})
    with pytest.raises(
        ConfigError, match=rf"comes with {package}: pip install .*plugins/{package}"
    ):
        getattr(tactileforge, verb)()


def test_a_result_is_a_path_and_escapes_what_it_shows(tmp_path):
    shown = Shown(Path("<a>"), rows=[{"name": "<b>", "value": 0.123456}])
    assert Path(shown) == Path("<a>")
    assert "&lt;b&gt;" in shown._repr_html_()
    assert "<b>" not in shown._repr_html_()
    assert "0.1235" in str(shown)


def test_the_names_are_lazy():
    import subprocess

    code = (
        "import sys, tactileforge; assert 'train' in dir(tactileforge); "
        "sys.exit('torch' in sys.modules or 'hydra' in sys.modules or 'numpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
