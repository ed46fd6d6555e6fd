"""Unread keys are errors with the nearest known one, wherever they were written."""

import shlex
from pathlib import Path

import pytest

from tactileforge import cli
from tactileforge.cli._compose import compose
from tactileforge.cli._known import message
from tactileforge.errors import ConfigError


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("+optimizer.lr=1e-5", "unknown key 'optimizer.lr'; did you mean 'optim.lr'?"),
        ("+optimiser={lr: 1e-5}", "unknown key 'optimiser.lr'; did you mean 'optim.lr'?"),
        ("+lr=1e-5", "unknown key 'lr'; did you mean 'optim.lr'?"),
        ("++foo.bar=2", "unknown key 'foo.bar'"),
        ("+foo=1", "unknown key 'foo'"),
        ("+encodr.size=tiny", "did you mean 'encoder.size'?"),
        ("+batch_size=4", "did you mean 'batch'?"),
        ("+sensor=camera", "unknown key 'sensor"),
        ("+balance.foo=1", "Known in balance: alpha, bound, every, keep"),
        ("+logger.projct=a", "did you mean 'logger.project'?"),
        ("+augment.chance.rotat=.2", "did you mean 'augment.chance.rotate'?"),
        ("+batch.shares.forc=.2", "did you mean 'batch.shares.force'?"),
        ("+facts.actions=3", "unknown key 'facts.actions'"),
        ("+seed.foo=1", "unknown key 'seed.foo'"),
        ("+objective.pixel.wieght=2", "did you mean 'objective.pixel.weight'?"),
        ("+head.pixel.wdth=2", "did you mean 'head.pixel.width'?"),
        ("+text_encoder.wdth=2", "did you mean 'text_encoder.width'?"),
        ("+image_encoder.dept=2", "did you mean 'image_encoder.depth'?"),
        ("+callbacks.early_stopping.patience=3", "callbacks=[early_stopping] chooses it"),
        ("objective.surface.weight=2", "nothing reads objective.surface.weight: objective 'surf"),
        ("++head.jepa.width=2", "nothing reads head.jepa.width: objective 'jepa' is not chosen"),
    ],
)
def test_a_key_that_training_does_not_read(override, said):
    with pytest.raises(ConfigError) as error:
        compose("anytouch2", ["scale=demo", override])
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["scale=finetune", "debug=overfit", "ablation=[no_diff,no_force]"],
        ["+weight=0.3", "objective.pixel.weight=${weight}"],
        ["objective=[pixel,dino]", "objective.dino.weight=2", "+head.dino.hidden=32"],
        ["+objective@objective.again=diff", "objective.again.weight=0.5"],
        ["+curriculum.objective.pixel={start: 0.2, end: 0.5}", "augment=null"],
        ["balance=gradnorm", "logger=wandb", "logger.project=mine"],
    ],
    ids=" ".join,
)
def test_what_is_read_stays(overrides):
    assert compose("anytouch2", overrides).objective.pixel.name == "pixel"


@pytest.mark.slow
def test_a_key_in_a_recipe_of_ones_own(capsys):
    Path("mine/recipe").mkdir(parents=True)
    for row, said in {
        "optimizer: {lr: 1}": "did you mean 'optim.lr'?",
        "objective: {pixel: {wieght: 1}}": "did you mean 'objective.pixel.weight'?",
        "callbakcs: {ema: {_target_: nonsense.Nope}}": "unknown key 'callbakcs.ema._target_'",
    }.items():
        text = f"# @package _global_\ndefaults: [anytouch2, _self_]\n{row}\n"
        Path("mine/recipe/soft.yaml").write_text(text)
        words = ["train", "--config-dir", "mine", "recipe=soft", "scale=demo"]
        assert cli.run(words) == 1
        err = capsys.readouterr().err
        assert said in err
        assert err.count("\n") == 1
        assert cli.run([*words, "--cfg", "job"]) == 1
        assert said in capsys.readouterr().err
    assert not [*Path("runs").rglob("*.yaml")], "no run was started"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("data pack data=sim out=o +foo=1", "unknown key 'foo'. Known: data, out, pack"),
        ("data pack data=sim out=o +pack.sise=9", "did you mean 'size'?"),
        ("data pack data=sim out=o trainer.max_steps=9", "unknown key 'trainer.max_steps'"),
        ("data pack data=sim out=o +data.sise=9", "did you mean 'size'?"),
        ("data inspect data=sim +optimizer.lr=1", "unknown key 'optimizer.lr'"),
        ("bench model=[pixels] +modle=[hog]", "did you mean 'model'?"),
        ("bench model=[pixels] +probe.epoch=1", "did you mean 'epochs'?"),
        ("record sensor=sim out=o ++secnds=3", "did you mean 'seconds'?"),
        ("record sensor=sim out=o +sensor.sim.sieed=3", "did you mean 'seed'?"),
        ("live sensor=sim +foo.bar=3", "unknown key 'foo.bar'"),
        ("calibrate data=sim out=c.yaml +unti=a", "did you mean 'unit'?"),
        ("sim out=o +sise=9", "did you mean 'size'?"),
        ("export model=x +fromat=onnx", "did you mean 'format'?"),
    ],
)
def test_a_key_that_another_verb_does_not_read(line, said, capsys):
    assert cli.run(shlex.split(line)) == 1
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not any(Path().iterdir()), "nothing was begun"


def test_a_suite_of_ones_own_with_an_unknown_block(capsys):
    Path("mine/suite").mkdir(parents=True)
    text = "# @package _global_\nsuites: {s: S}\ntasks: {}\nshared: {a: 1}\n"
    Path("mine/suite/s.yaml").write_text(text)
    assert cli.run(["bench", "--config-dir", "mine", "suite=s", "model=[pixels]"]) == 1
    assert "unknown key 'shared.a'" in capsys.readouterr().err


def test_the_nearest_has_the_same_last_word_where_there_is_one():
    known = ["optim", "optim.lr", "probe", "probe.lr", "seed"]
    assert message("optimizer.lr", known).startswith(
        "unknown key 'optimizer.lr'; did you mean 'optim.lr'?"
    )
    assert "did you mean 'seed'?" in message("sede", known)
    assert "did you mean" not in message("foo", known)
