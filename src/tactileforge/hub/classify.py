"""Classes of clips, by a linear head on a model's vectors."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from tactileforge.data.labels.objects import object_class
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, home_path
from tactileforge.hub.clips import GivenClips
from tactileforge.hub.forces import fingerprint
from tactileforge.hub.inputs import as_pixels
from tactileforge.hub.parts import Parts
from tactileforge.util import strict
from tactileforge.util.files import new_part, usual_mode
from tactileforge.util.pointers import check_pointer
from tactileforge.util.untrusted import load_json

#: Version of the file, and the key of its metadata.
CLASS_FORMAT = 2
_KEY = "tactileforge_classes"
#: Most classes, and most numbers of a vector, that a file may have.
_MOST_CLASSES, _WIDEST = 10_000, 65_536


@dataclass(frozen=True)
class Classes:
    """Classes of clips.

    Attributes:
        names: Names of the classes.
        probability: float32 (classes,), or (B, classes) for a batch; they sum to 1.
    """

    names: tuple[str, ...]
    probability: Tensor

    @property
    def name(self) -> str | list[str]:
        """The most probable class; a list of one name per clip for a batch."""
        best = self.probability.argmax(-1).tolist()
        return self.names[best] if isinstance(best, int) else [self.names[i] for i in best]


@dataclass(frozen=True, kw_only=True)
class ClassFacts:
    """Metadata of a head.

    Attributes:
        format: Version of the file format.
        task: Task of the benchmark.
        names: Names of the classes.
        encoder: Hash of the encoder's weights, see `encoder_hash`.
        background: Whether a frame without contact was subtracted; None where the encoder takes
            none.
        sensors: Sensors of the clips it was fitted to.
        penalty: Chosen penalty on the squared weights.
        metrics: Metrics of the clips left out while the penalty was chosen, by name.
    """

    format: int
    task: str
    names: list[str]
    encoder: str
    background: bool | None
    sensors: list[str]
    penalty: float
    metrics: dict[str, float]


@dataclass(frozen=True)
class ClassHead:
    """A linear layer on the vectors of one encoder.

    Attributes:
        facts: Metadata of the head.
        weight: float32 (classes, projected).
        bias: float32 (classes,).
    """

    facts: ClassFacts
    weight: Tensor
    bias: Tensor

    def save(self, path: Path) -> None:
        """Writes it, whole or not at all."""
        with new_part(path) as part:
            # the layer of a fit is transposed, which safetensors refuses
            tensors = {"weight": self.weight.contiguous(), "bias": self.bias.contiguous()}
            with usual_mode(part):
                save_file(tensors, part, metadata={_KEY: json.dumps(asdict(self.facts))})
            part.replace(path)


def encoder_hash(encoder: Any) -> str:
    """Hash of the weights of an encoder; ties a head to it."""
    return fingerprint([encoder])


def read_class_head(path: str | Path) -> ClassHead:
    """Reads a head written by the benchmark; nothing in it is executed.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is not such a head, or contradicts itself.
    """
    path = home_path(path)
    if not path.is_file():
        raise DataNotFoundError(f"{path}: no such file; tactileforge bench writes heads/*")
    check_pointer(path)
    try:
        with safe_open(path, "pt") as file:
            facts = _facts((file.metadata() or {}).get(_KEY))
            # by its shape, before it is read: a damaged one could ask for any amount of memory
            shape = tuple(file.get_slice("weight").get_shape())
            if shape[0] != len(facts.names) or len(shape) != 2 or shape[1] > _WIDEST:
                raise ConfigError(f"weight is {shape} for {len(facts.names)} classes")
            weight, bias = (file.get_tensor(key).float() for key in ("weight", "bias"))
    except (SafetensorError, ConfigError, ValueError, LookupError, OSError, MemoryError) as error:
        raise DataError(
            f"{path}: not a head of classes ({error}); make it with tactileforge bench"
        ) from error
    if bias.shape != weight.shape[:1] or not torch.cat([weight.flatten(), bias]).isfinite().all():
        raise DataError(f"{path}: its numbers are damaged; make it again with tactileforge bench")
    return ClassHead(facts, weight, bias)


def _facts(text: str | None) -> ClassFacts:
    if text is None:
        raise ConfigError("it does not name classes")
    facts = strict.build(ClassFacts, "the head", strict.mapping("the head", load_json(text)))
    if facts.format != CLASS_FORMAT:
        raise ConfigError(f"format {facts.format}; this tactileforge reads {CLASS_FORMAT}")
    if not 2 <= len(facts.names) <= _MOST_CLASSES:
        raise ConfigError(f"{len(facts.names)} classes")
    return facts


#: Weight (classes, projected) and bias (classes,), float32, and the names of the classes.
Layer: TypeAlias = tuple[Tensor, Tensor, tuple[str, ...]]


def classes_of(vectors: Tensor, layer: Layer) -> Classes:
    """Classes of vectors, float32 (projected,) or (B, projected)."""
    weight, bias, names = layer
    logits = vectors @ weight.to(vectors.device).T + bias.to(vectors.device)
    return Classes(names, logits.softmax(-1))


def layer_of(
    head: str | Path | ClassHead | None,
    names: Sequence[str] | None,
    clips: GivenClips,
    model: Parts,
) -> Layer:
    """The layer that `Model.classify` reads; see there for arguments and errors."""
    clips.refuse_itself()
    if isinstance(clips.frames, list | tuple):
        for one in clips.frames:
            replace(clips, frames=one).refuse_itself()
    if head is None:
        kept = model.header.heads.get("classify", {}).get("names", ())
        return packed_layer(model.heads, names, repr(model), kept)
    if names is not None:
        raise ConfigError("names= is for the head of a run; head= knows the names of its own")
    sensor = clips.sensor
    named = {sensor} if isinstance(sensor, str) else set(sensor or ())
    return fitted_layer(head, model.encoder_hash, repr(model), clips.subtracts, named)


def read_classes(model: Parts, clips: GivenClips, layer: Layer) -> Classes:
    """Classes of clips; of a list, of each item by itself, of any size."""
    read, given = model.clips_reader.tapped, clips.frames
    if not isinstance(given, list | tuple):
        return classes_of(read("projected", clips, 5), layer)
    if not given:
        raise DataError("frames: an empty list; give images")
    items = [as_pixels("frames", one) for one in given]
    places: dict[tuple[int, ...], list[int]] = {}
    for place, item in enumerate(items):
        places.setdefault(tuple(getattr(item, "shape", ())), []).append(place)
    rows: dict[int, Tensor] = {}
    for same in places.values():
        part = as_pixels("frames", [items[place] for place in same])
        # images are clips of one frame
        part = part[:, None] if getattr(part, "ndim", 0) == 4 else part
        background, sensor = (
            [x[place] for place in same]
            if isinstance(x, list | tuple) and len(x) == len(items)
            else x
            for x in (clips.background, clips.sensor)
        )
        told = replace(clips, frames=part, background=background, sensor=sensor)
        rows.update(zip(same, read("projected", told, 5), strict=True))
    return classes_of(torch.stack([rows[place] for place in range(len(items))]), layer)


def fitted_layer(
    head: str | Path | ClassHead, encoder: str, model: str, subtracts: bool, sensors: Iterable[str]
) -> Layer:
    """The layer of a head fitted by the benchmark.

    Args:
        head: The head, or its file.
        encoder: Hash of the model's encoder, see `encoder_hash`.
        model: Name of the model in errors.
        subtracts: Whether a background is given.
        sensors: Names of the sensors; empty leaves that open.

    Raises:
        ConfigError: It was fitted to another encoder, to pictures of another sensor, or to pictures
            with a background where none is given, or the other way round.
        DataError: The file is not a head.
        DataNotFoundError: There is no such file.
    """
    fitted = head if isinstance(head, ClassHead) else read_class_head(head)
    if fitted.facts.encoder != encoder:
        raise ConfigError(
            f"the head of {fitted.facts.task} was fitted to another encoder than {model}: "
            "run tactileforge bench with this model"
        )
    # None: the encoder takes no background
    if fitted.facts.background not in (None, subtracts):
        fix = "give background=, a frame without contact" if not subtracts else "background='none'"
        known = "with" if fitted.facts.background else "without"
        raise ConfigError(
            f"the head of {fitted.facts.task} was fitted to pictures {known} a background: {fix}"
        )
    # universal tokens fit no sensor in particular, so a head may be read with them
    if strange := set(sensors) - {*fitted.facts.sensors, "universal"}:
        raise ConfigError(
            f"the head of {fitted.facts.task} was fitted to pictures of "
            f"{', '.join(fitted.facts.sensors)}, not of {', '.join(sorted(strange))}"
        )
    return fitted.weight, fitted.bias, tuple(fitted.facts.names)


def packed_layer(
    heads: Any, names: Sequence[str] | None, model: str, kept: Sequence[str] = ()
) -> Layer:
    """The rows of the head of a run for some objects.

    Args:
        heads: Heads of the model, by name.
        names: Names of the objects, two or more; None for ``kept``.
        model: Name of the model in errors.
        kept: Names that the run has kept, of all objects that it was trained on.

    Raises:
        ConfigError: There is no such head, or it was not trained on these objects.
    """
    if "classify" not in heads:
        raise ConfigError(
            f"{model} has no head for classes: give head=FILE, which tactileforge bench "
            "suite=classes writes, or pack a run whose objectives include classify"
        )
    linear, met = heads["classify"].linear, heads["classify"].met
    if names is None and len(kept) > 1 and len(kept) < int(met.sum()):
        raise ConfigError(
            f"names: the run has kept {len(kept)} of the {int(met.sum())} names that it was "
            "trained on, as its data is large or was changed; give those to choose from"
        )
    names = kept if names is None else names
    if len(names) < 2:
        raise ConfigError("names: give the names of two objects of the training data, or more")
    rows = [object_class(name, len(linear.bias)) for name in names]
    if strange := [name for name, row in zip(names, rows, strict=True) if not met[row]]:
        raise ConfigError(
            f"names: the head was not trained on {', '.join(map(repr, strange))}; give names of "
            "objects of its training data, spelled as there"
        )
    # a class is a hash of a name, so two objects may share one
    for place, row in enumerate(rows):
        if row in rows[:place]:
            other = names[rows.index(row)]
            raise ConfigError(
                f"names: {other!r} and {names[place]!r} share a class of the head; train with "
                "more head.classify.classes"
            )
    weight, bias = linear.weight[rows].detach().float(), linear.bias[rows].detach().float()
    return weight, bias, tuple(names)
