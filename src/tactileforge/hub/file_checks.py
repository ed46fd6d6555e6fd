"""Checks of a model file by its header alone, before anything is built."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from torch import nn

from tactileforge.encoders.absent import AbsentTower
from tactileforge.errors import DataError, PluginError, TactileForgeError
from tactileforge.hub.header import Header
from tactileforge.plugins import local, registry
from tactileforge.plugins.distributions import install_command, package_of

#: Arguments that name files or places on a network.
_PLACES = frozenset({"path", "root", "file", "folder", "url", "repo", "port"})
#: Arguments that count modules, each of which has a tensor at least.
_STACKS = frozenset({"depth", "stem_depth", "stems"})
#: What is wrong with a class of the user's own that `own_head` refuses.
NO_FIT = "no class of a head of this name that is made of the encoder alone"
#: Largest number among the arguments of a model.
_LARGEST = 8192


def check_plugin(path: Path, header: Header) -> None:
    """Raises a PluginError with the install command if the encoder is not installed."""
    name = header.encoder["name"]
    if name in registry.names("encoders") or local.is_local(name):
        return  # a class of somebody's own is looked up where it is built, and never imported
    package = package_of("encoders", name) or header.package  # it may have moved since
    # a name from a file stands in a command that a user may copy
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", package):
        package = f"tactileforge-{name}"
    raise PluginError(
        f"{path} needs the encoder {name!r} of {package} {header.package_version}: "
        f"{install_command(package)}"
    )


def check_nodes(path: Path, header: Header) -> None:
    """Checks the arguments of encoder and heads before any of them is built.

    Raises:
        DataError: An argument names a file or a place on the network, is larger than that of any
            model, or the plugin reads files where it is built.
    """
    try:
        with safe_open(path, "pt") as file:
            tensors = len(file.keys())
    except SafetensorError as error:
        raise DataError(f"{path}: damaged: {error}; fetch or write it again") from error
    for kind, node in [
        ("encoders", header.encoder),
        *(
            ("heads", entry["node"])
            for key, entry in header.heads.items()
            if not is_left_out(key, entry["node"]["name"])
        ),
        *(
            ("encoders", row["text_encoder"])
            for row in header.heads.values()
            if "text_encoder" in row
        ),
    ]:
        check_arguments(path, node)
        for key, value in node.items():
            # a larger number could only be damage or malice, and would build for ever
            if key in _STACKS and isinstance(value, int) and value > tensors:
                raise DataError(
                    f"{path}: {node['name']}.{key} is {value}, and the file has {tensors} tensors; "
                    "fetch it again"
                )
        plugin = registry.get(kind, node["name"])
        if "constructing does no io" in getattr(plugin, "expected_failures", {}):
            raise DataError(
                f"{path}: {node['name']} reads other files where it is built, and a model file "
                "names none; fetch it again from somebody you trust"
            )


def is_left_out(key: str, head: str) -> bool:
    """Whether a head of a file is left out, see `files.warn_of_left`: its class is not at hand.

    Args:
        key: Name of the head; by that of an installed one another class is damage.
        head: Name of its class.
    """
    if local.is_local(head):
        return not local.is_given(head)
    return not {head, key} & {*registry.names("heads")}


def of_package(head: str) -> bool:
    """Whether a head comes with a package beside the core, and is made of the encoder alone."""
    owners = {
        one.distribution
        for one in registry.list_plugins()
        if (one.kind, one.name) == ("heads", head)
    }
    if not owners or "tactileforge" in owners:
        return False
    return registry.context(registry.get("heads", head)) <= {"encoder"}


def own_head(key: str, name: str) -> bool:
    """Whether a head by a class of the user's own was given, and can be kept in a file.

    It is made of the encoder alone. Beside a head of that name that `Model` reads, it is one too.

    Args:
        key: Name of the head.
        name: Name of its class, such as ``my_module:TwoCrops``.
    """
    if not local.is_given(name):
        return False
    plugin = registry.get("heads", name)
    usual = registry.get("heads", key) if key in registry.names("heads") else object
    fits = isinstance(plugin, type) and issubclass(plugin, usual)
    return fits and registry.context(plugin) <= {"encoder"}


def check_arguments(where: str | Path, node: Mapping[str, Any]) -> None:
    """Checks the arguments of a part of a model for files, addresses and numbers without end.

    Args:
        where: The file or the part, for errors.
        node: ``{"name": ..., **arguments}``.

    Raises:
        DataError: There is one.
    """
    # a name of somebody's own is looked up among what was given, and never imported
    free = ("name",) if local.is_local(node["name"]) else ()
    for key in node.keys() - {*free}:
        _check_argument(where, f"{node['name']}.{key}", node[key])


def _check_argument(path: str | Path, where: str, value: Any) -> None:
    if isinstance(value, Mapping | list):
        inner = value.items() if isinstance(value, Mapping) else enumerate(value)
        for key, item in inner:
            _check_argument(path, f"{where}.{key}", item)
    name = where.rpartition(".")[2]
    # characters without which there is no path and no address
    is_place = (name in _PLACES and value) or (isinstance(value, str) and set(value) & set("/\\:~"))
    if is_place:
        raise DataError(f"{path}: {where} is {value!r}: a model file names no file and no address")
    if isinstance(value, int | float) and not abs(value) <= _LARGEST:
        raise DataError(f"{path}: {where} is {value!r}, larger than in any model")


def build(path: Path, kind: str, node: Mapping[str, Any], **given: Any) -> Any:
    """Builds a plugin from the arguments in a file's header; see `registry.build`.

    Raises:
        DataError: The plugin cannot be built from them.
        TactileForgeError: The registry refuses the arguments; see `registry.build`.
        NotImplementedError: The plugin needs its numbers while it is built, and there are none.
        RuntimeError: For the same reason as NotImplementedError.
    """
    try:
        return registry.build(kind, node, **given)
    except (TactileForgeError, NotImplementedError, RuntimeError):
        raise
    except Exception as error:
        raise DataError(
            f"{path}: {node['name']} cannot be built from its header ({error!r}); fetch it again"
        ) from error


def towers_of(path: Path, entry: Mapping[str, Any]) -> dict[str, Any]:
    """The towers requested by an entry of a header, by constructor argument.

    Args:
        path: The file, for errors.
        entry: Entry of the head; see `Header.heads`.

    Raises:
        DataError: The tower is not one of text, or cannot be built.
    """
    if "text_width" in entry:
        tower: nn.Module = AbsentTower(entry["text_width"], entry.get("text_name", "clip"))
    elif "text_encoder" in entry:
        tower = build(path, "encoders", entry["text_encoder"])
        if getattr(tower, "modality", "touch") != "text":
            name = entry["text_encoder"]["name"]
            raise DataError(f"{path}: its text tower {name} encodes no text; fetch it again")
    else:
        return {}
    return {"text_encoder": tower, "image_encoder": None}
