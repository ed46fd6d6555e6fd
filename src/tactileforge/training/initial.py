"""Initial weights of a run, ``init=``: a model, another run, photographs, or two of them."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

from torch import Tensor

from tactileforge.errors import ConfigError, DataNotFoundError
from tactileforge.hub.starting_point import (
    imagenet_weights,
    inflated,
    starting_heads,
    starting_weights,
)
from tactileforge.plugins import registry
from tactileforge.runs import folder as run_folder
from tactileforge.runs.checkpoint_file import find_checkpoint, read_checkpoint

log = logging.getLogger(__name__)

#: The network of photographs beside what learns, by encoder.
_STREAMS = {"tactile_vit": "photo_stream.network", "tactile_cnn": "photographs"}


def start_from(plain: dict[str, Any]) -> Mapping[str, Tensor] | None:
    """Reads the initial weights of a run, and adapts its encoder options to them.

    The encoder of a zoo model is taken with its options. Options that matter in training alone,
    such as the mask ratio, stay those of the run.

    Args:
        plain: Configuration of the run; its ``encoder`` is changed.

    Returns:
        Tensors by name; None if all weights are random.

    Raises:
        ConfigError: The weights do not exist, or do not fit the encoder.
    """
    if not plain.get("init"):
        if plain["encoder"].get("photo_stream"):
            raise ConfigError(
                "encoder.photo_stream has random weights, which training leaves as they are; give "
                f"init={run_folder.IMAGENET}, or a model or run that has such a stream"
            )
        return None
    init, beside = run_folder.with_photographs(str(plain["init"]))
    if init == run_folder.IMAGENET:
        if plain["encoder"]["name"] != "tactile_cnn":
            return _add_photo_stream(plain)
        own = imagenet_weights("encoder.network")  # is that network itself
        return own | (_add_photo_stream(plain) if plain["encoder"].get("photo_stream") else {})
    state = _weights_of(init, plain)
    if not beside:
        return state
    streams = tuple(f"encoder.{prefix}." for prefix in _STREAMS.values())
    if any(key.startswith(streams) for key in state):
        raise ConfigError(f"init={plain['init']}: {init} has such a stream; give init={init}")
    return {**state, **_add_photo_stream(plain)}


def new_in(init: str, state: Mapping[str, Tensor]) -> tuple[str, ...]:
    """Prefixes of the encoder tensors not required of the weights of ``init=``.

    Args:
        init: The option.
        state: Its weights. A network of pictures knows no sensors.
    """
    if init == run_folder.IMAGENET:
        return ("encoder.",)
    beside = run_folder.with_photographs(init)[1]
    new = ("encoder.photo_stream.project.",) if beside else ()
    return new if "encoder.sensor_table" in state else (*new, "encoder.sensor_table")


def _add_photo_stream(plain: dict[str, Any]) -> dict[str, Tensor]:
    """Gives the encoder a photo stream; returns its weights."""
    node = plain["encoder"]
    if "photo_stream" not in node and node["name"] not in _STREAMS:
        raise ConfigError(
            f"init={plain['init']}: encoder={node['name']} has no stream that looks at touch as at "
            "photographs; give encoder=tactile_vit"
        )
    node["photo_stream"] = True
    return imagenet_weights(f"encoder.{_STREAMS.get(node['name'], _STREAMS['tactile_vit'])}")


def _weights_of(init: str, plain: dict[str, Any]) -> Mapping[str, Tensor]:
    """Weights of a run or a model; adapts the encoder options to them."""
    if run_folder.is_run(init):
        state: Mapping[str, Tensor] = read_checkpoint(init)["state_dict"]
        _go_on_with(plain["encoder"], init)
        return state
    try:
        node, state = starting_weights(init)
    except (ConfigError, DataNotFoundError) as error:
        raise type(error)(f"init={init}: {error}; random weights: init=null") from error
    same = plain["encoder"]["name"] == node["name"]
    if same and node.get("frames") == 1 < plain["encoder"].get("frames", 1):
        return inflated(init, node, state, plain["encoder"])
    # the table of sensors comes with the weights; options of training stay those of the new run
    kept = {
        key: plain["encoder"][key]
        for key in run_folder.OF_TRAINING
        if same and key in plain["encoder"]
    }
    plain["encoder"] = node | kept
    log.info("init: the encoder and its options are those of %s", init)
    return state


def _config_of(init: str) -> dict[str, Any] | None:
    """Configuration of a run, by its folder or a checkpoint; None for a file outside of a run."""
    folder = find_checkpoint(init).resolve().parents[1]
    return run_folder.read_config(folder) if (folder / run_folder.CONFIG).is_file() else None


def _go_on_with(encoder: dict[str, Any], init: str) -> None:
    """Takes over the sensor table of the initial run, unless the configuration has one.

    Warns of other options with a different value, because they change what the weights compute.
    """
    config = _config_of(init)
    if config is None or config["encoder"]["name"] != encoder["name"]:
        return
    before = registry.without_start("encoders", config["encoder"])
    # rows of the table belong to the weights: another order would mix sensors up
    if before.get("sensors") and not encoder.get("sensors"):
        encoder["sensors"] = dict(before["sensors"])
    now = registry.without_start("encoders", encoder)
    other = sorted(
        key
        for key in (before.keys() | now.keys()) - {"sensors", *run_folder.OF_TRAINING}
        if before.get(key) != now.get(key)
    )
    if other:
        log.warning(
            "init: the encoder of %s was trained with %s",
            init,
            ", ".join(f"encoder.{key}={before.get(key)} (now {now.get(key)})" for key in other),
        )


def warn_of_dropped(plain: Mapping[str, Any], left: Sequence[str]) -> None:
    """Warns of weights of ``init=`` not taken by the run, with the reasons.

    Args:
        plain: Configuration of the run.
        left: Parts not taken; see `checkpoint_file.left_out`.
    """
    if not left:
        return
    init, _ = run_folder.with_photographs(str(plain["init"]))
    known = _config_of(init) if run_folder.is_run(init) else {"head": starting_heads(init)}
    before = known or {}
    # an objective that is not chosen explains its head; other heads differ in options, or in shape
    keys = sorted({part.partition(".")[2] for part in left})
    gone = [key for key in keys if key not in plain["objective"]]
    reasons = []
    if gone:
        chosen = ",".join(plain["objective"])
        reasons.append(f"objective=[{chosen}] has no {', '.join(gone)}")
    for key in keys:
        if key not in gone:
            reasons.append(", ".join(_changed(key, before, plain)) or f"another shape of {key}")
    log.warning(
        "init: %s of %s not taken: %s; give what it was trained with to keep them",
        ", ".join(left),
        init,
        "; ".join(reasons),
    )


def _changed(key: str, before: Mapping[str, Any], plain: Mapping[str, Any]) -> list[str]:
    """Options of a head, its objective and its towers with another value than before."""
    places = ((f"head.{key}", "head"), (f"objective.{key}", "objective"))
    pairs = [
        (name, before.get(group, {}).get(key), plain[group].get(key)) for name, group in places
    ]
    for kind in ("text_encoder", "image_encoder"):
        pairs.append((kind, before.get(kind), plain.get(kind)))
    found = []
    for name, old, new in pairs:
        old, new = dict(old or {}), dict(new or {})
        if not old or (name.startswith("objective") and not new):
            continue
        # a weight scales a loss, and changes no tensor
        for option in sorted((old.keys() | new.keys()) - {"weight"}):
            if old.get(option) != new.get(option):
                found.append(f"{name}.{option}={new.get(option)} (there {old.get(option)})")
    return found


def check_facts(config: Mapping[str, Any]) -> None:
    """Checks the initial run for heads built for other data.

    Raises:
        ConfigError: A fact fixed by a head (``fixed_facts`` of `contracts.Head`) differs between
            the runs.
    """
    init, _ = run_folder.with_photographs(str(config["init"] or ""))
    if not config["facts"] or not init or not run_folder.is_run(init):
        return
    before = (_config_of(init) or {}).get("facts") or {}
    for key, node in config["head"].items():
        fixed: Sequence[str] = getattr(registry.get("heads", node["name"]), "fixed_facts", ())
        for name in fixed:
            old, new = before.get(name), config["facts"].get(name)
            if name in before and old != new:
                raise ConfigError(
                    f"init={init}: head {key!r} was trained on data whose {name} is {old}, and "
                    f"that of this data is {new}; give data like it, or leave init= out"
                )
