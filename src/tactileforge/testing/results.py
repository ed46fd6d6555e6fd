"""Checks, their subjects and their results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from inspect import Parameter
from typing import Any, Literal, TypeAlias

from tactileforge import moves, registry


@dataclass(frozen=True)
class CheckResult:
    """Result of one check.

    Attributes:
        name: The check, in words.
        status: ``ran`` (and holds), ``failed``, ``expected`` (fails, and the plugin says so) or
            ``skipped`` (cannot be made here).
        detail: Why, where the status is not ``ran``.
    """

    name: str
    status: Literal["ran", "failed", "expected", "skipped"]
    detail: str = ""


class Skip(Exception):
    """A check cannot be made here; says why."""


class Violation(Exception):
    """The plugin breaks its contract; says how."""


def require(condition: bool, message: str) -> None:
    """Raises a `Violation` unless the condition holds."""
    if not condition:
        raise Violation(message)


@dataclass(frozen=True)
class CheckSubject:
    """A plugin under test.

    Attributes:
        kind: One of `registry.KINDS`.
        plugin: Its class.
        name: The name it is installed by; "" if it is not.
        options: Constructor arguments.
        instance: One that exists already, copied instead of building a new one.
        head: The class that feeds an objective; None takes the one the objective names.
    """

    kind: str
    plugin: type[Any]
    name: str
    options: Mapping[str, Any]
    instance: Any = None
    head: type[Any] | None = None

    def build(self, **context: Any) -> Any:
        """A new plugin; it takes of the context what its constructor names.

        Raises:
            Skip: An option without a default is not given.
        """
        if self.instance is not None:
            return deepcopy(self.instance)
        known = registry.parameters(self.plugin)
        missing = [
            f"{key}=..."
            for key, default in known.items()
            if default is Parameter.empty and key not in {**self.options, **context}
        ]
        if missing:
            raise Skip(f"give options to check this: {' '.join(missing)}")
        return construct(self.plugin, self.options, context)


def construct(plugin: type[Any], options: Mapping[str, Any], context: Mapping[str, Any]) -> Any:
    """Builds a class with its options, and with what its constructor names of the context."""
    wanted = registry.context(plugin)
    return plugin(**options, **{key: context[key] for key in wanted if key in context})


Check: TypeAlias = Callable[[CheckSubject], None]


def run_check(check: Check, subject: CheckSubject) -> CheckResult:
    """Makes one check. Whatever it raises becomes its result."""
    name = check.__name__.replace("_", " ")
    reason = getattr(subject.plugin, "expected_failures", {}).get(name)
    try:
        check(subject)
    except Skip as why:
        return CheckResult(name, "skipped", str(why))
    except (Exception, SystemExit) as error:
        text = str(error) if isinstance(error, Violation) else f"{type(error).__name__}: {error}"
        text = "; ".join([text, *moves.change_hints(subject.plugin)])
        if reason is None:
            return CheckResult(name, "failed", text)
        return CheckResult(name, "expected", f"{reason} ({text})")
    if reason is not None:
        return CheckResult(name, "failed", "it holds: remove it from expected_failures")
    return CheckResult(name, "ran")
