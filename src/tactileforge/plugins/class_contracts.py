"""Contracts of plugin classes: members of each kind, and free names of options."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from inspect import Parameter, signature
from typing import Any

from tactileforge.errors import PluginError

#: Methods and attributes that a class of each kind needs, beside its constructor.
_CONTRACTS = {
    "sensors": ("discover", "open", "read", "close"),
    "datasets": ("recordings", "provides"),
    "encoders": ("forward",),
    "heads": ("forward",),
    "objectives": ("head", "needs", "forward"),
    "optimizers": ("build",),
    "callbacks": ("on_train_start", "state_dict"),
    "loggers": ("log_metrics", "log_hyperparams"),
}
#: Parameters of a `torch.optim.Optimizer` chosen by the framework, or without a meaning here.
OF_OPTIMIZER = ("params", "fused", "foreach", "capturable", "differentiable")
#: Keys of the framework beside the options of a plugin, by kind; ``name`` and ``_target_`` are
#: those of every kind.
RESERVED = {
    "datasets": frozenset({"max_bad"}),
    "objectives": frozenset({"weight"}),
    "optimizers": frozenset({"warmup", "schedule", "clip", "layer_decay", "rates"}),
}
#: What networks have by which they are told apart, for one that is given in place of another.
_IN_PLACE_OF = {
    "encoders": (
        "an encoder has forward(frames, background, sensor), frames, image_size, sensors, width, "
        "projected and views, see Encoder of tactileforge.contracts; derive it from Backbone or "
        "ConvBackbone of tactileforge.encoders"
    ),
    "heads": (
        "a head is made as head(encoder) and has forward(views, batch), see Head of "
        "tactileforge.contracts"
    ),
}


def parameters(plugin: type[Any]) -> dict[str, Any]:
    """The configuration of a plugin: its constructor's parameters and their defaults.

    Parameters in `contracts.CONTEXT`, and those of an optimizer of torch that the framework
    chooses, are left out; one without a default maps to `inspect.Parameter.empty`.
    """
    from tactileforge.contracts import CONTEXT  # imports numpy, which listing does without

    if not isinstance(plugin, type) and not inspect.isroutine(plugin):
        return {}  # a finished instance
    left = {*CONTEXT, *(OF_OPTIMIZER if hasattr(plugin, "zero_grad") else ())}
    return {
        parameter.name: parameter.default
        for parameter in signature(plugin).parameters.values()
        if parameter.name not in left
        and parameter.kind in (Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)
    }


def context(plugin: type[Any]) -> frozenset[str]:
    """The constructor parameters of a plugin filled in by the framework."""
    from tactileforge.contracts import CONTEXT

    if not isinstance(plugin, type) and not inspect.isroutine(plugin):
        return frozenset()
    return CONTEXT & set(signature(plugin).parameters)


def check_contract(kind: str, plugin: Any, what: str) -> None:
    """Checks a class for the members of its kind, and for options with reserved names.

    Args:
        kind: Kind of plugin that is wanted.
        plugin: The class, or a finished instance or function.
        what: Its name, for errors.

    Raises:
        PluginError: It is something else, lacks a member, or has an option of a reserved name.
    """
    check_members(kind, plugin, what)
    if isinstance(plugin, type):
        check_constructor(kind, plugin, what)


def check_constructor(kind: str, plugin: type[Any], what: str) -> None:
    """Checks a constructor for parameters out of reach of the configuration.

    Arguments and errors are those of `check_contract`.
    """
    check_free(kind, parameters(plugin), what)
    if kind == "objectives" and (given := sorted(context(plugin))):
        raise PluginError(
            f"{what} has {', '.join(given)} in its constructor, which heads alone are given: put "
            "what needs it into the head, whose result forward(prediction, batch) takes"
        )


def check_members(kind: str, plugin: Any, what: str) -> None:
    """Checks a class for the members of its kind; arguments and errors as of `check_contract`."""
    if kind == "optimizers" and _has(plugin, "zero_grad"):
        return  # one of torch, made a plugin at use
    needed = _CONTRACTS.get(kind, ())
    if not needed:
        if not callable(plugin):
            raise PluginError(f"{what} is a {type(plugin).__name__}: give a function or a class")
        if kind == "augmentations":
            _check_change(plugin, what)
        return
    if inspect.isroutine(plugin) or inspect.ismodule(plugin):
        raise PluginError(f"{what} is a {type(plugin).__name__}: give a class")
    single = kind.removesuffix("s")
    seen, why = _seen(plugin)
    if kind in _IN_PLACE_OF and seen not in ("", single):
        raise PluginError(
            f"{what} is an {seen} ({why}), no {single}: {_IN_PLACE_OF[kind]}".replace(
                "an head", "a head"
            )
        )
    if missing := [name for name in needed if not _has(plugin, name)]:
        fix = f"see {single.capitalize()} of tactileforge.contracts"
        if kind in ("callbacks", "loggers"):
            fix = f"derive it from {single.capitalize()} of lightning.pytorch.{kind}"
        if (kind, missing) == ("objectives", ["head"]):
            fix = (
                "give it a class attribute head, the name of a head (tactileforge plugins list "
                "kind=heads) or a class of yours, made as head(encoder), whose result it is given"
            )
        raise PluginError(f"{what} has no {', no '.join(missing)}: {fix}")


def _seen(plugin: Any) -> tuple[str, str]:
    """Kind of network of a class by its members, and these members; empty for neither."""
    if not isinstance(plugin, type):
        return "", ""
    if _has(plugin, "head") and _has(plugin, "needs"):
        return "objective", "it has head and needs"
    try:
        given = signature(plugin).parameters.get("encoder")
    except ValueError:  # a type of Python itself
        return "", ""
    if given is not None and given.default is Parameter.empty:
        return "head", "its constructor takes the encoder"
    return "", ""


def _check_change(plugin: Any, what: str) -> None:
    """Checks a change of batches: a class with ``__call__``, or its maker."""
    fix = "give a class whose instance takes a batch, def __call__(self, batch), and returns it"
    if isinstance(plugin, type):
        calls = [
            vars(base)[name]
            for base in plugin.__mro__[:-1]
            for name in ("forward", "__call__")
            if inspect.isfunction(vars(base).get(name))
            and not base.__module__.startswith("torch.nn")
        ]
        if not calls:
            raise PluginError(f"{what} has no __call__: {fix}")
        takes = [*signature(calls[0]).parameters.values()][1:]
        needed = [one.name for one in takes if one.default is one.empty and one.kind < 2]
        if len(needed) != 1 and not any(one.kind is one.VAR_POSITIONAL for one in takes):
            raise PluginError(f"{what} is called with {', '.join(needed) or 'nothing'}: {fix}")
    elif inspect.isroutine(plugin):
        needed = [n for n, p in signature(plugin).parameters.items() if p.default is p.empty]
        if needed:
            raise PluginError(f"{what} is a function of {', '.join(needed)}: {fix}")


def check_free(kind: str, options: Mapping[str, Any], what: str) -> None:
    """Checks the options of a plugin for names of keys of the framework.

    A value given for such a key never reaches the constructor. Callbacks and loggers of other
    packages may have a ``name`` with a default, which it keeps.

    Args:
        kind: Kind of the plugin.
        options: Its options with their defaults; see `parameters`.
        what: Its name, for errors.

    Raises:
        PluginError: An option has a reserved name.
    """
    reserved = {"name", "_target_", *RESERVED.get(kind, ())}
    taken = sorted(reserved & options.keys())
    if kind in ("callbacks", "loggers") and options.get("name", Parameter.empty) != Parameter.empty:
        taken.remove("name")
    if taken:
        raise PluginError(
            f"{what} takes {' and '.join(map(repr, taken))}, and the framework has keys of that "
            "name, so that no value of theirs reaches the constructor: call it something else, as "
            f"own_{taken[0]}; taken are {', '.join(sorted(reserved))}"
        )


def _has(plugin: Any, name: str) -> bool:
    found = getattr(plugin, name, None)
    if name == "forward":  # nn.Module has one that refuses every call
        own = getattr(found, "__name__", "forward") != "_forward_unimplemented"
        cls = plugin if isinstance(plugin, type) else type(plugin)
        return (found is not None and own) or "__call__" in vars(cls)
    # a method of a protocol is a stub
    module = getattr(found, "__module__", "") if inspect.isfunction(found) else ""
    if str(module).startswith("tactileforge.contracts"):
        return False
    annotated = (
        k for base in getattr(plugin, "__mro__", ()) for k in vars(base).get("__annotations__", ())
    )
    return found is not None or name in annotated or _is_set_in_init(plugin, name)


def _is_set_in_init(plugin: Any, name: str) -> bool:
    """Whether a constructor of a class sets an attribute, as in ``self.provides = ...``."""
    made = [vars(base).get("__init__") for base in getattr(plugin, "__mro__", ())[:-1]]
    return any(name in one.__code__.co_names for one in made if inspect.isfunction(one))
