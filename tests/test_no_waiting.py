"""A training step does not wait for the device: no number is read back, no copy blocks.

The meta device stands in for an accelerator: its tensors have no values, so that reading one is an
error, and what is copied to it from the host, or has a shape that depends on values, is seen.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode

from tactileforge.cli._compose import compose
from tactileforge.data.labels.augment import build_augment
from tactileforge.testing import batch as make_batch
from tactileforge.training.module import TouchModule

RECIPES = sorted(
    path.stem for path in (Path(__file__).parents[1] / "zoo" / "recipe").glob("*.yaml")
)

#: What makes the host wait, or has a shape that it must wait for.
WAITING = ("_local_scalar_dense", "nonzero", "masked_select", "unique", "equal.default")


class Watch(TorchDispatchMode):
    """Keeps the names of operations with a wait for an accelerator."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def __torch_dispatch__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        kwargs = kwargs or {}
        name = str(func)
        if any(word in name for word in WAITING) or ("index" in name and _by_bool(args)):
            self.found.append(name)
        out = func(*args, **kwargs)
        copies = name.startswith(("aten._to_copy", "aten.copy_"))
        if copies and not (kwargs.get("non_blocking") or True in args[2:]):
            source = args[1] if name.startswith("aten.copy_") else args[0]
            if source.device != out.device:
                self.found.append(f"{name} from {source.device} to {out.device}")
        return out


def _by_bool(args: tuple[Any, ...]) -> bool:
    lists = [arg for arg in args if isinstance(arg, list | tuple)]
    return any(isinstance(x, Tensor) and x.dtype == torch.bool for each in lists for x in each)


@contextmanager
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[Watch]:
    """Watches operations, and tensors made on the device from values of the host."""
    make: Callable[..., Tensor] = torch.tensor
    cast: Any = torch.autocast

    def tensor(*args: Any, **options: Any) -> Tensor:
        if torch.device(options.get("device") or "cpu").type == "meta":
            watch.found.append("torch.tensor(device=)")
        return make(*args, **options)

    def autocast(kind: str, **options: Any) -> Any:  # the meta device has none
        return cast("cpu" if kind == "meta" else kind, **options)

    with monkeypatch.context() as patch, Watch() as watch:
        patch.setattr(torch, "tensor", tensor)
        patch.setattr(torch, "autocast", autocast)
        yield watch


def on_device(recipe: str, *overrides: str) -> tuple[TouchModule, dict[str, Any]]:
    """A module and a batch, in the place of the accelerator."""
    words = ["scale=demo", "encoder.image_size=32", *overrides]
    config: Any = OmegaConf.to_container(compose(recipe, words), resolve=True)
    augment = build_augment(config.get("augment"))
    module = TouchModule.from_config(config, {"text", "image"}, augment).to("meta")
    made = make_batch(size=4, frames=module.encoder.frames, image=32)
    made |= augment.labels(made) if augment else {}
    return module, {k: v.to("meta") if isinstance(v, Tensor) else v for k, v in made.items()}


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_step_waits_for_nothing(recipe: str, monkeypatch: pytest.MonkeyPatch) -> None:
    step(monkeypatch, *on_device(recipe))


@pytest.mark.slow
def test_all_augmentations_wait_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    ranges = {"rotate": 180, "shift": 0.1, "scale": 0.1, "blur": 1, "gain": 0.1, "colour": 0.1}
    words = [f"augment.{name}={value}" for name, value in ranges.items()]
    step(monkeypatch, *on_device("anytouch2", *words, "augment.noise=2"))


@pytest.mark.slow
@pytest.mark.parametrize("balance", ["clip", "gradnorm", "uncertainty"])
def test_a_balance_waits_for_nothing(balance: str, monkeypatch: pytest.MonkeyPatch) -> None:
    step(monkeypatch, *on_device("anytouch2", f"balance={balance}"))


def step(monkeypatch: pytest.MonkeyPatch, module: TouchModule, batch: dict[str, Any]) -> None:
    """A training step with all its hooks, and every objective awake."""
    weights = dict.fromkeys(module.objectives, 1.0)
    with watched(monkeypatch) as watch:
        if module.augment:
            batch = module.augment(batch)
        terms = module.terms(batch, weights, universal=0.5)
        losses = {key: term.loss.value for key, term in terms.items()}
        total = module.balance(losses, weights, 0, module.encoder)
        torch.autograd.backward(total)
        module.total = 10
        module._follow(1)
    assert total.device.type == "meta"
    assert watch.found == []


@pytest.mark.slow
@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.parametrize("paired", [True, False])
def test_validation_waits_for_nothing(
    recipe: str, paired: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, batch = on_device(recipe)
    weights = dict.fromkeys(module.objectives, 1.0)
    monkeypatch.setattr(module, "current_weights", lambda: dict(weights))
    with watched(monkeypatch) as watch:
        module.validation_step(batch | {"paired": paired}, 0)
    assert watch.found == []
    assert ("match" in module._losses) == (paired and "match" in module.objectives)


@pytest.mark.parametrize(
    ("waits", "name"),
    [
        (lambda x: x[x > 0], "index.Tensor"),
        (lambda x: torch.tensor([1.0], device=x.device), "torch.tensor(device=)"),
        (lambda x: torch.ones(2).to(x.device), "from cpu to meta"),
        (lambda x: nn.functional.mse_loss(x, x).item(), "_local_scalar_dense"),
    ],
)
def test_the_watch_sees(
    waits: Callable[[Tensor], object], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with watched(monkeypatch) as watch:
        try:
            waits(torch.ones(3, device="meta"))
        except (RuntimeError, NotImplementedError):  # there is no value
            watch.found.append("") if not watch.found else None
    assert name in "".join(watch.found)
    with watched(monkeypatch) as watch:
        torch.ones(2).to("meta", non_blocking=True)
    assert watch.found == []
