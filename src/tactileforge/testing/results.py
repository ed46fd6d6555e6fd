"""Checks, their subjects and their results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from inspect import Parameter
from typing import Any, Literal, TypeAlias

from tactileforge.errors import DataNotFoundError, PluginError, TactileForgeError
from tactileforge.plugins import local, moves, registry


@dataclass(frozen=True)
class CheckResult:
    """Result of one check.

    Attributes:
        name: Name of the check, in words.
        status: ``ran`` (the check holds), ``failed``, ``expected`` (fails as announced in
            ``expected_failures``) or ``skipped`` (cannot run here).
        detail: Reason for a status other than ``ran``; "" otherwise.

    Example:
        >>> CheckResult("it opens twice", "failed", "the port is busy").status
        'failed'
    """

    name: str
    status: Literal["ran", "failed", "expected", "skipped"]
    detail: str = ""


class Skip(Exception):
    """A check cannot run here; says why."""


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
        kind: Kind of plugin, of `registry.KINDS` or `registry.MODULES`.
        plugin: Class of the plugin; for verbs the module.
        name: Name of the installed plugin; "" if it is not installed.
        options: Constructor arguments.
        instance: Existing instance, to copy instead of building a new one; None builds.
        head: Class of the head that feeds an objective; None for the head named by the objective.
    """

    kind: str
    plugin: type[Any]
    name: str
    options: Mapping[str, Any]
    instance: Any = None
    head: type[Any] | None = None

    def build(self, **context: Any) -> Any:
        """Builds a plugin from its options and the context named by its constructor.

        Raises:
            Skip: An option without a default is missing.
        """
        if self.instance is not None:
            return deepcopy(self.instance)  # a check may change it
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
    """Builds a class with its options and the entries of the context named by its constructor."""
    wanted = registry.context(plugin)
    return plugin(**options, **{key: context[key] for key in wanted if key in context})


def _told(error: BaseException) -> str:
    """What a check says of an error: ours as they are, others with the line of the author."""
    if isinstance(error, Violation | PluginError):
        return str(error)
    if isinstance(error, TactileForgeError):
        return f"{type(error).__name__}: {error}"
    return local.place_of(error)


Check: TypeAlias = Callable[[CheckSubject], None]


def name_of(check: Check) -> str:
    """Name of a check, in words."""
    return check.__name__.replace("_", " ")


def run_check(check: Check, subject: CheckSubject) -> CheckResult:
    """Runs one check and turns any exception into its result."""
    name = name_of(check)
    reason = getattr(subject.plugin, "expected_failures", {}).get(name)
    try:
        check(subject)
    except Skip as why:
        return CheckResult(name, "skipped", str(why))
    except DataNotFoundError as error:
        return CheckResult(name, "skipped", f"its data is not here: {error}")
    except (Exception, SystemExit) as error:  # Ctrl-C alone ends the suite
        text = _told(error)
        text = "; ".join([text, *moves.change_hints(subject.plugin)])
        if reason is None:
            return CheckResult(name, "failed", text)
        return CheckResult(name, "expected", f"{reason} ({text})")
    if reason is not None:
        return CheckResult(name, "failed", "it holds: remove it from expected_failures")
    return CheckResult(name, "ran")
