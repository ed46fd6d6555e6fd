"""Checks of touch encoders through a whole run: train, resume, pack, load, export."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from copy import deepcopy
from dataclasses import dataclass
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch
from tactileforge.errors import ConfigError
from tactileforge.hub.files import make_header, save_checkpoint
from tactileforge.hub.loading import load
from tactileforge.plugins import registry
from tactileforge.plugins.distributions import how_to_get
from tactileforge.testing.batches import batch
from tactileforge.testing.modules import SMALL_HEADS, require_close, require_equal, small_context
from tactileforge.testing.results import Check, CheckSubject, Skip, require
from tactileforge.training.parts import term_of

#: Objectives for an encoder without the attribute ``serves``.
SERVED = ("pixel", "diff", "align", "match", "force")
#: Types of sensors of a run, for an encoder without a table of sensors.
SENSORS = ("gelsight", "digit")
_SAMPLES = 4


def known_sensors(encoder: Any, size: int) -> list[str]:
    """Sensors of ``size`` samples: those of the encoder's table in turn, or any without one."""
    names = list(encoder.sensors) or list(SENSORS)
    return [names[i % len(names)] for i in range(size)]


def build_for_run(subject: CheckSubject, seed: int = 0) -> Any:
    """Builds a touch encoder with a row for each sensor of the data, like a run.

    Raises:
        Skip: The encoder is not for touch.
    """
    torch.manual_seed(seed)
    encoder = subject.build()
    if getattr(encoder, "modality", "touch") != "touch":
        raise Skip("only touch encoders are trained on touch")
    if "sensors" not in registry.parameters(subject.plugin):
        return encoder
    rows = rows_of_run(encoder)
    torch.manual_seed(seed)  # again, as the first build has drawn
    built = CheckSubject(
        subject.kind, subject.plugin, subject.name, {**subject.options, "sensors": rows}
    ).build()
    require(dict(built.sensors) == rows, f"sensors={rows} gives an encoder with {built.sensors}")
    return built


def rows_of_run(encoder: Any) -> dict[str, int]:
    """Table of the encoder's sensors, with free rows added for other sensors of a run."""
    table = dict(encoder.sensors)
    for name in SENSORS:
        table.setdefault(name, next(row for row in range(99) if row not in table.values()))
    return table


def made_for(encoder: Any) -> Batch:
    """A labelled batch of frames of the encoder's size, channels last as data readers give them."""
    made = batch(_SAMPLES, frames=encoder.frames, image=encoder.image_size[0])
    if encoder.image_size[0] != encoder.image_size[1]:
        # `batch` draws squares; the encoder resizes them, as it does frames of other sensors
        made |= batch(_SAMPLES, frames=encoder.frames, image=48)
    return made | {"sensor": known_sensors(encoder, _SAMPLES)}


@dataclass(frozen=True)
class _Run:
    encoder: Any
    head: nn.Module
    objective: nn.Module
    optimizer: torch.optim.Optimizer

    @classmethod
    def of(cls, encoder: Any, name: str) -> _Run:
        torch.manual_seed(0)
        objective = registry.build("objectives", {"name": name})
        context = {**small_context(image=encoder.image_size[0]), "encoder": encoder}
        node = {"name": objective.head, **SMALL_HEADS.get(objective.head, {})}
        head = registry.build("heads", node, **context)
        modules = nn.ModuleList([encoder, head, objective])
        trained = [x for x in modules.parameters() if x.requires_grad]
        return cls(encoder, head, objective, torch.optim.AdamW(trained, lr=1e-4))

    def step(self, made: Batch, number: int) -> Tensor:
        torch.manual_seed(number)
        self.optimizer.zero_grad()
        prediction = self.head(self.encoder.views(made), made)
        loss = term_of("objective", self.objective, prediction, made).loss.value
        torch.autograd.backward(loss)
        self.optimizer.step()
        return loss.detach()

    @property
    def state(self) -> dict[str, Any]:
        parts = {"encoder": self.encoder, "head": self.head, "optimizer": self.optimizer}
        return deepcopy({name: part.state_dict() for name, part in parts.items()})

    def load(self, state: dict[str, Any]) -> None:
        self.encoder.load_state_dict(state["encoder"])
        self.head.load_state_dict(state["head"])
        self.optimizer.load_state_dict(state["optimizer"])


def _served(subject: CheckSubject) -> Sequence[str]:
    served = tuple(getattr(subject.plugin, "serves", SERVED))
    if not served:
        raise Skip("it says that it serves no objective")
    return served


def a_step_of_each_objective_it_serves(subject: CheckSubject) -> None:
    """Losses are finite and reach the encoder, for every name in the class attribute ``serves``."""
    for name in _served(subject):
        encoder = build_for_run(subject).train()
        try:
            loss = _Run.of(encoder, name).step(made_for(encoder), 0)
        except Exception as error:
            if isinstance(error, ConfigError) and encoder.frames == 1 and name != "pixel":
                continue  # the objective needs changes between frames
            said = f"{type(error).__name__}: {error}"
            require(False, f"objective {name}: {said}; if it cannot serve it, say so in 'serves'")
        require(bool(torch.isfinite(loss)), f"objective {name}: the loss is {loss.item()}")
        trained = [x for x in encoder.parameters() if x.requires_grad]
        reached = any(x.grad is not None and bool(x.grad.any()) for x in trained)
        require(reached or not trained, f"objective {name}: no gradient reaches the encoder")


def resumes_to_the_same_bits(subject: CheckSubject) -> None:
    """Three steps in one go, and one step, a reload and two steps, give the same weights."""
    for name in _served(subject)[:1]:
        encoder = build_for_run(subject).train()
        made = made_for(encoder)
        whole = _Run.of(encoder, name)
        whole.step(made, 0)
        kept = whole.state
        # of another seed: what a state does not hold would differ
        later = _Run.of(build_for_run(subject, seed=1).train(), name)
        later.load(kept)
        for number in (1, 2):
            whole.step(made, number)
            later.step(made, number)
        first, second = (list(run.encoder.state_dict().values()) for run in (whole, later))
        require_equal(first, second, "a run that is resumed ends with other weights")


def packed_and_loaded_it_is_the_same(subject: CheckSubject) -> None:
    """A one-file checkpoint, opened by `tactileforge.load`, gives the same tokens."""
    with tempfile.TemporaryDirectory() as folder:
        encoder, file = _saved(subject, Path(folder))
        model = load(file)
    made = made_for(encoder)
    rows = torch.tensor([encoder.sensors.get(name, 0) for name in made["sensor"]])
    inputs = made["frames"], made["background"], rows
    with torch.no_grad():
        require_close(list(model.encoder(*inputs)), list(encoder(*inputs)), "packed and loaded")
        vectors = model.encode(
            made["frames"].permute(0, 1, 3, 4, 2).numpy(), "none", made["sensor"]
        )
    shape = (_SAMPLES, encoder.projected)
    require(tuple(vectors.shape) == shape, f"encode gives {tuple(vectors.shape)}, not {shape}")


def exported_it_is_the_same(subject: CheckSubject) -> None:
    """The file of ``tactileforge export`` computes the same; ONNX if it is installed."""
    if "export" not in registry.names("verbs"):
        raise Skip(f"export {how_to_get('verbs', 'export')}")
    command = registry.load("verbs", "export").COMMANDS[""]
    with tempfile.TemporaryDirectory() as folder:
        encoder, file = _saved(subject, Path(folder))
        keys = {
            "model": f"file:{file}",
            "format": "onnx" if all(map(find_spec, ("onnx", "onnxruntime"))) else "torch_export",
            "out": str(Path(folder) / "exported"),
            "size": list(encoder.image_size),
        }
        # what the command says of its file, and its bar
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            command.start({}, keys)


def _saved(subject: CheckSubject, folder: Path) -> tuple[Any, Path]:
    """An encoder in eval mode, and its file."""
    if not subject.name:
        raise Skip("the class is not installed as a plugin, so no file can name it")
    encoder = build_for_run(subject).eval()
    node = {"name": subject.name, **subject.options}
    if "sensors" in registry.parameters(subject.plugin):
        node["sensors"] = dict(encoder.sensors)
    spacing = float(getattr(encoder, "spacing", 0.1)) if encoder.frames > 1 else 0.0
    header = make_header(encoder, node, licence="NOASSERTION", spacing=spacing)
    save_checkpoint(folder / "model.safetensors", encoder, header)
    return encoder, folder / "model.safetensors"


CHECKS: list[Check] = [
    a_step_of_each_objective_it_serves,
    resumes_to_the_same_bits,
    packed_and_loaded_it_is_the_same,
    exported_it_is_the_same,
]
