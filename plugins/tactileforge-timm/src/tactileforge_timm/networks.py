"""Networks of timm by name, without their classifier: random, or with weights of timm or a file."""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from tactileforge.errors import (
    ConfigError,
    DataError,
    DataNotFoundError,
    PluginError,
    home_path,
    nearest_name,
)

#: Keys under which training programs keep the weights in a larger file.
_WRAPPERS = ("state_dict", "state_dict_ema", "model", "model_ema", "teacher")


def timm_module() -> Any:
    """Imports timm.

    Raises:
        PluginError: timm or torchvision cannot be imported; says how to install them.
    """
    try:
        import timm
    except ImportError as error:
        raise PluginError(f"timm cannot be imported ({error}): pip install timm") from error
    except RuntimeError as error:  # operators of another build than that of torch
        raise PluginError(
            f"timm cannot be imported ({error}): its torchvision is of another build than torch; "
            "install the torchvision that https://pytorch.org names beside your torch"
        ) from error
    return timm


def create_network(
    model: str, size: tuple[int, int] | None, pretrained: bool, path: str | None
) -> Any:
    """Builds a network of timm, without its classifier.

    On the meta device nothing is read or fetched.

    Args:
        model: Name of a model of timm.
        size: Height and width of its input, pixels; None takes its own.
        pretrained: Whether it gets the weights that timm has for it, fetched at their first use.
        path: File of weights, ``.safetensors``, ``.pth`` or ``.bin``; None for none.

    Raises:
        ConfigError: timm has no such model, it takes no such size, or both ``pretrained`` and
            ``path`` are given.
        DataNotFoundError: There is no such file, or no network to fetch the weights.
        DataError: The file does not hold the weights of this model.
    """
    timm = timm_module()
    _check_name(timm, model)
    if pretrained and path:
        raise ConfigError("pretrained and path both give weights: leave one of them out")
    file = home_path(path) if path else None
    if file is not None and not file.is_file():
        raise DataNotFoundError(f"encoder.path={path}: no such file; correct the path")
    # a network on the meta device is only measured
    pretrained = pretrained and torch.get_default_device().type != "meta"
    network = _created(timm, model, size, pretrained)
    if file is not None and torch.get_default_device().type != "meta":
        load_weights(network, file)
    return network


def _check_name(timm: Any, model: str) -> None:
    if ":" in model or "/" in model:
        raise ConfigError(
            f"model={model}: give a name of timm, such as resnet18, and weights of your own as path"
        )
    architecture, _, tag = model.partition(".")
    if not timm.is_model(architecture):
        near = nearest_name(architecture, timm.list_models())
        hint = near.removeprefix(".") or "; timm.list_models() has the names"
        raise ConfigError(f"model={model}: timm {timm.__version__} has no such model{hint}")
    known = [name.partition(".")[2] for name in timm.list_pretrained(f"{architecture}.*")]
    if tag and tag not in known:
        also = f"; known: {', '.join(known)}" if known else ""
        raise ConfigError(f"model={model}: timm has no such weights of {architecture}{also}")


def _created(timm: Any, model: str, size: tuple[int, int] | None, pretrained: bool) -> Any:
    options: dict[str, Any] = {"pretrained": pretrained, "num_classes": 0}
    if pretrained and not timm.is_model_pretrained(model.partition(".")[0]):
        raise ConfigError(
            f"timm has no weights of {model}: give their file as encoder.path=FILE, or "
            "encoder.pretrained=false"
        )
    own = timm.get_pretrained_cfg(model, allow_unregistered=True)
    if size is not None and own is not None and size != tuple(own.input_size[1:]):
        # networks of fixed positions or windows are built for a size, others take any
        options |= {"img_size": size} if own.fixed_input_size else {}
    try:
        return timm.create_model(model, **options)
    except OSError as error:  # of the network, in the classes of huggingface_hub and urllib
        raise DataNotFoundError(
            f"the weights of {model} cannot be fetched ({_first_line(error)}): fetch them where "
            "there is a network and give their file as encoder.path=FILE, or take random ones, "
            "encoder.pretrained=false"
        ) from error
    except (AssertionError, RuntimeError, TypeError, ValueError) as error:
        place = f" at {size[0]} x {size[1]} pixels" if size else ""
        raise ConfigError(
            f"model={model}: timm cannot build it{place}: {_first_line(error)}"
        ) from error


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]


def load_weights(network: Any, path: Path) -> None:
    """Fills a network from a file, without executing anything in it.

    Layouts that timm translates are translated, positions are resampled to the network's size, and
    a classifier in the file is left out.

    Args:
        network: A network of timm without classifier.
        path: The file.

    Raises:
        DataError: It cannot be read, or does not hold the weights of this network; says which.
    """
    state = _translated(network, read_weights(path), path)
    own = network.state_dict()
    # a classifier of the file has no place here
    given = {key: x for key, x in state.items() if key in own or not _is_classifier(network, key)}
    shared = own.keys() & given.keys()
    wrong = {
        "missing": own.keys() - given.keys(),
        "unexpected": given.keys() - own.keys(),
        "of another shape": {key for key in shared if own[key].shape != given[key].shape},
    }
    if any(wrong.values()):
        lines = [
            f"{len(keys)} {what} ({', '.join(sorted(keys)[:3])}{', ...' * (len(keys) > 3)})"
            for what, keys in wrong.items()
            if keys
        ]
        raise DataError(f"{path}: not weights of {_name_of(network)}: {'; '.join(lines)}")
    network.load_state_dict(given)


def _name_of(network: Any) -> str:
    return str((network.pretrained_cfg or {}).get("architecture") or type(network).__name__)


def _is_classifier(network: Any, key: str) -> bool:
    named = (network.pretrained_cfg or {}).get("classifier") or ()
    names = (named,) if isinstance(named, str) else tuple(named)
    return key.rpartition(".")[0] in names


def _translated(network: Any, state: dict[str, Tensor], path: Path) -> Mapping[str, Tensor]:
    """A state in timm's layout, by the translation of the network's own module."""
    translate = getattr(import_module(type(network).__module__), "checkpoint_filter_fn", None)
    if translate is None:
        return state
    try:
        with torch.no_grad():
            done: Mapping[str, Tensor] = translate(dict(state), network)
    except Exception as error:
        raise DataError(
            f"{path}: not weights of {_name_of(network)}: timm cannot read their layout ({error!r})"
        ) from error
    return done


def read_weights(path: Path) -> dict[str, Tensor]:
    """Reads tensors by name from a file of safetensors or torch; nothing in it is executed.

    Weights wrapped by a training program (``state_dict``, ``model``) are taken out, and a prefix
    that all names have (``module.``) is taken off.

    Args:
        path: The file.

    Raises:
        DataError: It is damaged, holds more than weights, or no weights.
    """
    with path.open("rb") as file:
        start = file.read(9)
    try:
        if start[8:9] == b"{":
            found: Any = load_file(path)
        else:
            with warnings.catch_warnings():  # of pickles that no torch wrote: refused below
                warnings.simplefilter("ignore")
                found = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise DataError(
            f"{path}: holds more than weights, and is not read; save its state_dict as safetensors"
        ) from error
    except (SafetensorError, OSError, EOFError, RuntimeError, ValueError, LookupError) as error:
        raise DataError(f"{path}: cannot be read as weights ({_first_line(error)})") from error
    state = _unwrapped(found)
    if not state or not all(isinstance(x, Tensor) for x in state.values()):
        raise DataError(f"{path}: holds no weights by name; save a state_dict")
    first = next(iter(state)).partition(".")[0] + "."
    if first in ("module.", "_orig_mod.", "network.") and all(k.startswith(first) for k in state):
        state = {key.removeprefix(first): x for key, x in state.items()}
    return state


def _unwrapped(found: Any) -> dict[str, Any]:
    for key in _WRAPPERS:
        if isinstance(found, Mapping) and isinstance(found.get(key), Mapping):
            return _unwrapped(found[key])
    return dict(found) if isinstance(found, Mapping) else {}


def takes_tokens(network: Any) -> bool:
    """Whether patches of a network can be left out, and tokens added: a transformer of one width.

    Args:
        network: A network of timm.
    """
    models = import_module("timm.models")
    return isinstance(network, models.VisionTransformer | models.Eva) and hasattr(
        network, "patch_drop"
    )


def fix_norms(network: nn.Module) -> None:
    """Keeps the statistics of batch norms: the modules go to evaluation mode."""
    for part in network.modules():
        if isinstance(part, nn.modules.batchnorm._BatchNorm):
            part.eval()
