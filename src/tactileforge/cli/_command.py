"""A command: keys with defaults, groups of options, and what it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from inspect import getdoc
from pathlib import Path
from typing import Any

from tactileforge import strict
from tactileforge.files import check_cache, check_writable

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
        writes: The file or folder that it writes, given its keys; None for none.
        into: Whether that is a folder.
        cache: Whether it keeps what it does in the cache.
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
    writes: Callable[[Any], Path | str | None] = lambda keys: getattr(keys, "out", None)
    into: bool = False
    cache: bool = False
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

    def start(self, config: dict[str, Any], given: Mapping[str, Any] | None = None) -> Result:
        """Runs, once it is known that what it makes can be written.

        Args:
            config: The whole configuration.
            given: Values of its keys, where they are not those of the configuration.

        Raises:
            ConfigError: A key is wrong, or the place cannot be written.
        """
        if given is not None and self.keys is not None:
            keys = strict.build(self.keys, "", given)
        else:
            keys = self.build(config)
        if out := self.writes(keys):
            check_writable(Path(out), folder=self.into)
        if self.cache:
            check_cache(config.get("cache"))
        return self.run(keys, config)

    def build(self, given: Mapping[str, Any]) -> Any:
        """Its keys, as their dataclass; None where it has none.

        Raises:
            ConfigError: A key is unknown, missing, or of another type.
        """
        if self.keys is None:
            return None
        known = {spec.name for spec in fields(self.keys)}
        return strict.build(self.keys, "", {k: v for k, v in given.items() if k in known})
