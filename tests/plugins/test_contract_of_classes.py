"""Needed and forbidden members of a class of one's own."""

import pytest
import torch
from torch import nn

from tactileforge.contracts import CONTEXT, Dataset, Sensor
from tactileforge.errors import ConfigError, PluginError
from tactileforge.objectives import Pixel
from tactileforge.plugins import class_contracts, local, metadata, registry
from tactileforge.training.assemble import build_data
from tactileforge.training.optim import COMMON, parse_optim


class Goal(nn.Module):
    head, needs = "pixel", frozenset()

    def forward(self, prediction, batch):
        return prediction.mean(), {}


class WeightedGoal(Goal):
    def __init__(self, weight: float = 3.0) -> None:
        super().__init__()


class EncoderGoal(Goal):
    def __init__(self, encoder) -> None:
        super().__init__()


class NamedHead(nn.Module):
    def __init__(self, encoder, name: str = "a") -> None:
        super().__init__()

    def forward(self, views, batch):
        return views


class PlainHead(nn.Module):
    def __init__(self, encoder) -> None:
        super().__init__()

    def forward(self, views, batch):
        return views


class TargetNet(nn.Module):
    def __init__(self, _target_: str = "") -> None:
        super().__init__()

    def forward(self, frames, background, sensor):
        return frames


class BadShare:
    provides = frozenset()

    def __init__(self, root: str = "", max_bad: float = 0.5) -> None: ...
    def recordings(self, split): ...
    def plot(self, recording): ...


class NamedSensor:
    def __init__(self, name: str = "left") -> None: ...
    def discover(self): ...
    def open(self): ...
    def read(self, timeout=1.0): ...
    def close(self): ...


class Clipped(torch.optim.SGD):
    def __init__(self, params, lr: float = 0.1, clip: float = 1.0) -> None:
        super().__init__(params, lr)


class NeedsName:
    def __init__(self, name: str) -> None: ...
    def on_train_start(self): ...
    def state_dict(self): ...


class NamedChange:
    def __init__(self, name: str = "a") -> None: ...
    def __call__(self, batch):
        return batch


@pytest.mark.parametrize(
    ("kind", "plugin", "key"),
    [
        ("objectives", WeightedGoal, "weight"),
        ("heads", NamedHead, "name"),
        ("encoders", TargetNet, "_target_"),
        ("datasets", BadShare, "max_bad"),
        ("sensors", NamedSensor, "name"),
        ("optimizers", Clipped, "clip"),
        ("callbacks", NeedsName, "name"),
        ("augmentations", NamedChange, "name"),
    ],
)
def test_an_option_with_a_key_of_the_framework_is_refused(kind, plugin, key):
    with pytest.raises(PluginError, match=f"^mine takes '{key}', and.*call it something else"):
        class_contracts.check_contract(kind, plugin, "mine")
    metadata.registered[kind, "of_a_package"] = plugin  # as an entry point, which no one looks at
    try:
        with pytest.raises(PluginError, match=f"takes '{key}', and"):
            registry.checked(kind, {"name": "of_a_package"})
    finally:
        del metadata.registered[kind, "of_a_package"]


class Late:
    """A data set with labels by its options."""

    def __init__(self, root: str = "touches") -> None:
        self.provides = frozenset({"force"} if root else ())
        self.skipped: list[str] = []

    def recordings(self, split):
        return []


def test_what_a_constructor_sets_is_there():
    class_contracts.check_contract("datasets", Late, "mine")


def test_reserved_keys_are_those_that_are_taken_away():
    assert class_contracts.RESERVED["optimizers"] == {*COMMON}


def test_a_logger_of_lightning_keeps_the_default_of_its_name():
    from lightning.pytorch.loggers import CSVLogger

    class_contracts.check_contract("loggers", CSVLogger, "mine")


def test_what_heads_alone_are_given_is_refused_elsewhere():
    assert "encoder" in CONTEXT
    with pytest.raises(PluginError, match="has encoder in its constructor, which heads alone"):
        class_contracts.check_contract("objectives", EncoderGoal, "mine")


@pytest.mark.parametrize(
    ("kind", "plugin", "said"),
    [
        ("encoders", Goal, r"mine is an objective \(it has head and needs\), no encoder: .*width"),
        ("encoders", PlainHead, r"mine is a head \(its constructor takes the encoder\), no enc"),
        ("heads", Goal, r"mine is an objective \(it has head and needs\), no head: .*head\(enc"),
        ("objectives", PlainHead, "mine has no head, no needs"),
        ("datasets", Goal, "mine has no recordings, no provides: see"),
    ],
)
def test_a_class_of_another_kind_is_told(kind, plugin, said):
    with pytest.raises(PluginError, match=said):
        class_contracts.check_contract(kind, plugin, "mine")


def test_methods_of_a_protocol_are_stubs():
    class Half(Sensor):
        def discover(self):
            return []

        def open(self): ...

    class Bare(Dataset): ...

    with pytest.raises(PluginError, match=r"^mine has no read, no close: see Sensor"):
        class_contracts.check_contract("sensors", Half, "mine")
    with pytest.raises(PluginError, match=r"^mine has no recordings"):
        class_contracts.check_contract("datasets", Bare, "mine")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (type("Silent", (), {}), "has no __call__: give a class whose instance takes a batch"),
        (lambda batch: batch, "is a function of batch: give a class"),
        (Pixel, "is called with prediction, batch: give a class"),
    ],
)
def test_a_change_of_batches_has_to_be_called(change, said):
    with pytest.raises(PluginError, match=said):
        class_contracts.check_contract("augmentations", change, "augment.also.mine")


def test_a_function_that_makes_no_change_is_told_before_data_is_read():
    from tactileforge import compose

    local.keep("own_changes:number", lambda: 3)
    words = ["scale=demo", "encoder.image_size=32", "data.scenes=3", "batch.workers=0"]
    config = compose("mae", [*words, "augment.also={n: {name: own_changes:number}}"])
    with pytest.raises(ConfigError, match=r"augment.also.n: own_changes:number gives a int, which"):
        build_data(config)


class Lion(torch.optim.Optimizer):
    def __init__(self, params, lr: float = 1e-3, fails: str = "") -> None:
        if fails == "built":
            raise KeyError("no luck")
        super().__init__(params, {"lr": lr, "fails": fails})

    def step(self, closure=None):
        loss = closure()
        if self.param_groups[0]["fails"] == "stepped":
            raise IndexError("no step")
        return loss


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"lr": "fast"}, "^optim.lr is 'fast', which is not of type float"),
        ({"fails": "built"}, r"^optim: Lion: test_\w+.py:\d+: KeyError: 'no luck'"),
        ({"fails": "stepped"}, r"^optim: Lion.step fails .*: test_\w+.py:\d+: IndexError: no step"),
    ],
)
def test_a_slip_with_an_optimizer_of_ones_own_is_one_line(options, said):
    local.keep("own_optim:Lion", Lion)
    with pytest.raises(ConfigError, match=said):
        parse_optim({"name": "own_optim:Lion", **options})
    assert parse_optim({"name": "own_optim:Lion", "lr": 1})[0]


def test_a_constructor_that_raises_is_one_line_with_its_place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_broken.py").write_text(
        "class Goal:\n    head, needs = 'pixel', frozenset()\n"
        "    def __init__(self):\n        raise ValueError('no luck')\n"
        "    def forward(self, prediction, batch): ...\n"
    )
    name = "./own_broken.py:Goal"
    registry.adopt("objectives", name)
    with pytest.raises(PluginError) as error:
        registry.build("objectives", {"name": name}, "objective.goal")
    place = "own_broken.py:4: ValueError: no luck"
    assert str(error.value) == f"objective.goal: {name} cannot be built: {place}"
    assert isinstance(error.value.__cause__, ValueError)
