"""A command: keys with defaults, groups of options, and what it does; the one way they are run.

A command that has no group of options, and is given plain ``key=value``, is run without Hydra, so
that it answers at once. All others are composed by Hydra; ``train``, and what is given ``-m`` or
another of its flags, is run by it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from inspect import getdoc
from typing import Any, get_origin, get_type_hints

from tactileforge import strict
from tactileforge.cli import _words
from tactileforge.cli._words import Words

#: What a command gives: its exit status, the number that a sweep makes small, or nothing.
Result = int | float | None


@dataclass(frozen=True, kw_only=True)
class Command:
    """One command of a verb.

    Attributes:
        run: What it does, given its keys, and the whole configuration as plain data. Its docstring
            says so in ``--help``.
        keys: Dataclass of its keys; None where a YAML in conf/ lists them.
        groups: Groups of options beside them, and the default of each; None for none, ``???`` for
            one that has to be given.
        groups_last: Whether options change keys, and not the other way round.
        bare: Keys that words without ``=`` give, in order; the last takes all that are left where
            it holds a list.
        also: Other names of keys.
        others: Key that holds, as a mapping, keys that are not known; "" where that is an error.
        yaml: Name of the YAML in conf/ instead of keys and groups.
        prepare: Checks and completes ``key=value`` words before anything is composed.
        finish: Completes what was composed.
    """

    run: Callable[[Any, dict[str, Any]], Result]
    keys: type[Any] | None = None
    groups: Mapping[str, Any] = field(default_factory=dict)
    groups_last: bool = False
    bare: tuple[str, ...] = ()
    also: Mapping[str, str] = field(default_factory=dict)
    others: str = ""
    yaml: str = ""
    prepare: Callable[[list[str]], list[str]] = list
    finish: Callable[[Any], Any] | None = None

    @property
    def about(self) -> str:
        """Summary of the verb, in a line."""
        return (getdoc(self.run) or "").partition("\n")[0]

    def name(self, verb: str) -> str:
        """By which Hydra knows its configuration."""
        return self.yaml or verb.replace(" ", "_")

    def declare(self, verb: str) -> str:
        """Makes its configuration known to Hydra, and gives its name."""
        from tactileforge.compose import declare

        name = self.name(verb)
        if not self.yaml:
            keys = strict.node(self.keys) if self.keys else {}
            declare(name, self.groups, keys, self.groups_last)
        return name

    def compose(self, verb: str, overrides: Sequence[str] = ()) -> dict[str, Any]:
        """Its configuration, as plain data; see `compose.composed`."""
        from tactileforge.compose import composed, plain

        config = composed(self.declare(verb), overrides)
        return plain(self.finish(config) if self.finish else config)

    def build(self, given: Mapping[str, Any]) -> Any:
        """Its keys, as their dataclass; None where it has none.

        Raises:
            ConfigError: A key is unknown, missing, or of another type.
        """
        if self.keys is None:
            return None
        known = {spec.name for spec in fields(self.keys)}
        return strict.build(self.keys, "", {k: v for k, v in given.items() if k in known})


def run(verb: str, command: Command, argv: Sequence[str]) -> int:
    """Runs a command and gives its exit status.

    Args:
        verb: As it is typed, with its action.
        command: What it is.
        argv: Words after it.

    Raises:
        TactileForgeError: Something is wrong; says the fix.
    """
    words = _words.read(argv)
    if words.help:
        from tactileforge.cli._help import text

        print(text(verb, command))
        return 0
    given = _given(verb, command, words)
    light = not (command.groups or command.yaml or words.asks_hydra or words.explain)
    if light:
        return _status(_light(command, words, given))
    words.overrides += [f"{key}={_quoted(value)}" for key, value in given.items()]
    words.overrides = command.prepare(words.overrides)
    from tactileforge.cli import _hydra

    if words.explain:
        from tactileforge.cli._explain import explain

        with _hydra.told(verb, command, words):
            print(explain(command.declare(verb), words.explain, words.overrides, words.flags))
        return 0
    if command.yaml or words.asks_hydra:
        return _status(_hydra.run(verb, command, words))
    with _hydra.told(verb, command, words):
        config = command.compose(verb, words.overrides)
    return _status(command.run(command.build(config), config))


def _given(verb: str, command: Command, words: Words) -> dict[str, Any]:
    for i, word in enumerate(words.overrides):
        name, _, value = word.partition("=")
        words.overrides[i] = f"{command.also.get(name, name)}={value}"
    several = False
    if command.bare and command.keys:
        several = get_origin(get_type_hints(command.keys)[command.bare[-1]]) is list
    return _words.fill(words, command.bare, several, verb)


def _light(command: Command, words: Words, given: dict[str, Any]) -> Result:
    assert command.keys is not None
    hints = get_type_hints(command.keys)
    given |= _words.values(words.overrides, hints)
    if command.others:
        others = {key: given.pop(key) for key in [*given] if key not in hints}
        given[command.others] = others
    return command.run(strict.build(command.keys, "", given), given)


def _quoted(value: Any) -> str:
    if isinstance(value, list):
        return f"[{','.join(map(_quoted, value))}]"
    escaped = str(value).replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"


def _status(result: Result) -> int:
    return result if isinstance(result, int) else 0
