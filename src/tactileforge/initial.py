"""Weights that a run starts from, ``init=``: a model, another run, photographs, or two of them."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

from torch import Tensor

from tactileforge import registry, run_folder
from tactileforge.checkpoint_file import find_checkpoint, read_checkpoint
from tactileforge.errors import ConfigError
from tactileforge.hub.starting_point import (
    imagenet_weights,
    starting_heads,
    starting_weights,
)

log = logging.getLogger(__name__)


def start_from(plain: dict[str, Any]) -> Mapping[str, Tensor] | None:
    """Weights that a run starts from; the encoder of a model of the zoo is taken with its options.

    What an encoder does in training alone, as how much it masks, stays that of the run.

    Returns:
        None where all are random.

    Raises:
        ConfigError: There are no such weights, or they do not go with the encoder.
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
        return _add_photo_stream(plain)
    state = _weights_of(init, plain)
    if not beside:
        return state
    if any(key.startswith("encoder.photo_stream.") for key in state):
        raise ConfigError(f"init={plain['init']}: {init} has such a stream; give init={init}")
    return {**state, **_add_photo_stream(plain)}


def new_in(init: str) -> tuple[str, ...]:
    """Prefixes of the encoder tensors that the weights of ``init=`` need not have."""
    if init == run_folder.IMAGENET:
        return ("encoder.",)
    return ("encoder.photo_stream.project.",) if run_folder.with_photographs(init)[1] else ()


def _add_photo_stream(plain: dict[str, Any]) -> dict[str, Tensor]:
    """Gives the encoder a photo stream; returns its weights."""
    node = plain["encoder"]
    if "photo_stream" not in node and node["name"] != "tactile_vit":
        raise ConfigError(
            f"init={plain['init']}: encoder={node['name']} has no stream that looks at touch as at "
            "photographs; give encoder=tactile_vit"
        )
    node["photo_stream"] = True
    return imagenet_weights()


def _weights_of(init: str, plain: dict[str, Any]) -> Mapping[str, Tensor]:
    """Weights of a run or a model; the encoder is made to go with them."""
    if run_folder.is_run(init):
        state: Mapping[str, Tensor] = read_checkpoint(init)["state_dict"]
        _go_on_with(plain["encoder"], init)
        return state
    node, state = starting_weights(init)
    same = plain["encoder"]["name"] == node["name"]
    kept = {
        key: plain["encoder"][key]
        for key in run_folder.OF_TRAINING
        if same and key in plain["encoder"]
    }
    plain["encoder"] = node | kept
    log.info("init: the encoder and its options are those of %s", init)
    return state


def _config_of(init: str) -> dict[str, Any] | None:
    """Configuration of a run, or of the run that a checkpoint belongs to; None of a file alone."""
    folder = find_checkpoint(init).resolve().parents[1]
    return run_folder.read_config(folder) if (folder / run_folder.CONFIG).is_file() else None


def _go_on_with(encoder: dict[str, Any], init: str) -> None:
    """Gives sensors the rows that they have in the run that is started from, by its name.

    Warns of other options that change what its weights compute.
    """
    config = _config_of(init)
    if config is None or config["encoder"]["name"] != encoder["name"]:
        return
    before = config["encoder"]
    if before.get("sensors") and not encoder.get("sensors"):
        encoder["sensors"] = dict(before["sensors"])
    other = sorted(
        key
        for key in (before.keys() | encoder.keys()) - {"sensors", *run_folder.OF_TRAINING}
        if before.get(key) != encoder.get(key)
    )
    if other:
        log.warning(
            "init: the encoder of %s was trained with %s",
            init,
            ", ".join(f"encoder.{key}={before.get(key)} (now {encoder.get(key)})" for key in other),
        )


def warn_of_dropped(plain: Mapping[str, Any], left: Sequence[str]) -> None:
    """Warns of parts of the weights of ``init=`` that the run does not take, and why.

    Args:
        plain: Configuration of the run.
        left: See `checkpoint_file.left_out`.
    """
    if not left:
        return
    init, _ = run_folder.with_photographs(str(plain["init"]))
    known = _config_of(init) if run_folder.is_run(init) else {"head": starting_heads(init)}
    before = known or {}
    keys = sorted({part.partition(".")[2] for part in left})
    gone = [key for key in keys if key not in plain["objective"]]
    said = [f"objective=[{','.join(plain['objective'])}] has no {', '.join(gone)}"] if gone else []
    for key in keys:
        if key not in gone:
            said.append(", ".join(_changed(key, before, plain)) or f"another shape of {key}")
    log.warning(
        "init: %s of %s not taken: %s; give what it was trained with to keep them",
        ", ".join(left),
        init,
        "; ".join(said),
    )


def _changed(key: str, before: Mapping[str, Any], plain: Mapping[str, Any]) -> list[str]:
    """Options of a head, its objective and its towers that were others."""
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
        for option in sorted((old.keys() | new.keys()) - {"weight"}):
            if old.get(option) != new.get(option):
                found.append(f"{name}.{option}={new.get(option)} (there {old.get(option)})")
    return found


def check_facts(config: Mapping[str, Any]) -> None:
    """Names a run that this one starts from, and whose heads were built for other data.

    Raises:
        ConfigError: A fact that a head keeps (`contracts.Head`) is another one.
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
