"""Lightning as people know it: callbacks, optimizers, the module and data in code of their own."""

import errno
import inspect
import math
import re

import lightning as L
import pytest
import torch
from hydra.errors import HydraException
from lightning.pytorch.callbacks import Callback, EarlyStopping, ModelCheckpoint
from omegaconf import OmegaConf

from tactileforge import api, compose
from tactileforge.cli._explain import explain
from tactileforge.encoders import ConvBackbone
from tactileforge.encoders.tactile_cnn import DIFFERENCE
from tactileforge.errors import ConfigError, PluginError, TactileForgeError
from tactileforge.objectives import Pixel
from tactileforge.pages.curves import read_metrics
from tactileforge.plugins import local, registry
from tactileforge.runs.checkpoint_file import read_checkpoint
from tactileforge.runs.folder import LAST
from tactileforge.training import TouchModule, build_data, callbacks, schedules
from tactileforge.training.assemble import limit_of
from tactileforge.training.optim import build_optimizer, parse_optim
from tactileforge.training.parts import check_encoder
from tactileforge.training.trainer import build_trainer, check_options, is_time_over
from tactileforge.verbs import words

WORDS = [
    "scale=demo",
    "encoder.image_size=32",
    "batch.size=8",
    "batch.workers=0",
    "objective=[pixel]",
]
WORDS += ["data.scenes=3", "data.val=1", "data.size=32", "trainer.max_steps=3"]
WORDS += ["trainer.log_every_n_steps=1"]
#: Lightning's own, with this torch.
OF_LIGHTNING = "ignore:.*LeafSpec.*:FutureWarning"


class Counts(Callback):
    """Counts steps, and fails at one of them."""

    def __init__(self, word: str = "step", fail_at: int = -1) -> None:
        self.word, self.fail_at, self.seen = word, fail_at, []

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx):
        self.seen.append(trainer.global_step)
        if trainer.global_step == self.fail_at:
            raise RuntimeError("a callback that fails")


@pytest.fixture(scope="module")
def parts():
    """Configuration, data and encoder of a small run."""
    config = compose("anytouch2", WORDS)
    data, encoder = build_data(config)
    return {**config, "encoder": encoder}, data


def _module(parts):
    torch.manual_seed(0)
    return TouchModule.from_config(parts[0], parts[1].summary("train").labels, parts[1].augment)


@pytest.mark.slow
def test_callbacks_by_name_with_their_options(tmp_path):
    words = ["callbacks=[early_stopping,weight_averaging,lr_monitor,probe]"]
    words += ["callbacks.early_stopping.patience=1", "callbacks.early_stopping.min_delta=100"]
    words += ["callbacks.weight_averaging.decay=0.5", "callbacks.probe.target=force"]
    words += ["trainer.max_steps=40", "trainer.val_check_interval=1"]
    module = api.train(compose("anytouch2", [*WORDS, *words]), tmp_path)
    assert module.trainer.global_step == 2  # validated twice, no better by 100
    found = {type(one) for one in module.trainer.callbacks}
    assert {callbacks.WeightAveraging, callbacks.EarlyStopping} <= found
    curves = read_metrics(tmp_path)
    assert math.isfinite(curves["val/probe_force"].values[-1])


@pytest.mark.slow
def test_averaged_weights_are_those_that_the_run_ends_with(tmp_path):
    """The mean of the weights of steps 0 to 3, by a decay of a half."""

    class Keep(Callback):
        seen = ()

        def on_train_batch_end(self, trainer, pl_module, *rest):
            self.seen += (pl_module.encoder.transformer.blocks[0].norm1.weight.detach().clone(),)

    from tactileforge.plugins import register

    register("callbacks", "keep_norms", Keep)
    words = ["callbacks=[weight_averaging,keep_norms]", "callbacks.weight_averaging.decay=0.5"]
    module = api.train(compose("anytouch2", [*WORDS, *words]), tmp_path)
    keep = next(one for one in module.trainer.callbacks if isinstance(one, Keep))
    mean = keep.seen[0]
    for weight in keep.seen[1:]:
        mean = 0.5 * mean + 0.5 * weight
    torch.testing.assert_close(module.encoder.transformer.blocks[0].norm1.weight.detach(), mean)


@pytest.mark.slow
def test_a_run_is_saved_before_the_error_of_a_callback(tmp_path):
    from tactileforge.plugins import register

    register("callbacks", "counts_steps", Counts)
    words = ["callbacks=[counts_steps]", "callbacks.counts_steps.fail_at=2"]
    with pytest.raises(RuntimeError, match="a callback that fails"):
        api.train(compose("anytouch2", [*WORDS, *words]), tmp_path)
    state = torch.load(tmp_path / LAST, weights_only=True)
    assert state["global_step"] == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["callbacks=[early_stoping]"], "early_stopping"),
        (["callbacks=[early_stopping]", "+callbacks.early_stopping.patients=3"], "patience"),
        (["callbacks=[early_stopping]", "callbacks.early_stopping.mode=down"], "mode"),
        (["callbacks=[no_module:Callback]"], "no_module"),
        (["optim=sgd", "+optim.momentun=.9"], "momentum"),
        (["optim=sgd", "optim.lr=-1"], "learning rate"),
        (["optim.schedule=cosin"], "cosine"),
        (["optim.schedule=torch.optim.lr_scheduler:CosineAnnealingLR"], "is a class; give a func"),
        (["optim.schedule=math:sqrt"], "math:sqrt: .*give a function of the step"),
        (["optim.layer_decay=2"], "optim.layer_decay=2.0: give above 0"),
        (["optim.rates={encoder: 0}"], "optim.rates.encoder=0.0: give a factor"),
        (["+trainer.enable_checkpointing=false"], "save_every"),
        (["+trainer.callbacks=[x]"], "callbacks="),
        (["+trainer.logger=false"], "logger="),
        (["+trainer.fast_dev_run=true"], "debug=steps"),
        (["trainer.max_time=soon"], "00:23:30:00"),
        (["+trainer.max_setps=3"], "max_steps"),
    ],
)
def test_a_slip_is_named_before_data_is_read(words, message, tmp_path):
    own = [word for word in WORDS if not word.startswith("data.")]
    own += ["data=shards", "data.root=/nowhere", *words]

    def run():
        api.train(compose("anytouch2", own), tmp_path)

    with pytest.raises((ConfigError, PluginError, HydraException), match=message):
        run()


class Steps(torch.optim.Optimizer):
    """Steps of one size along the sign of the gradient."""

    def __init__(self, params, lr=1e-3, momentum: float = 0.9) -> None:
        super().__init__(params, {"lr": lr, "momentum": momentum})

    def step(self, closure=None):
        loss = closure() if closure else None
        with torch.no_grad():
            for group in self.param_groups:
                for one in group["params"]:
                    if one.grad is not None:
                        one -= group["lr"] * one.grad.sign()
        return loss


@pytest.mark.parametrize("word", [f"optim={__name__}:Steps", "optim=torch.optim:SGD"])
def test_an_optimizer_of_ones_own_has_its_options_without_the_parameters(word):
    optim = compose("anytouch2", [*WORDS, word, "optim.momentum=0.5"])["optim"]
    assert optim["momentum"] == 0.5
    assert optim["lr"] == 1e-3
    assert not {"params", "fused", "betas"} & {*optim}
    made, _ = parse_optim(optim)
    weight = torch.nn.Parameter(torch.zeros(2, 2))
    weight.grad = torch.tensor([[1.0, -2.0], [3.0, -4.0]])
    made.build([("weight", weight)], False).step()
    wanted = torch.tensor([[1.0, -1.0], [1.0, -1.0]]) if "Steps" in word else weight.grad
    torch.testing.assert_close(weight.detach(), -1e-3 * wanted)


@pytest.mark.slow
def test_the_learning_rate_of_a_recipe_is_not_for_another_optimizer():
    own = f"optim={__name__}:Steps"
    rate = {
        tuple(more): compose("mae", ["scale=finetune", *more])["optim"]["lr"]
        for more in ([], ["optim=adamw"], [own], [own, "optim.lr=0.2"], ["optim=sgd"])
    }
    assert [*rate.values()] == [5e-4, 5e-4, 1e-3, 0.2, 1e-3]
    # without a default of its own it has the recipe's; what is common to all stays
    optim = compose("mae", [f"optim={__name__}:Wants", "optim.warmup=0.5"])["optim"]
    assert (optim["lr"], optim["momentum"], optim["warmup"]) == (1e-4, 0.5, 0.5)
    assert optim["schedule"] == compose("mae", [])["optim"]["schedule"]
    assert optim["betas"] == [0.9, 0.99]
    text = explain("train", "optim.momentum", [f"optim={__name__}:Wants"])
    assert text.startswith("optim.momentum = 0.5\n")
    text = explain("train", "optim.lr", ["recipe=mae", own])
    assert text.startswith("optim.lr = 0.001\n")
    assert re.search(rf"\n  recipe/mae.yaml +0.0001\n  {own}, its own default  0.001\n", text)
    text = explain("train", "optim.lr", ["recipe=mae", own, "optim.lr=0.2"])
    assert re.search(r"^optim.lr = 0.2\n(.|\n)*  command line +0.2\n", text)
    assert text.index("own default") < text.index("recipe/mae.yaml") < text.index("command line")


class Deaf(Steps):
    def step(self, closure=None):
        return None


def test_an_optimizer_that_computes_no_loss_is_told_before_data_is_read():
    optim = compose("anytouch2", [*WORDS, f"optim={__name__}:Deaf"])["optim"]
    with pytest.raises(
        ConfigError, match=r"Deaf.step\(closure\) never calls its closure.*begin it"
    ):
        parse_optim(optim)
    parse_optim(compose("anytouch2", [*WORDS, f"optim={__name__}:Steps"])["optim"])


class Wants(Steps):
    """One without a default learning rate."""

    def __init__(self, params, lr: float, momentum: float = 0.5, betas=(0.9, 0.99)) -> None:
        super().__init__(params, lr, momentum)


@pytest.mark.parametrize("word", ["_target_: torch.optim.SGD", "name: 'torch.optim:SGD'"])
def test_a_class_in_yaml_leaves_out_what_the_recipe_gave_another(word, tmp_path):
    (tmp_path / "recipe").mkdir()
    text = f"# @package _global_\ndefaults: [mae, _self_]\noptim: {{{word}, lr: 0.01}}\n"
    (tmp_path / "recipe/steady.yaml").write_text(text)
    optim = compose("steady", [f"hydra.searchpath=[{tmp_path}]", *WORDS])["optim"]
    assert (optim["name"], optim["lr"]) == ("torch.optim:SGD", 0.01)
    assert not {"betas", "weight_decay"} & optim.keys()  # SGD has a decay of its own, 0
    assert optim["warmup"] == compose("mae", WORDS)["optim"]["warmup"]
    parse_optim(optim)


def test_a_class_in_yaml_has_what_yaml_and_words_give_it(tmp_path):
    def optim(text: str, *words: str):
        (tmp_path / "recipe").mkdir(exist_ok=True)
        head = "# @package _global_\ndefaults: [mae, _self_]\noptim: "
        (tmp_path / "recipe/steady.yaml").write_text(head + text)
        later = "# @package _global_\ndefaults: [steady, _self_]\noptim: {momentum: 0.7}\n"
        (tmp_path / "recipe/later.yaml").write_text(later)
        return compose("later", [f"hydra.searchpath=[{tmp_path}]", *WORDS, *words])["optim"]

    own = f"{{name: '{__name__}:Wants', betas: [0.5, 0.6]}}\n"
    found = optim(own)
    assert (found["betas"], found["momentum"]) == ([0.5, 0.6], 0.7)
    assert found["lr"] == compose("mae", WORDS)["optim"]["lr"], "the class has none of its own"
    found = optim(f"{{name: '{__name__}:Wants'}}\n", "optim.betas=[0.1,0.2]")
    assert found["betas"] == [0.1, 0.2]
    assert "betas" not in optim(f"{{name: '{__name__}:Wants'}}\n")


def test_a_callback_with_a_device_for_a_default_is_chosen():
    name = "lightning.pytorch.callbacks:StochasticWeightAveraging"
    words = [f"callbacks=[{name}]", "callbacks.stochastic_weight_averaging.swa_lrs=0.1"]
    node = compose("anytouch2", [*WORDS, *words])["callbacks"]["stochastic_weight_averaging"]
    assert node["swa_lrs"] == 0.1
    assert "device" not in node


def test_finished_instances_from_python_are_used_as_they_are():
    callback = Counts("seven")
    (word,) = words([], {"callbacks": [callback]})
    assert word == f"callbacks=[{__name__}:Counts]"
    config = compose("anytouch2", [*WORDS, word])
    (node,) = config["callbacks"].values()
    assert registry.build("callbacks", node).word == "seven"
    (word,) = words([], {"callbacks": [Counts]})  # the class again
    (node,) = compose("anytouch2", [*WORDS, word])["callbacks"].values()
    assert registry.build("callbacks", node).word == "step"


@pytest.mark.slow
def test_a_checkpoint_with_a_class_of_ones_own_takes_it(tmp_path):
    api.train(compose("anytouch2", [*WORDS, f"objective=[{__name__}:Own]"]), tmp_path)
    local._known.clear()  # another process
    with pytest.raises(PluginError, match="classes="):
        TouchModule.load_from_checkpoint(tmp_path / LAST)
    given = {f"{__name__}:Own": Own}
    again = TouchModule.load_from_checkpoint(tmp_path / LAST, classes=given)
    assert isinstance(again.objectives["own"], Own)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("lightning.pytorch.callbacks:EarlyStopping", True),
        ("torch.optim:SGD", True),
        ("torch.optim:sgd", False),  # a module
        ("torch.hub:load", False),
        ("os:system", False),
    ],
)
def test_a_file_may_name_callbacks_of_lightning_and_optimizers_of_torch(name, given):
    assert local.is_given(name) is given


class Narrow(torch.nn.Module):
    """A head in place of that of `pixel`, with fewer options."""

    def __init__(self, encoder, width: int = 8) -> None:
        super().__init__()
        self.layer = torch.nn.Linear(encoder.projected, width)

    def forward(self, views, batch):
        return self.layer(views.full.cls)


def test_a_head_of_ones_own_in_the_place_of_a_usual_one():
    word = f"head.pixel.name={__name__}:Narrow"
    head = compose("mae", [*WORDS, "objective=[pixel]", word, "head.pixel.width=4"])["head"]
    assert head == {"pixel": {"name": f"{__name__}:Narrow", "width": 4}}
    with pytest.raises(ConfigError, match=r"head\.pixel\.depth"):
        compose("mae", [*WORDS, "objective=[pixel]", word, "head.pixel.depth=3"])


class Own(Pixel):
    """An objective of one's own."""


class Plain(torch.nn.Module):
    """A network, and no encoder of touch."""

    def __init__(self, width: int = 4) -> None:
        super().__init__()
        self.layer = torch.nn.Linear(width, width)

    def forward(self, frames, background, sensor):
        return self.layer(frames)


def test_a_network_that_is_no_encoder_says_what_it_lacks(tmp_path):
    own = [word for word in WORDS if not word.startswith("encoder.")]
    config = compose("anytouch2", [*own, f"encoder={__name__}:Plain"])
    with pytest.raises(
        ConfigError, match=r"Plain has no frames, no image_size, .*: derive it from Backbone"
    ):
        api.train(config, tmp_path)


class Taken(ConvBackbone):
    def __init__(self, frames=2, image_size=32, sensors=None, mask_ratio=0.75, spacing=0.1):
        super().__init__(8, frames, image_size, 8, sensors, mask_ratio, spacing, DIFFERENCE)
        self.projected, self.project = 8, torch.nn.Linear(8, 8)
        self.tube = torch.nn.Linear(2, 2)

    def map(self, pictures):
        return pictures.mean(1, keepdim=True).expand(-1, 8, -1, -1)[..., ::8, ::8]


def test_a_name_that_the_framework_reads_is_not_free():
    encoder = Taken()
    with pytest.raises(ConfigError, match="tube is of type Linear, and a name that"):
        check_encoder(encoder, "mine:Taken")
    del encoder.tube
    encoder.tube = 1
    check_encoder(encoder, "mine:Taken")


@pytest.mark.slow
@pytest.mark.parametrize(("key", "value"), [("num_sanity_val_steps", 1), ("detect_anomaly", True)])
def test_other_arguments_of_the_trainer_reach_it(key, value, tmp_path):
    module = api.train(compose("anytouch2", [*WORDS, f"+trainer.{key}={value}"]), tmp_path)
    reached = getattr(module.trainer, key, None) or getattr(module.trainer, f"_{key}", None)
    assert reached == value


@pytest.fixture(scope="module")
def config():
    """Configuration of a small run."""
    return _plain(WORDS)


#: A value for each argument of Lightning's trainer that is not its default; None: it is refused.
ARGUMENTS = {
    **dict.fromkeys(["barebones", "callbacks", "default_root_dir", "enable_checkpointing"]),
    **dict.fromkeys(["enable_progress_bar", "fast_dev_run", "gradient_clip_val", "logger"]),
    **dict.fromkeys(["limit_predict_batches", "limit_test_batches", "overfit_batches", "plugins"]),
    **dict.fromkeys(["reload_dataloaders_every_n_epochs", "use_distributed_sampler"]),
    **{"accelerator": "cpu", "strategy": "ddp", "devices": 2, "num_nodes": 2},
    **{"precision": "bf16-mixed", "max_epochs": 7, "min_epochs": 2, "max_steps": 9, "min_steps": 3},
    **{"max_time": "00:01:00:00", "limit_train_batches": 4, "limit_val_batches": 3},
    **{"val_check_interval": 5, "check_val_every_n_epoch": 3, "num_sanity_val_steps": 1},
    **{"log_every_n_steps": 6, "enable_model_summary": True, "accumulate_grad_batches": 2},
    **{"gradient_clip_algorithm": "value", "deterministic": False, "benchmark": True},
    **{"inference_mode": False, "profiler": "simple", "detect_anomaly": True},
    **{"sync_batchnorm": True, "enable_autolog_hparams": False, "model_registry": "mine"},
}
#: Those that the run itself reads, or puts something of its own in place of.
READ_BY_THE_RUN = {"strategy", "max_time", "limit_train_batches"}


@pytest.mark.filterwarnings("ignore:.*deterministic:UserWarning")
@pytest.mark.parametrize("key", inspect.signature(L.Trainer).parameters)
def test_every_argument_of_the_trainer_reaches_it_or_is_refused(key, config, tmp_path, monkeypatch):
    value, seen = ARGUMENTS[key], {}  # a KeyError: Lightning has a new one, to be decided on
    usual = {**config["trainer"], "precision": "32-true"}  # which a run finds by measuring
    given = {**config, "trainer": {**usual, key: True if value is None else value}}
    if value is None:
        with pytest.raises(ConfigError, match=rf"^trainer\.{key} is set by the run: ."):
            check_options(given)
        return
    check_options(given)
    real = L.Trainer

    def build(**options):
        seen.update(options)
        return real(**options)

    monkeypatch.setattr(L, "Trainer", build)
    trainer, _ = build_trainer(given, tmp_path)
    if key not in READ_BY_THE_RUN:
        assert seen[key] == value
    elif key == "strategy":
        assert type(trainer.strategy).__name__ != type(real(devices=1).strategy).__name__
    elif key == "max_time":
        assert any(getattr(one, "_duration", 0) == 3600 for one in trainer.callbacks)
    else:
        assert limit_of(given["trainer"]) == value


@pytest.mark.slow
def test_max_time_ends_a_run_in_order_and_the_next_job_has_it_anew(tmp_path):
    words = ["trainer.max_steps=100000", "trainer.max_time=00:00:00:02"]
    module = api.train(compose("anytouch2", [*WORDS, *words]), tmp_path)
    first = module.trainer.global_step
    assert 0 < first < 100000
    assert is_time_over(module.trainer)
    assert "go on to step 100000, where it was to end" in (tmp_path / "report.html").read_text()
    from tactileforge.runs.folder import read_config

    module = api.train({**read_config(tmp_path), "resume": str(tmp_path)}, tmp_path)
    assert module.trainer.global_step > first


@pytest.mark.slow
@pytest.mark.filterwarnings(OF_LIGHTNING)
def test_the_module_and_the_data_fit_a_trainer_of_ones_own(parts, tmp_path):
    module, data = _module(parts), parts[1]
    trainer = L.Trainer(
        max_steps=2, default_root_dir=tmp_path, logger=False, enable_progress_bar=False,
        enable_model_summary=False, num_sanity_val_steps=0, limit_val_batches=0,
    )  # fmt: skip
    trainer.fit(module, data)
    trainer.save_checkpoint(tmp_path / "mine.ckpt")
    again = TouchModule.load_from_checkpoint(tmp_path / "mine.ckpt")
    assert again.current_weights() == {"pixel": 1.0}
    assert again.hparams["config"]["optim"]["name"] == "adamw"
    for name, value in module.state_dict().items():
        torch.testing.assert_close(again.state_dict()[name], value, rtol=0, atol=0)


@pytest.mark.slow
@pytest.mark.filterwarnings(OF_LIGHTNING)
def test_callbacks_of_a_trainer_of_ones_own_monitor_the_sum_of_the_losses(parts, tmp_path):
    kept = ModelCheckpoint(tmp_path, monitor="val/loss")
    trainer = L.Trainer(
        max_steps=3, default_root_dir=tmp_path, logger=False, enable_progress_bar=False,
        enable_model_summary=False, num_sanity_val_steps=0, limit_val_batches=1,
        val_check_interval=1, check_val_every_n_epoch=None,
        callbacks=[kept, EarlyStopping("val/loss", stopping_threshold=1e9)],
    )  # fmt: skip
    trainer.fit(_module(parts), parts[1])
    assert trainer.global_step == 1, "the first one is below the threshold"
    metrics = trainer.callback_metrics
    assert float(kept.best_model_score) == float(metrics["val/loss"]) == float(metrics["val/pixel"])


@pytest.mark.slow
def test_batches_and_module_in_a_plain_loop_learn(parts):
    module, data = _module(parts), parts[1]
    data.trainer = None
    optimizer = torch.optim.AdamW(module.parameters(), lr=1e-3)
    losses = []
    for number, batch in enumerate(data.train_dataloader()):
        loss = module.training_step(batch, number)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
        if number == 11:
            break
    assert sum(losses[-3:]) < sum(losses[:3])


@pytest.mark.slow
@pytest.mark.filterwarnings(OF_LIGHTNING)
def test_another_module_trains_on_the_data(parts, tmp_path):
    class Mean(L.LightningModule):
        def __init__(self):
            super().__init__()
            self.level = torch.nn.Parameter(torch.zeros(()))

        def training_step(self, batch, batch_idx):
            self.mean = batch["frames"].float().mean() / 255
            return (self.level - self.mean).square()

        def validation_step(self, batch, batch_idx):
            self.log("val/level", self.level)

        def configure_optimizers(self):
            return torch.optim.SGD(self.parameters(), lr=0.5)  # a step to the mean of the batch

    module = Mean()
    L.Trainer(
        max_steps=8, default_root_dir=tmp_path, logger=False, enable_progress_bar=False,
        enable_model_summary=False, enable_checkpointing=False, num_sanity_val_steps=0,
    ).fit(module, parts[1])  # fmt: skip
    assert 0 < module.mean < 1
    torch.testing.assert_close(module.level.detach(), module.mean)


def test_a_checkpoint_of_parts_built_by_hand_asks_for_them(parts, tmp_path):
    torch.save({"state_dict": {}}, tmp_path / "hand.ckpt")
    with pytest.raises(ConfigError, match="give its parts again"):
        TouchModule.load_from_checkpoint(tmp_path / "hand.ckpt")
    torch.save([1], tmp_path / "list.ckpt")
    with pytest.raises(ConfigError, match="no checkpoint"):
        TouchModule.load_from_checkpoint(tmp_path / "list.ckpt")


def test_optimizers_of_torch_have_their_options():
    plugin, _ = parse_optim({"name": "sgd", "lr": 0.1, "momentum": 0.9, "weight_decay": 0.01})
    weight, bias = torch.nn.Parameter(torch.ones(2, 2)), torch.nn.Parameter(torch.ones(2))
    made = plugin.build([("w", weight), ("b", bias)], False)
    assert isinstance(made, torch.optim.SGD)
    assert [group["weight_decay"] for group in made.param_groups] == [0.01, 0.0]
    assert {group["momentum"] for group in made.param_groups} == {0.9}


def test_layer_decay_gives_each_block_its_rate():
    """As in MAE's fine-tuning: decay ** (blocks above), embeddings below block 0, heads 1."""
    names = ["encoder.stem.weight", "encoder.transformer.blocks.0.mlp.weight"]
    names += [
        "encoder.transformer.blocks.1.mlp.weight",
        "encoder.norm.weight",
        "heads.pixel.weight",
    ]
    named = [(name, torch.nn.Parameter(torch.ones(2, 2))) for name in names]
    made = build_optimizer(named, {"name": "adamw", "lr": 1.0, "layer_decay": 0.5, "warmup": 0}, 10)
    optimizer = made["optimizer"]
    rate = {id(p): group["initial_lr"] for group in optimizer.param_groups for p in group["params"]}
    assert [rate[id(p)] for _, p in named] == [0.125, 0.25, 0.5, 1.0, 1.0]


def test_rates_are_those_of_the_longest_name_that_fits():
    names = ["encoder.a.weight", "encoder.b.weight", "heads.force.weight", "heads.forces.weight"]
    named = [(name, torch.nn.Parameter(torch.ones(2, 2))) for name in names]
    rates = {"encoder": 0.1, "encoder.b": 0.5, "heads.force": 2.0}
    config = {"name": "sgd", "lr": 1.0, "warmup": 0, "rates": rates}
    optimizer = build_optimizer(named, config, 10)["optimizer"]
    rate = {id(p): group["initial_lr"] for group in optimizer.param_groups for p in group["params"]}
    assert [rate[id(p)] for _, p in named] == pytest.approx([0.1, 0.5, 2.0, 1.0])
    with pytest.raises(ConfigError, match=r"optim\.rates.*'head.*heads\.force"):
        build_optimizer(named, {**config, "rates": {"head.force": 2.0}}, 10)


@pytest.mark.parametrize("name", ["polynomial", "exponential", "step", "inverse_sqrt", "one_cycle"])
def test_schedules_rise_and_then_fall(name):
    curve = [getattr(schedules, name)(n, 10, 100) for n in range(101)]
    assert max(curve) == pytest.approx(1.0)
    assert max(range(101), key=curve.__getitem__) <= 10
    assert curve[100] < 0.35
    assert all(0 <= one <= 1 for one in curve)


def _plain(given):
    return OmegaConf.to_container(compose("anytouch2", given), resolve=True)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["trainer.keep_best=val/los"], r"unknown trainer\.keep_best 'val/los'; .*'val/loss'"),
        (["trainer.keep_best=val/probe_object"], r"Known: val/loss, val/pixel"),
        (
            ["callbacks=[early_stopping]", "callbacks.early_stopping.monitor=val_loss"],
            r"unknown callbacks\.early_stopping\.monitor 'val_loss'; did you mean 'val/loss'\?",
        ),
        (
            ["callbacks=[model_checkpoint]", "callbacks.model_checkpoint.monitor=pixel"],
            r"unknown callbacks\.model_checkpoint\.monitor 'pixel'; did you mean 'val/pixel'\?",
        ),
    ],
)
def test_what_no_run_logs_is_not_monitored(given, told):
    with pytest.raises(ConfigError, match=told):
        check_options(_plain([*WORDS, *given]))


@pytest.mark.parametrize(
    "given",
    [
        ["trainer.keep_best=val/loss", "optimized_metric=val/loss"],
        ["trainer.keep_best=val/probe_object", "callbacks=[probe]"],
        ["callbacks=[early_stopping]", "callbacks.early_stopping.monitor=train/loss"],
    ],
)
def test_what_a_run_logs_may_be_monitored(given):
    check_options(_plain([*WORDS, *given]))


@pytest.mark.slow
@pytest.mark.filterwarnings(OF_LIGHTNING)
def test_the_sum_of_the_losses_keeps_the_best(tmp_path):
    words = [*WORDS, "trainer.val_check_interval=1", "trainer.keep_best=val/loss"]
    module = api.train(compose("anytouch2", words), tmp_path)
    kept = read_checkpoint(tmp_path / "checkpoints" / "best.ckpt")["scores"]
    assert (
        kept["val/loss"] == kept["val/pixel"] <= float(module.trainer.callback_metrics["val/loss"])
    )


@pytest.mark.slow
@pytest.mark.filterwarnings(OF_LIGHTNING)
@pytest.mark.parametrize(
    "given",
    [
        ["trainer.keep_best=val/pixel/r2"],
        ["callbacks=[early_stopping]", "callbacks.early_stopping.monitor=val/pixel/r2"],
    ],
)
def test_a_part_that_is_not_logged_is_told_at_the_first_validation(given, tmp_path):
    words = [*WORDS, "trainer.val_check_interval=1", *given]
    with pytest.raises(
        ConfigError, match=r"'val/pixel/r2'; did you mean 'val/pixel'\? Known: .*val/l"
    ):
        api.train(compose("anytouch2", words), tmp_path)


class Broken(Callback):
    """Takes the place of a file of the run at the second step."""

    def __init__(self, full: bool = False) -> None:
        self.full = full

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx):
        if trainer.global_step != 1:
            return
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device", "a/b")
        path = trainer.loggers[0].path
        path.unlink()
        path.mkdir()


@pytest.mark.slow
@pytest.mark.filterwarnings(OF_LIGHTNING)
@pytest.mark.parametrize(
    ("full", "told"),
    [
        (False, r"^logger=csv cannot write \(.*Error: .*metrics\.csv.*\)\. Go on from its check"),
        (True, r"^a/b: the disk is full .*\. Go on from its ch"),
    ],
)
def test_what_cannot_be_written_ends_in_a_saved_run_and_one_line(full, told, tmp_path):
    from tactileforge.plugins import register

    register("callbacks", "broken", Broken)
    words = [*WORDS, "callbacks=[broken]", f"callbacks.broken.full={full}"]
    with pytest.raises(TactileForgeError, match=told):
        api.train(compose("anytouch2", words), tmp_path)
    assert read_checkpoint(tmp_path)["global_step"] == (1 if full else 2)
