"""One-file checkpoints: written atomically, loaded strictly, free of code."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from tactileforge import registry
from tactileforge.errors import ConfigError, DataError, PluginError, TactileForgeError
from tactileforge.files import new_part
from tactileforge.hub.header import FORMAT, Header, read_header, seal_checkpoint

#: Arguments that name files or places on a network.
_PLACES = frozenset({"path", "root", "file", "folder", "url", "repo", "port"})
#: Largest number among the arguments of a model.
_LARGEST = 8192
DTYPES = {"float32": torch.float32, "float16": torch.float16}


def make_header(
    encoder: Any, node: Mapping[str, Any], *, licence: str, spacing: float, **known: Any
) -> Header:
    """Builds the header of an encoder from its attributes and the given facts.

    Args:
        encoder: A touch encoder.
        node: Plugin and constructor arguments from which it was built.
        licence: SPDX identifier of its weights.
        spacing: Seconds between the frames of a clip; 0 for one frame.
        known: Further fields of `Header`.
    """
    plugin = next((p for p in registry.list_plugins() if _is(p, node["name"])), None)
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
    return Header(
        **{"name": "", "dtype": "float32", **known},
        format=FORMAT,
        encoder=dict(node),
        package=plugin.distribution if plugin else "",
        package_version=plugin.version if plugin else "",
        sensors=dict(encoder.sensors),
        input=facts,
        spacing=float(spacing),
        licence=licence,
    )


def _is(plugin: registry.PluginInfo, name: str) -> bool:
    return plugin.kind == "encoders" and plugin.name == name


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
        encoder: Its state is kept.
        header: See `make_header`.
        dtype: Type in which fractions are kept; they are float32 again after loading.
        heads: Those that the header names; their state is kept under ``head.NAME.``.

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
        if kept.is_floating_point():
            kept = kept.to(DTYPES[dtype])
            if not torch.isfinite(kept).all():
                raise ConfigError(
                    f"{name} has numbers that are not finite in {dtype}: "
                    + ("pack it with dtype=float32" if tensor.isfinite().all() else "train again")
                )
        state[name] = kept.clone(memory_format=torch.contiguous_format)
    path = Path(path)
    metadata = replace(header, dtype=dtype).metadata(has_place=True)
    with new_part(path) as part:
        try:
            save_file(state, part, metadata=metadata)
        except SafetensorError as error:  # a full disk, for one
            raise TactileForgeError(
                f"{path}: cannot be written ({error}); make room, and go on"
            ) from error
        seal_checkpoint(part)
        with part.open("rb+") as file:
            os.fsync(file.fileno())
        part.replace(path)


def _of_head(name: str) -> str:
    """Prefix of the tensor names of a head."""
    return f"head.{name}."


def open_encoder(path: str | Path, frames: int | None = None) -> tuple[Any, Header]:
    """The encoder of a one-file checkpoint, and the header; see `open_model`."""
    encoder, _, header = open_model(path, frames)
    return encoder, header


def open_model(
    path: str | Path, frames: int | None = None
) -> tuple[Any, dict[str, nn.Module], Header]:
    """Builds the encoder and the heads of a one-file checkpoint and loads all weights.

    Args:
        path: The file.
        frames: Another number of frames: learned positions are interpolated over time. Heads are
            made for one number of frames, and are left out then.

    Returns:
        The encoder, float32, in eval mode, on the CPU; its heads by name, likewise; the header.

    Raises:
        DataError: See `header.read_header`; or its tensors are not those of the encoder.
        PluginError: The encoder's plugin is not installed; says what to install.
        ConfigError: The encoder takes no other number of frames.
    """
    path = Path(path)
    header = read_header(path)
    check_plugin(path, header)
    check_nodes(path, header)
    node = dict(header.encoder)
    with torch.random.fork_rng(devices=[]):  # the numbers drawn here are replaced
        encoder = registry.build("encoders", node)
        other = frames is not None and frames != encoder.frames
        if other:
            before = encoder
            encoder = _with_frames(node, before.frames, frames)
    try:
        state = load_file(path)
    except SafetensorError as error:
        raise DataError(f"{path}: damaged: {error}; fetch or write it again") from error
    heads = {} if other else _open_heads(path, header, encoder, state)
    state = {key: x for key, x in state.items() if not _is_of_head(key, header)}
    if other:
        fill_weights(before, state, str(path))
        state = _over_time(before, encoder)
    fill_weights(encoder, state, str(path))
    encoder.requires_grad_(False)
    return encoder.eval(), heads, header


def _is_of_head(key: str, header: Header) -> bool:
    return any(key.startswith(_of_head(name)) for name in header.heads)


def _open_heads(
    path: Path, header: Header, encoder: Any, state: Mapping[str, Tensor]
) -> dict[str, nn.Module]:
    """The heads that the header names, filled and frozen."""
    heads: dict[str, nn.Module] = {}
    for name, entry in header.heads.items():
        prefix = _of_head(name)
        with torch.random.fork_rng(devices=[]):
            head: nn.Module = registry.build("heads", entry["node"], encoder=encoder)
        own = {key.removeprefix(prefix): x for key, x in state.items() if key.startswith(prefix)}
        fill_weights(head, own, f"{path}, head {name}")
        heads[name] = head.requires_grad_(False).eval()
    return heads


def fill_weights(encoder: nn.Module, state: Mapping[str, Tensor], where: str) -> None:
    """Loads a state strictly; the module keeps its dtypes.

    Raises:
        DataError: Tensors are missing, left over or of another shape; lists them.
    """
    own = encoder.state_dict()
    wrong = {
        "missing": sorted(own.keys() - state.keys()),
        "unexpected": sorted(state.keys() - own.keys()),
        "of another shape": [
            f"{key} ({tuple(state[key].shape)}, expected {tuple(own[key].shape)})"
            for key in sorted(own.keys() & state.keys())
            if own[key].shape != state[key].shape
        ],
    }
    if any(wrong.values()):
        lines = [
            f"{len(keys)} {what}: {', '.join(keys[:5])}{' ...' * (len(keys) > 5)}"
            for what, keys in wrong.items()
            if keys
        ]
        raise DataError(f"{where}: these are not the weights of this encoder: {'; '.join(lines)}")
    encoder.load_state_dict({key: value.to(own[key].dtype) for key, value in state.items()})


def check_plugin(path: Path, header: Header) -> None:
    """Raises a PluginError with the install command where the encoder is not installed."""
    name = header.encoder["name"]
    if name in registry.names("encoders"):
        return
    package = header.package
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", package):
        package = f"tactileforge-{name}"
    raise PluginError(
        f"{path} needs the encoder {name!r} of {package} {header.package_version}: "
        f"pip install {package}"
    )


def check_nodes(path: Path, header: Header) -> None:
    """Checks what the file would have built, before anything is.

    Raises:
        DataError: An argument names a file or a place on the network, is larger than that of any
            model, or the plugin reads files where it is built; or the model is larger than the
            file.
    """
    for kind, node in [
        ("encoders", header.encoder),
        *(("heads", entry["node"]) for entry in header.heads.values()),
    ]:
        for key, value in node.items():
            _check_argument(path, f"{node['name']}.{key}", value)
        plugin = registry.get(kind, node["name"])
        if "constructing does no io" in getattr(plugin, "expected_failures", {}):
            raise DataError(
                f"{path}: {node['name']} reads other files where it is built, and a model file "
                "names none; fetch it again from somebody you trust"
            )
    _check_total(path, header)


def _check_argument(path: Path, where: str, value: Any) -> None:
    if isinstance(value, Mapping | list):
        inner = value.items() if isinstance(value, Mapping) else enumerate(value)
        for key, item in inner:
            _check_argument(path, f"{where}.{key}", item)
    name = where.rpartition(".")[2]
    is_place = (name in _PLACES and value) or (isinstance(value, str) and set(value) & set("/\\:~"))
    if is_place:
        raise DataError(f"{path}: {where} is {value!r}: a model file names no file and no address")
    if isinstance(value, int | float) and not abs(value) <= _LARGEST:
        raise DataError(f"{path}: {where} is {value!r}, larger than in any model")


def _check_total(path: Path, header: Header) -> None:
    """Builds without memory, and compares with what the file has."""
    try:
        with torch.device("meta"), torch.random.fork_rng(devices=[]):
            shell = registry.build("encoders", header.encoder)
    except (NotImplementedError, RuntimeError):  # a plugin that needs its numbers where it is built
        return
    needs = sum(x.numel() for x in shell.state_dict().values())
    if needs > path.stat().st_size:  # a byte a number, at least
        raise DataError(
            f"{path}: the model it describes has {needs:,} numbers, and the file "
            f"{path.stat().st_size:,} bytes; fetch it again"
        )


def _with_frames(node: dict[str, Any], before: int, frames: int | None) -> Any:
    if "frames" not in registry.parameters(registry.get("encoders", node["name"])):
        raise ConfigError(
            f"frames={frames}: the encoder {node['name']!r} takes {before} frames and no other "
            "number; leave frames out"
        )
    return registry.build("encoders", node | {"frames": frames})


def _over_time(before: Any, after: Any) -> dict[str, Tensor]:
    """The state for another number of slots: learned positions are interpolated linearly."""
    wanted: Mapping[str, Tensor] = after.state_dict()
    cells = before.grid[1] * before.grid[2]
    state: dict[str, Tensor] = before.state_dict()
    changed: dict[str, Tensor] = {}
    for key, value in state.items():
        if key not in wanted or wanted[key].shape == value.shape:
            continue
        head = len(value) - before.grid[0] * cells
        length = head + after.grid[0] * cells
        if value.ndim != 2 or head < 0 or len(wanted[key]) != length:
            raise ConfigError(f"{key}: cannot be interpolated over time; leave frames out")
        table = value[head:].view(before.grid[0], cells, -1).permute(1, 2, 0)
        table = nn.functional.interpolate(table, after.grid[0], mode="linear")
        changed[key] = torch.cat([value[:head], table.permute(2, 0, 1).flatten(0, 1)])
    if not changed:
        raise ConfigError("the encoder has no learned positions over time; leave frames out")
    return state | changed
