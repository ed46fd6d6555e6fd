"""Checks of verbs: modules with commands for the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from inspect import getdoc
from typing import Any

from tactileforge.testing.results import Check, CheckSubject, Violation, require
from tactileforge.util import strict


def its_first_line_is_its_help(subject: CheckSubject) -> None:
    """``tactileforge --help`` shows the first line of the module's docstring."""
    require(bool(getdoc(subject.plugin)), "the module has no docstring: its first line is the help")


def it_has_commands(subject: CheckSubject) -> None:
    """The module has ``COMMANDS``, a dict of commands by action."""
    commands = _commands(subject)
    require(bool(commands), "COMMANDS is empty: give a Command by action, or by '' for none")
    blank = [action for action in commands if not isinstance(action, str) or " " in action]
    require(not blank, f"an action is one word: {', '.join(map(repr, blank))}")


def its_commands_are_described(subject: CheckSubject) -> None:
    """Every command has a docstring, and a dataclass of documented keys."""
    for action, command in _commands(subject).items():
        where = f"COMMANDS[{action!r}]"
        require(callable(getattr(command, "run", None)), f"{where} is not a Command")
        require(bool(getdoc(command.run)), f"{where}: the function has no docstring")
        if command.keys is not None:
            require(is_dataclass(command.keys), f"{where}: keys is not a dataclass")
            strict.describe(command.keys)


def _commands(subject: CheckSubject) -> Mapping[str, Any]:
    commands = getattr(subject.plugin, "COMMANDS", None)
    if not isinstance(commands, Mapping):
        raise Violation("the module has no dict COMMANDS of commands by action")
    return commands


CHECKS: list[Check] = [
    its_first_line_is_its_help,
    it_has_commands,
    its_commands_are_described,
]
