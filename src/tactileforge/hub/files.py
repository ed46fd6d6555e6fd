"""One-file checkpoints: written atomically, loaded strictly, free of code."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Literal

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from tactileforge.errors import ConfigError, DataError
from tactileforge.hub.file_checks import (
    NO_FIT,
    build,
    check_nodes,
    check_plugin,
    is_left_out,
    own_head,
    towers_of,
)
from tactileforge.hub.header import FORMAT, Header, read_header, seal_checkpoint
from tactileforge.hub.positions import changed_options, rebuild_encoder
from tactileforge.hub.size_limit import Allowance
from tactileforge.plugins import local, registry
from tactileforge.plugins.distributions import how_to_get
from tactileforge.util.files import disk_errors_named, new_part, sync, usual_mode

DTYPES = {"float32": torch.float32, "float16": torch.float16}


def make_header(
    encoder: Any, node: Mapping[str, Any], *, licence: str, spacing: float, **known: Any
) -> Header:
    """Builds the header of an encoder from its attributes and the given facts.

    Args:
        encoder: A touch encoder.
        node: Plugin and constructor arguments from which it was built. Options of its first weights
            are left out, and those in its ``settled`` replace others: defaults may change.
        licence: SPDX identifier of its weights.
        spacing: Seconds between the frames of a clip; 0 for one frame.
        known: Further fields of `Header`.
    """
    # from metadata; an encoder that was built in a script has no package
    plugin = next(
        (p for p in registry.list_plugins() if (p.kind, p.name) == ("encoders", node["name"])), None
    )
    node = {**node, "name": without_folders(node["name"])}
    return Header(
        **{"name": "", "dtype": "float32", **known},
        format=FORMAT,
        encoder=registry.without_start("encoders", node) | getattr(encoder, "settled", {}),
        package=plugin.distribution if plugin else "",
        package_version=plugin.version if plugin else "",
        sensors=dict(encoder.sensors),
        input=describe_input(encoder),
        spacing=float(spacing),
        licence=licence,
    )


def without_folders(value: Any) -> Any:
    """Strips folders from absolute paths: they are private and meaningless elsewhere."""
    if isinstance(value, Mapping):
        return {str(key): without_folders(item) for key, item in value.items()}
    if isinstance(value, list):
        return [without_folders(item) for item in value]
    if isinstance(value, str):
        # a model may be packed on another system than it was trained on
        for kind in (PurePosixPath, PureWindowsPath):
            if kind(value).is_absolute() or value.startswith("~"):
                return kind(value).name
    return value


def describe_input(encoder: Any) -> dict[str, Any]:
    """Describes the input of an encoder and its preprocessing, as plain data.

    Args:
        encoder: A touch encoder; see `encoders.preprocess.Preprocess`.
    """
    size: Any = encoder.image_size
    facts: dict[str, Any] = {
        "pixels": "uint8 RGB, oldest frame first",
        "frames": encoder.frames,
        "size": list(size),
    }
    steps = getattr(encoder, "pixels", None)
    for name in ("offset", "fit", "filter", "mean", "std"):
        value = getattr(steps, name, None)
        facts[name] = value.squeeze().tolist() if isinstance(value, Tensor) else value
    return facts


def save_checkpoint(
    path: str | Path,
    encoder: nn.Module,
    header: Header,
    dtype: Literal["float32", "float16"] = "float32",
    heads: Mapping[str, nn.Module] | None = None,
) -> None:
    """Writes a one-file checkpoint; the same weights and header give the same bytes.

    Args:
        path: The file.
        encoder: The encoder; its state is written.
        header: Metadata to write; see `make_header`.
        dtype: Type in which fractions are kept; they are float32 again after loading.
        heads: Heads named in the header; their state is written under ``head.NAME.``.

    Raises:
        ConfigError: An unknown type, a number that is not finite or does not fit it.
        TactileForgeError: The disk is full, or cannot be written.
    """
    if dtype not in DTYPES:
        raise ConfigError(f"dtype={dtype}: give {' or '.join(DTYPES)}")
    modules = {"": encoder, **{_of_head(name): head for name, head in (heads or {}).items()}}
    tensors = {
        prefix + name: tensor
        for prefix, module in modules.items()
        for name, tensor in module.state_dict().items()
    }
    state = {}
    for name, tensor in tensors.items():
        kept = tensor.detach().cpu()
        # whole numbers, such as counters, stay what they are
        if kept.is_floating_point():
            kept = kept.to(DTYPES[dtype])
            if not torch.isfinite(kept).all():
                raise ConfigError(
                    f"{name} has numbers that are not finite in {dtype}: "
                    + ("pack it with dtype=float32" if tensor.isfinite().all() else "train again")
                )
        # safetensors refuses tensors that share memory, or are not contiguous
        state[name] = kept.clone(memory_format=torch.contiguous_format)
    path = Path(path)
    metadata = replace(header, dtype=dtype).metadata(has_place=True)
    with disk_errors_named(path), new_part(path) as part:
        with usual_mode(part):
            save_file(state, part, metadata=metadata)
        seal_checkpoint(part)
        sync(part)
        part.replace(path)


def _of_head(name: str) -> str:
    """Prefix of the tensor names of a head."""
    return f"head.{name}."


def open_encoder(path: str | Path, frames: int | None = None) -> tuple[Any, Header]:
    """The encoder of a one-file checkpoint, and the header; see `open_model`."""
    encoder, _, header = open_model(path, frames)
    return encoder, header


def open_model(
    path: str | Path,
    frames: int | None = None,
    image_size: int | tuple[int, int] | None = None,
) -> tuple[Any, dict[str, nn.Module], Header]:
    """Builds the encoder and the heads of a one-file checkpoint and loads all weights.

    Args:
        path: The file.
        frames: Another number of frames: learned positions are interpolated over time. Heads are
            made for one number of frames and one size, and are left out then.
        image_size: Another height and width: learned positions are interpolated over the image.

    Returns:
        The encoder, float32, in eval mode, on the CPU; its heads by name, likewise; the header.

    Raises:
        DataError: See `header.read_header`; or its tensors are not those of the encoder.
        PluginError: The encoder's plugin is not installed; says what to install.
        ConfigError: The encoder takes no other number of frames, or size.
    """
    path = Path(path)
    header = read_header(path)
    check_plugin(path, header)
    check_nodes(path, header)
    # so far by the header alone: nothing of the file was built
    node = registry.without_start("encoders", header.encoder)
    # the numbers drawn here are replaced
    with torch.random.fork_rng(devices=[]), Allowance(path):
        encoder = build(path, "encoders", node)
    try:
        state = load_file(path)
    except SafetensorError as error:
        raise DataError(f"{path}: damaged: {error}; fetch or write it again") from error
    other = changed_options(encoder, frames, image_size)
    # heads were trained on clips of the encoder's own number and size of frames
    heads = {} if other else _open_heads(path, header, encoder, state)
    of_heads = tuple(map(_of_head, header.heads))
    state = {key: x for key, x in state.items() if not key.startswith(of_heads)}
    fill_weights(encoder, state, str(path))
    if other:
        encoder = rebuild_encoder(node, encoder, other)
    encoder.requires_grad_(False)
    return encoder.eval(), heads, header


def _open_heads(
    path: Path, header: Header, encoder: Any, state: Mapping[str, Tensor]
) -> dict[str, nn.Module]:
    """Builds the heads of the header, fills in their weights and freezes them."""
    heads: dict[str, nn.Module] = {}
    for name, entry in header.heads.items():
        own = entry["node"]["name"]
        if is_left_out(name, own) or (local.is_local(own) and not own_head(name, own)):
            warn_of_left(path, name, own)
            continue
        prefix = _of_head(name)
        with torch.random.fork_rng(devices=[]), Allowance(path):
            towers = towers_of(path, entry)
            head: nn.Module = build(path, "heads", entry["node"], encoder=encoder, **towers)
        own = {key.removeprefix(prefix): x for key, x in state.items() if key.startswith(prefix)}
        fill_weights(head, own, f"{path}, head {name}")
        heads[name] = head.requires_grad_(False).eval()
    return heads


def warn_of_left(path: Path, name: str, own: str) -> None:
    """Warns of a head without its class: the model is loaded without it."""
    what = f"{path}: head {name} is left out: {own} is"
    if not local.is_local(own):
        fix = how_to_get("heads", own) or "install the package that provides it"
        warnings.warn(f"{what} not installed; {fix}", stacklevel=4)
        return
    why = f"{what} {NO_FIT}"
    warnings.warn(why if local.is_given(own) else str(local.not_given(what, [own])), stacklevel=4)


def _is_finite(values: Tensor) -> bool:
    # numpy: two threads of torch that wait for each other take seconds on a busy machine
    return bool(np.isfinite(values.float().cpu().numpy()).all())


def fill_weights(encoder: nn.Module, state: Mapping[str, Tensor], where: str) -> None:
    """Loads a state strictly; the module keeps its dtypes.

    Raises:
        DataError: Tensors are missing, left over, of another shape, or hold numbers that are not
            finite; lists them.
    """
    own = encoder.state_dict()
    # all faults in one error: names that are missing and left over explain each other
    wrong = {
        "missing": sorted(own.keys() - state.keys()),
        "unexpected": sorted(state.keys() - own.keys()),
        "of another shape": [
            f"{key} ({tuple(state[key].shape)}, expected {tuple(own[key].shape)})"
            for key in sorted(own.keys() & state.keys())
            if own[key].shape != state[key].shape
        ],
        "not finite": sorted(
            key for key, x in state.items() if x.is_floating_point() and not _is_finite(x)
        ),
    }
    if any(wrong.values()):
        lines = [
            f"{len(keys)} {what}: {', '.join(keys[:5])}{' ...' * (len(keys) > 5)}"
            for what, keys in wrong.items()
            if keys
        ]
        raise DataError(f"{where}: these are not the weights of this encoder: {'; '.join(lines)}")
    # weights of a file may be float16
    encoder.load_state_dict({key: value.to(own[key].dtype) for key, value in state.items()})
