"""Runs commands, with Hydra only if it is needed.

A command without groups of options that gets plain ``key=value`` words runs without Hydra, whose
import would delay the answer. Hydra composes the configuration of all other commands, and also runs
``train`` and every command with ``-m`` or another of Hydra's flags.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_origin, get_type_hints

from tactileforge.cli import _words
from tactileforge.cli._command import Command, Result
from tactileforge.cli._quote import for_hydra, quoted, split, unquoted
from tactileforge.cli._words import Words
from tactileforge.errors import check_names


def run(verb: str, command: Command, argv: Sequence[str]) -> int:
    """Runs a command and gives its exit status.

    Args:
        verb: Verb and action as typed.
        command: Command of that verb and action.
        argv: Words after the verb and action.

    Raises:
        TactileForgeError: Something is wrong; says the fix.
    """
    words = _words.read(argv)
    words.code, words.overrides = taken_code(words.overrides)
    if words.help:
        from tactileforge.cli._help import text

        print(text(verb, command, words.overrides))
        return 0
    for i, word in enumerate(words.overrides):
        name, equals, value = word.partition("=")
        words.overrides[i] = command.also.get(name, name) + equals + value
    several = False
    if command.bare and command.keys:
        several = get_origin(get_type_hints(command.keys)[command.bare[-1]]) is list
    given = _words.fill(words, command.bare, several, verb)
    if not (command.groups or command.yaml or words.asks_hydra or words.explain):
        words.overrides = command.prepare(words.overrides)
        return _status(_light(command, words, given))
    # quoted before `prepare`, which reads the words as Hydra does
    words.overrides = [for_hydra(word, words.sweeps) for word in words.overrides]
    words.overrides += [f"{key}={_quoted(value)}" for key, value in given.items()]
    words.overrides = command.prepare(words.overrides)
    from tactileforge.cli import _hydra
    from tactileforge.cli._slips import told

    if words.explain:
        from tactileforge.cli._explain import explain

        with told(verb, command, words):
            print(explain(command.declare(verb), words.explain, words.overrides, words.flags))
        return 0
    if command.yaml or words.asks_hydra:
        return _status(_hydra.run(verb, command, words))
    with told(verb, command, words):
        config = command.compose(verb, words.overrides)
    return _status(command.start(config))


def taken_code(overrides: Sequence[str]) -> tuple[list[str], list[str]]:
    """Imports the user's own classes of ``code=``, for a run or file with their names.

    Args:
        overrides: Words as typed.

    Returns:
        The ``code=`` words, and the other words.
    """
    code = [word for word in overrides if word.startswith("code=")]
    if code:
        from tactileforge.plugins import local, registry

        for word in code:
            for name in split(unquoted(word.partition("=")[2]).strip("[]")):
                registry.give(name.strip(), local.resolve(name.strip(), "code"))
    return code, [word for word in overrides if word not in code]


def _light(command: Command, words: Words, given: dict[str, Any]) -> Result:
    assert command.keys is not None
    hints = get_type_hints(command.keys)
    given |= _words.values(words.overrides, hints)
    if command.others:
        others = {key: given.pop(key) for key in [*given] if key not in hints}
        given[command.others] = others
    else:
        shown = {real: name for name, real in command.also.items()}
        strange = [key for key in given if key not in hints]
        check_names("key", strange, {shown.get(key, key) for key in hints})
    return command.start(given, given)


def _quoted(value: Any) -> str:
    if isinstance(value, list):
        return f"[{','.join(map(_quoted, value))}]"
    return quoted(str(value))


def _status(result: Result) -> int:
    status = getattr(result, "status", result)
    return status if isinstance(status, int) else 0
