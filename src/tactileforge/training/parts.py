"""Builds the parts of a module from a finished configuration."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Any

import torch
from omegaconf import DictConfig, ListConfig, OmegaConf
from torch import Tensor, nn

from tactileforge.contracts import Batch, ColumnSize
from tactileforge.errors import ConfigError, PluginError, unknown
from tactileforge.plugins import registry
from tactileforge.training import curriculum
from tactileforge.util import strict
from tactileforge.util.means import FIX, Mean, NotATensorError

#: Limits of an encoder: largest number among its options, most blocks, and most weights.
_LARGEST, _DEEPEST, _MOST = 8192, 256, 20_000_000_000


@dataclass(frozen=True)
class Term:
    """Loss of one objective on a batch, with its logs.

    Attributes:
        prediction: Output of the objective's head.
        loss: Unweighted loss.
        extra: Further scalars to log, by name.
    """

    prediction: Any
    loss: Mean
    extra: Mapping[str, Mean]


def term_of(key: str, objective: nn.Module, prediction: Any, batch: Batch) -> Term:
    """Computes the term of an objective.

    A tensor without a count is taken as a mean over the clips of the batch.

    Args:
        key: Name of the objective.
        objective: Objective to compute; see `contracts.Objective`.
        prediction: Output of its head.
        batch: Batch in the format of `tactileforge.contracts`.

    Raises:
        PluginError: The objective uses a `Mean` as a tensor, or returns something else.
    """
    try:
        made = objective(prediction, batch)
        if not (isinstance(made, tuple | list) and len(made) == 2 and isinstance(made[1], Mapping)):
            raise PluginError(f"objective {key!r}: {_returned(made)}")
        rows = len(batch["group"])
        logs = {name: _counted(value, rows, name) for name, value in made[1].items()}
        return Term(prediction, _counted(made[0], rows, "the loss"), logs)
    except NotATensorError as error:
        raise PluginError(f"objective {key!r}: {error}") from error
    except TypeError as error:
        if Mean.__name__ not in str(error):
            raise
        raise PluginError(
            f"objective {key!r}: {error}; masked_mean returns a Mean: {FIX}"
        ) from error


def _returned(made: Any) -> str:
    """Words on a wrong result of an objective."""
    what = type(made).__name__
    if isinstance(made, Tensor):
        what = f"only a tensor of shape {tuple(made.shape)}"
    elif isinstance(made, Mean):
        what = "only a Mean"
    elif isinstance(made, tuple | list):
        what = f"({', '.join(type(one).__name__ for one in made)})"
    return (
        f"forward returned {what}; it must return the loss and a mapping of what is logged, "
        "return loss, {}: see Objective of tactileforge.contracts"
    )


def check_scalars(key: str, term: Term) -> None:
    """Checks the shapes of a term; what is on the device is not waited for.

    Args:
        key: Name of the objective.
        term: Its term of some batch.

    Raises:
        PluginError: The loss, or what is logged, is no scalar.
    """
    for name, mean in {"the loss": term.loss, **term.extra}.items():
        if shape := tuple(mean.value.shape):
            raise PluginError(
                f"objective {key!r}: {name} has shape {shape}; it must be a scalar, the mean over "
                "the batch (loss.mean(), or masked_mean of tactileforge.training where labels may "
                "be missing): see Objective of tactileforge.contracts"
            )


def _counted(value: Any, rows: int, name: str) -> Mean:
    if isinstance(value, Mean):
        return value
    if isinstance(value, Tensor):
        return Mean(value, value.detach().new_full((), rows, dtype=torch.float32))
    raise TypeError(f"{name} is no {Mean.__name__} and no tensor, but {type(value).__name__}")


def logs_of(terms: Mapping[str, Term]) -> dict[str, Mean]:
    """Losses by objective, and their further scalars as ``objective/name``."""
    logs: dict[str, Mean] = {}
    for key, term in terms.items():
        logs[key] = term.loss.detach()
        logs |= {f"{key}/{name}": mean.detach() for name, mean in term.extra.items()}
    return logs


def plain(config: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration as plain data, resolved."""
    if isinstance(config, DictConfig):
        return OmegaConf.to_container(config, resolve=True)  # type: ignore[return-value]
    nodes = (DictConfig, ListConfig)  # as in {**composed, "encoder": ...}
    return {
        key: OmegaConf.to_container(value, resolve=True) if isinstance(value, nodes) else value
        for key, value in config.items()
    }


#: Blocks of a configuration that a run is built of.
_BLOCKS = ("encoder", "head", "objective", "data", "batch", "trainer")


def is_finished(config: Mapping[str, Any]) -> bool:
    """Whether a configuration is complete for a run."""
    try:
        check_finished(config)
    except ConfigError:
        return False
    return "seed" in config


def check_finished(config: Mapping[str, Any]) -> None:
    """Raises a ConfigError about an unfinished configuration; says the fix."""
    lacks = [key for key in _BLOCKS if not isinstance(config.get(key), Mapping)]
    if not lacks:
        chosen = [key for key, node in config["objective"].items() if node is not None]
        lacks = [f"head.{key}" for key in chosen if "name" not in (config["head"].get(key) or {})]
        lacks += ["data.max_bad"] * ("max_bad" not in config["data"])
    if lacks:
        raise ConfigError(
            f"the configuration has no {', '.join(lacks)}: complete it first, "
            "config = tactileforge.compose(config)"
        )


#: What training reads of an encoder, of `contracts.Encoder`.
_ENCODER = ("frames", "image_size", "sensors", "width", "projected", "views")
#: Types of numbers of an encoder that heads read.
_TYPES = {key: int for key in ("frames", "width", "tube", "prefix")}


def check_encoder(encoder: Any, name: str) -> None:
    """Checks an encoder for the attributes read in training.

    Raises:
        ConfigError: It is not one of touch, or lacks something.
    """
    modality = getattr(encoder, "modality", "touch")
    if modality != "touch":
        raise ConfigError(f"encoder={name} encodes {modality}, not touch")
    if missing := [key for key in _ENCODER if not hasattr(encoder, key)]:
        raise ConfigError(
            f"encoder={name} has no {', no '.join(missing)}: derive it from Backbone of "
            "tactileforge.encoders, or from ConvBackbone for a network of maps, which have these "
            "(docs/plugins/encoder.md; tactileforge plugins new encoder NAME)"
        )
    wrong = [key for key, kind in _TYPES.items() if not isinstance(getattr(encoder, key, 0), kind)]
    if wrong:
        found = type(getattr(encoder, wrong[0])).__name__
        raise ConfigError(
            f"encoder={name}: {wrong[0]} is of type {found}, and a name that the framework reads "
            f"({', '.join(_TYPES)}): call yours something else"
        )


def build_parts(
    config: Mapping[str, Any], provides: AbstractSet[str]
) -> tuple[Any, dict[str, nn.Module], dict[str, nn.Module]]:
    """Builds the encoder, and the heads and objectives by name.

    Args:
        config: Finished configuration, as plain data.
        provides: Labels of the data; towers for other labels are not built.

    Raises:
        ConfigError: The encoder is not one of touch, or a head has nothing to align with.
    """
    encoder = registry.build("encoders", config["encoder"], "encoder")
    check_encoder(encoder, config["encoder"]["name"])
    heads, objectives = {}, {}
    for key, node in config["objective"].items():
        options = {name: value for name, value in node.items() if name != "weight"}
        objectives[key] = registry.build("objectives", options, f"objective.{key}")
        heads[key] = _head(key, config, provides, encoder)
    return encoder, heads, objectives


def changing(place: str, parts: Mapping[str, Any]) -> tuple[Any, str]:
    """Finds a number to be changed by the curriculum.

    Args:
        place: Place of the number, such as ``encoder.mask_ratio`` or ``objective.pixel.KEY``.
        parts: Encoder, heads and objectives, by their place.

    Returns:
        The part, and the name of its attribute.

    Raises:
        ConfigError: There is no such part, or it has no such number.
    """
    owner, _, name = place.rpartition(".")
    if owner not in parts:
        raise ConfigError(unknown("part in curriculum.values", owner, parts))
    value = getattr(parts[owner], name, None)
    if not isinstance(value, int | float) or isinstance(value, bool):
        numbers = {k for k, v in vars(parts[owner]).items() if isinstance(v, float)}
        raise ConfigError(unknown(f"number of {owner} in curriculum.values", name, numbers))
    return parts[owner], name


def check_arguments(config: Mapping[str, Any]) -> None:
    """Checks the options of heads, objectives and towers before data is read.

    Raises:
        ConfigError: An option is unknown, missing, or of another type.
    """
    for group in ("objective", "head"):
        for key, node in config[group].items():
            options = {name: v for name, v in node.items() if (group, name) != _WEIGHT}
            registry.checked(f"{group}s", options, f"{group}.{key}")
    for place in ("text_encoder", "image_encoder"):
        if config.get(place):
            registry.checked("encoders", config[place], place)


#: Key of an objective that its constructor does not have.
_WEIGHT = ("objective", "weight")


def check_values(config: Mapping[str, Any]) -> None:
    """Builds the encoder and the objectives with both ends of each changing number.

    Args:
        config: Finished configuration; see `compose.finish`.

    Raises:
        ConfigError: A constructor refuses a value.
    """
    for place, row in curriculum.value_rows(config["curriculum"]).items():
        owner, _, name = place.rpartition(".")
        group, _, key = owner.partition(".")
        node = config.get(group) or {}
        node = node.get(key) if key else node
        if group not in ("encoder", "objective") or not node or name not in node:
            continue  # a head cannot be built without its encoder
        ends = [row.get(key) for key in ("low", "high")]
        for end in (end for end in ends if isinstance(end, int | float)):
            options = {k: v for k, v in node.items() if k != "weight"} | {name: end}
            with torch.device("meta"), torch.random.fork_rng(devices=[]):
                registry.build(f"{group}s", options, owner)


def outline(node: Mapping[str, Any]) -> Any:
    """Builds an encoder on the meta device: with its sizes and sensors, without weights.

    The state of the random numbers is left as it was. An encoder whose constructor computes with
    its tensors is built with its weights.

    Args:
        node: ``name`` of the plugin, and the arguments of its constructor.

    Raises:
        ConfigError: An option, or the number of weights, is larger than that of any model: the
            encoder would take minutes to build, or all memory.
    """
    for key, value in node.items():
        most = _DEEPEST if key == "depth" else _LARGEST
        items = value if isinstance(value, list | tuple) else [value]
        if any(abs(x) > most for x in items if isinstance(x, int | float)):
            raise ConfigError(f"encoder.{key}={value}: at most {most} for an encoder")
    with torch.random.fork_rng(devices=[]):
        try:
            with torch.device("meta"):
                shell = registry.build("encoders", node, "encoder")
        except (
            NotImplementedError,
            RuntimeError,
            TypeError,
            PluginError,
        ):
            shell = registry.build("encoders", node, "encoder")
    # counted on the meta device, before memory is asked for
    needs = sum(x.numel() for x in shell.state_dict().values())
    if needs > _MOST:
        raise ConfigError(
            f"encoder={node['name']} would have {needs:,} weights, and at most {_MOST:,} are "
            "built; make encoder.size or encoder.depth smaller"
        )
    return shell


def _head(
    key: str, config: Mapping[str, Any], provides: AbstractSet[str], encoder: Any
) -> nn.Module:
    wanted = registry.context(registry.get("heads", config["head"][key]["name"]))
    # a tower is built where the data has something for it to encode
    towers = {
        f"{kind}_encoder": tower(config, kind)
        if kind in provides and config.get(f"{kind}_encoder")
        else None
        for kind in ("text", "image")
        if f"{kind}_encoder" in wanted
    }
    if towers and not any(towers.values()):
        raise ConfigError(
            f"head {key!r} has nothing to align with: the data has "
            f"{', '.join(sorted(provides)) or 'frames only'}; choose text_encoder= or "
            "image_encoder= for what it has"
        )
    given = {"encoder": encoder, "facts": config.get("facts") or {}, **towers}
    given["column_sizes"] = sizes_of(config)
    if "teacher" in wanted:
        given["teacher"] = _teacher(key, config)
    built: nn.Module = registry.build("heads", config["head"][key], f"head.{key}", **given)
    return built


def _teacher(key: str, config: Mapping[str, Any]) -> nn.Module:
    """Builds the image tower used as the teacher of a head."""
    if config.get("image_encoder"):
        built = tower(config, "image")
        if getattr(built, "frozen", False):
            return built
    raise ConfigError(
        f"head {key!r} learns from a pretrained image model: give image_encoder=efficientnet_lite, "
        "image_encoder=clip, or one of your own with frozen=true"
    )


def sizes_of(config: Mapping[str, Any]) -> dict[str, ColumnSize]:
    """Sizes of the extra columns of a run's batches, as passed to heads."""
    rows: Mapping[str, Any] = config.get("columns") or {}
    return {name: strict.build(ColumnSize, f"columns.{name}", row) for name, row in rows.items()}


def tower(config: Mapping[str, Any], kind: str) -> nn.Module:
    """Builds the tower for ``text`` or ``image``.

    Raises:
        ConfigError: The chosen plugin encodes another modality.
    """
    node = config[f"{kind}_encoder"]
    built: nn.Module = registry.build("encoders", node, f"{kind}_encoder")
    modality = getattr(built, "modality", "touch")
    if modality != kind:
        raise ConfigError(f"{kind}_encoder={node['name']} encodes {modality}, not {kind}")
    return built
