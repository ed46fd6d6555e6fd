"""Our groups in other people's Hydra, and other people's Hydra beside ours."""

import re
import subprocess
import sys

import hydra
import pytest
from hydra.core.global_hydra import GlobalHydra
from hydra.version import VersionBase

import tactileforge
from tactileforge.errors import ConfigError
from tactileforge.training import build_data

APP = """\
defaults:
  - recipe: mae
  - optim: adamw
  - _self_
mine: 1
"""


@pytest.fixture
def conf(tmp_path):
    (tmp_path / "conf").mkdir()
    (tmp_path / "conf/app.yaml").write_text(APP)
    return tmp_path / "conf"


def test_plain_hydra_finds_our_groups_and_plugins_behind_its_own(conf):
    (conf / "optim").mkdir()
    (conf / "optim/adamw.yaml").write_text("lr: 9\nclip: 1\n")
    with hydra.initialize_config_dir(str(conf), version_base="1.3"):
        config = hydra.compose("app", ["+data=recordings", "data.root=x", "objective=[force]"])
    assert config.mine == 1
    assert "warmup" not in config.optim, "the application's own comes first"
    assert (config.encoder.name, list(config.objective)) == ("plain_vit", ["force"])
    assert config.data.name == "recordings"  # an entry point, without a YAML


def test_our_own_training_configuration_by_plain_hydra():
    with hydra.initialize_config_module("tactileforge.conf", version_base="1.3"):
        config = hydra.compose("train", ["scale=demo"])
    assert config.encoder.size == "tiny"


def test_compose_leaves_the_hydra_of_the_caller_alone(conf):
    with hydra.initialize_config_dir(str(conf), version_base="1.2"):
        caller, inner = GlobalHydra.instance(), GlobalHydra.instance().hydra
        assert tactileforge.compose("anytouch2", ["scale=demo"]).encoder.size == "tiny"
        with pytest.raises(Exception, match="optimizer"):
            tactileforge.compose("anytouch2", ["+optimizer.lr=1"])
        assert GlobalHydra.instance() is caller
        assert caller.hydra is inner
        assert str(VersionBase.instance().getbase()) == "1.2"
        assert hydra.compose("app").mine == 1
    assert not GlobalHydra.instance().is_initialized()


def test_a_key_of_the_application_that_is_nearly_a_group_is_named(conf, caplog):
    with hydra.initialize_config_dir(str(conf), version_base="1.3"):
        words = ["+encodr.size=3", "+data=recordings", "data.root=x", "objective=[force]"]
        config = hydra.compose("app", words)
    with caplog.at_level("WARNING", "tactileforge"):
        tactileforge.compose(config)
    assert "encodr= is left to your application; for training it is encoder=" in caplog.text
    assert "mine=" not in caplog.text


@pytest.mark.slow
def test_a_configuration_of_plain_hydra_is_completed(conf, tmp_path):
    (conf / "app.yaml").write_text(APP + "seed: ${mine}\n")
    words = ["+data=sim", "data.scenes=3", "objective=[diff]", "scale=demo"]
    with hydra.initialize_config_dir(str(conf), version_base="1.3"):
        config = hydra.compose("app", words)
        train = hydra.compose("train", ["objective=[diff]", "scale=demo"])
    with pytest.raises(
        ConfigError, match=r"no head\.diff.*config = tactileforge\.compose\(config\)"
    ):
        build_data(config)
    done = tactileforge.compose(config)
    assert (done.seed, done.encoder.name, done.data.scenes) == (1, "plain_vit", 3)
    assert (list(done.objective), list(done.head)) == (["diff"], ["diff"])
    assert (done.data.max_bad, done.augment.rotate, "mine" in done) == (0.01, 0.0, False)
    assert config.mine == 1, "that of the application is as it was"
    own = tactileforge.compose("anytouch2", words[2:])
    assert {key: value for key, value in tactileforge.compose(train).items() if key in own} == own
    from tactileforge.training.parts import is_finished

    assert (is_finished(config), is_finished(done)) == (False, True), "train completes it too"
    with pytest.raises(ConfigError, match=r"seed=2: a configuration is given"):
        tactileforge.compose(config, ["seed=2"])


@pytest.mark.parametrize(
    "defaults",
    [
        "[{recipe: mae}, {override scale: tiny}, _self_]",
        "[{optim: adamw}, {recipe: mae}, {override scale: tiny}, _self_]",
    ],
)
def test_what_a_recipe_alone_says_of_a_group_is_completed(conf, defaults):
    (conf / "app.yaml").write_text(f"defaults: {defaults}\n")
    with hydra.initialize_config_dir(str(conf), version_base="1.3"):
        config = hydra.compose("app", ["+data=sim", "objective=[pixel]"])
    done = tactileforge.compose(config)
    own = tactileforge.compose("mae", ["scale=tiny", "data=sim", "objective=[pixel]"])
    for group in ("trainer", "optim", "encoder", "batch", "curriculum"):
        assert done[group] == own[group], group
    assert (done.optim.lr, done.optim.schedule, done.trainer.precision) == (1e-3, "linear", "auto")


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("+trainer.max_step=1", "unknown key of trainer 'max_step'; did you mean 'max_steps'"),
        ("+trainer.foo=1", "unknown key of trainer 'foo'"),
        ("+encoder.siz=tiny", "'siz'; did you mean 'size'"),
        ("+data.scens=1", "unknown option of dataset 'sim' 'scens'; did you mean 'scenes'"),
        ("+batch.sise=1", "unknown key of batch 'sise'; did you mean 'size'"),
        ("+optim.wamup=1", "'wamup'; did you mean 'warmup'"),
        ("+curriculum.unti=step", "'unti'; did you mean 'unit'"),
    ],
)
def test_a_key_that_nothing_reads_is_told_from_python_too(word, told):
    with pytest.raises(ConfigError, match=re.escape(told)):
        tactileforge.compose("anytouch2", [word])


def test_words_in_place_of_a_recipe_are_told():
    with pytest.raises(
        ConfigError, match=r"give a name, then the words: compose\('mae', \[\.\.\.\]\)"
    ):
        tactileforge.compose(["seed=1"])


@pytest.mark.slow
def test_another_application_has_them_on_its_command_line(conf):
    app = conf.parent / "app.py"
    app.write_text(
        "import hydra, tactileforge\n"
        "@hydra.main(version_base='1.3', config_path='conf', config_name='app')\n"
        "def main(config):\n"
        "    print(config.encoder.name, list(config.objective), config.mine)\n"
        "    optim = tactileforge.compose(config).optim\n"
        "    print(optim.name, optim.lr, optim.momentum)\n"
        "main()\n"
    )
    command = [sys.executable, str(app), "encoder=tactile_vit", "objective=[pixel,diff]"]
    command += ["optim=sgd", "optim.momentum=0.9"]
    done = subprocess.run(command, cwd=conf.parent, capture_output=True, text=True)
    # the learning rate of the recipe is for the recipe's optimizer
    lines = ["tactile_vit ['pixel', 'diff'] 1", "sgd 0.001 0.9"]
    assert done.stdout.splitlines() == lines, done.stderr
