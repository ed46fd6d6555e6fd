"""The conformance suite: checks a plugin against the contract of its kind.

Plugin authors call it in their own tests, and ``tactileforge plugins check`` on the command line::

    from tactileforge.testing import check

    def test_conformance():
        assert not [result for result in check("sensor", "my_sensor") if result.status == "failed"]

A check that a plugin cannot pass for a good reason is named in the class attribute
``expected_failures``, a dict of check to reason. It is then reported as ``expected``, and as
``failed`` on the day it passes.
"""

from __future__ import annotations

from importlib import import_module
from inspect import isclass
from typing import Any

import torch

from tactileforge.errors import PluginError, unknown
from tactileforge.plugins import local, registry
from tactileforge.testing import general
from tactileforge.testing.batches import batch
from tactileforge.testing.kinds import kind_of
from tactileforge.testing.results import Check, CheckResult, CheckSubject, name_of, run_check
from tactileforge.training.torch_optimizers import plugin_of
from tactileforge.util.threads import one_thread

__all__ = ["CheckResult", "batch", "check", "check_container", "kind_of"]


#: The check without which those of a kind would say one cause many times.
_HAS_ALL = name_of(general.it_has_what_its_kind_needs)


def check(
    kind: str, plugin: Any, *, head: type[Any] | None = None, **options: Any
) -> list[CheckResult]:
    """Checks one plugin against the contract of its kind.

    Args:
        kind: ``sensor``, ``dataset``, ``encoder``, ``head``, ``objective``, ``optimizer``,
            ``check`` or ``verb``, or its plural.
        plugin: An installed name, or a class, also by its name ``my_module:Class``; for sensors
            and data sets also an instance; for verbs a module.
        head: Class of the head that feeds an objective; None for the installed head named by the
            objective.
        options: Constructor arguments.

    Returns:
        One result per check, in a fixed order. A failed check does not stop the others.

    Raises:
        PluginError: The kind or name is unknown, or an instance was given for a kind whose checks
            have to build the plugin themselves.

    Example:
        >>> {result.status for result in check("objective", "force")} <= {"ran", "skipped"}
        True
    """
    checked = (*registry.KINDS, *registry.MODULES)
    kind = kind if kind in checked else f"{kind}s"
    if kind not in checked:
        known = [known.removesuffix("s") for known in checked]
        raise PluginError(unknown("kind of plugin", kind.removesuffix("s"), known))
    if isinstance(plugin, str) and local.is_local(plugin):
        plugin = registry.adopt(kind, plugin)
    if isinstance(plugin, str) and plugin in registry.names(kind):
        try:
            registry.load(kind, plugin)
        except PluginError as error:
            return [CheckResult("it can be imported", "failed", str(error))]
    subject = _subject(kind, plugin, head, options)
    own: list[Check] = import_module(f"tactileforge.testing.{kind}").CHECKS
    shared = [general.name_is_snake_case] if kind in registry.MODULES else general.CHECKS
    # seeds of checks are their own affair; one thread, as sums over several differ in the last bit
    with torch.random.fork_rng(devices=[]), one_thread():
        results = [run_check(test, subject) for test in shared]
        if any(one.name == _HAS_ALL and one.status == "failed" for one in results):
            why = f"the check {_HAS_ALL!r} failed"
            return [*results, *(CheckResult(name_of(test), "skipped", why) for test in own)]
        return [*results, *(run_check(test, subject) for test in own)]


def check_container(container: Any) -> list[CheckResult]:
    """Checks a `tactileforge.reading.Container` of your own against the protocol.

    Args:
        container: An open container, with an array of rows or more.

    Returns:
        One result per check, in a fixed order.
    """
    subject = CheckSubject("container", type(container), "", {}, instance=container)
    own: list[Check] = import_module("tactileforge.testing.containers").CHECKS
    return [run_check(test, subject) for test in own]


def _subject(
    kind: str, plugin: Any, head: type[Any] | None, options: dict[str, Any]
) -> CheckSubject:
    if isinstance(plugin, str):
        return CheckSubject(kind, registry.load(kind, plugin), plugin, options, head=head)
    if kind in registry.MODULES:
        return CheckSubject(kind, plugin, "", options)
    instance = None if isclass(plugin) else plugin
    if instance is not None and (kind not in ("sensors", "datasets") or options):
        raise PluginError(
            f"checks build {kind} anew: give check() the class {type(plugin).__name__} and its "
            "options, not an instance"
        )
    cls = type(plugin) if instance is not None else plugin
    if kind == "optimizers" and issubclass(cls, torch.optim.Optimizer):
        cls = plugin_of(cls)  # as training does with it
    target = f"{cls.__module__}:{cls.__qualname__}"
    installed = (p.name for p in registry.list_plugins() if (p.kind, p.target) == (kind, target))
    return CheckSubject(kind, cls, next(installed, ""), options, instance, head)
