"""Builds the data of a run and the matching encoder options from a finished configuration."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from inspect import signature
from typing import Any

from tactileforge.checks.log_doubts import Examination
from tactileforge.contracts import Column
from tactileforge.data.batches.columns import declared_columns
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.data.labels.augment import Augment, build_augment
from tactileforge.errors import ConfigError, check_names
from tactileforge.plugins import registry
from tactileforge.specs.published import spec
from tactileforge.training.parts import check_encoder, check_finished, outline, plain

log = logging.getLogger(__name__)

#: Arguments of `TouchData` that are not keys of ``batch``.
_NOT_BATCH = {"dataset", "frames", "batch_size", "max_bad", "seed", "augment", "limit", "columns"}
#: Smallest value of each whole number in ``batch``.
_LEAST = {"size": 1, "window": 1, "workers": 0}


def build_data(config: Mapping[str, Any], encoder: Any = None) -> tuple[TouchData, dict[str, Any]]:
    """Builds the data of a run: indexed, and checked against the needs of the objectives.

    Args:
        config: Finished configuration; see `compose.finish`.
        encoder: Outline of its encoder, see `parts.outline`; None builds one.

    Returns:
        The data, and the configuration of the encoder. An encoder with the option ``sensors``
        gets a row for every sensor of the training data: new sensors take the free rows in
        alphabetical order, and the resolved configuration lists them.

    Raises:
        ConfigError: The configuration is not finished, or has an unknown or impossible option of
            ``batch`` or ``augment``; see also `TouchData.setup`.
    """
    config = plain(config)
    check_finished(config)
    _check(config["batch"], config.get("augment") or {})
    node = dict(config["data"])
    max_bad = node.pop("max_bad")
    dataset = registry.build("datasets", node, "data")
    encoder = encoder or outline(config["encoder"])
    check_encoder(encoder, config["encoder"]["name"])
    batch = dict(config["batch"])
    objectives = {
        key: registry.get("objectives", node["name"]) for key, node in config["objective"].items()
    }
    if not any(getattr(plugin, "pairs", False) for plugin in objectives.values()):
        batch["match"] = 0.0  # no objective learns from pairs
    data = TouchData(
        dataset,
        frames=encoder.frames,
        size=encoder.image_size,
        batch_size=batch.pop("size"),
        seed=config["seed"],
        max_bad=max_bad,
        augment=build_augment(_with_changes(config.get("augment"))),
        limit=limit_of(config["trainer"]),
        columns=_columns(config),
        **batch,
    )
    data.examiner = Examination()
    needs = {key: plugin.needs for key, plugin in objectives.items()}
    data.check(needs)  # by what the data set declares, before hours of reading
    data.setup()
    data.check(needs)  # by what its recordings have
    names = data.summary("train").sensors
    if "sensors" not in registry.parameters(registry.get("encoders", config["encoder"]["name"])):
        return data, dict(config["encoder"])
    # a sensor that the encoder does not know yet takes the next free row of its table
    table = dict(encoder.sensors)
    free = (row for row in range(len(table) + len(names) + 1) if row not in table.values())
    new = {spec(name).name: next(free) for name in names if name not in table}
    return data, {**config["encoder"], "sensors": table | new}


def _columns(config: Mapping[str, Any]) -> tuple[Column, ...]:
    """Extra columns of the batch, declared by the heads and objectives of a run."""
    nodes = [
        (f"{kind} {key!r}", registry.get(f"{kind}s", node["name"]), node)
        for kind in ("head", "objective")
        for key, node in config[kind].items()
    ]
    return declared_columns(
        (what, plugin, {k: v for k, v in node.items() if k not in ("name", "weight")})
        for what, plugin, node in nodes
    )


def limit_of(trainer: Mapping[str, Any]) -> float:
    """Reads ``limit_train_batches``: a number of batches (int) or a share of them (float).

    The data applies the limit in place of Lightning, so that its epochs are as long as those of
    the run. 1.0 without a limit.

    Raises:
        ConfigError: The limit is neither a whole number nor a share.
    """
    limit = trainer.get("limit_train_batches")
    limit = 1.0 if limit is None else limit
    good = isinstance(limit, int | float) and not isinstance(limit, bool) and limit > 0
    if not good or (isinstance(limit, float) and limit > 1):
        raise ConfigError(
            f"trainer.limit_train_batches={limit}: give a whole number of batches, or a share, "
            "above 0 and up to 1.0"
        )
    return float(limit) if isinstance(limit, float) else int(limit)


def _with_changes(augment: Mapping[str, Any] | None) -> dict[str, Any]:
    """Options of the augmentation, with the changes of others built."""
    options = dict(augment or {})
    if nodes := options.pop("also", None):
        kept = {key: {"name": key, **node} for key, node in nodes.items() if node is not None}
        options["also"] = {key: _change(key, node) for key, node in kept.items()}
    return options


def _change(key: str, node: Mapping[str, Any]) -> Any:
    """A change of batches, built.

    Raises:
        ConfigError: It cannot be called.
    """
    made = registry.build("augmentations", node, f"augment.also.{key}")
    if not callable(made):
        raise ConfigError(
            f"augment.also.{key}: {node['name']} gives a {type(made).__name__}, which has no "
            "__call__: give a class whose instance takes a batch and returns it"
        )
    return made


def check_blocks(batch: Mapping[str, Any], augment: Mapping[str, Any]) -> None:
    """Raises a ConfigError about an unread key of ``batch`` or ``augment``."""
    own = {"size", *signature(TouchData).parameters} - _NOT_BATCH
    check_names("key of batch", batch, own)
    check_names("key of augment", augment, set(signature(Augment).parameters))


def _check(batch: Mapping[str, Any], augment: Mapping[str, Any]) -> None:
    check_blocks(batch, augment)
    for key, least in _LEAST.items():
        value = batch.get(key, least)
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise ConfigError(f"batch.{key}={value}: give a whole number, {least} or more")
