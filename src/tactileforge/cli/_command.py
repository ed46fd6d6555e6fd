"""A command: its keys with defaults, its groups of options, and its function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from inspect import getdoc
from pathlib import Path
from typing import Any

from tactileforge.util import strict
from tactileforge.util.files import check_cache, check_writable

#: Result of a command: its exit status, the number that a sweep minimises, nothing, or an object
#: for Python (`pages.Shown`), whose ``status`` is the exit status.
Result = Any


@dataclass(frozen=True, kw_only=True)
class Command:
    """One command of a verb.

    Attributes:
        run: Function of the command, called with its keys and the whole configuration as plain
            data. Its docstring is the summary in ``--help``.
        keys: Dataclass of the keys; None if a YAML in conf/ lists them.
        groups: Groups of options beside the keys, and the default option of each; None for no
            option, ``???`` for a required one.
        groups_last: Whether options override keys; otherwise keys override options.
        bare: Keys set by words without ``=``, in order; the last takes all remaining words where
            it holds a list.
        also: Other names of keys.
        others: Key that collects unknown keys as a mapping; "" if an unknown key is an error.
        open: Key that, where it has a value, names a plugin with keys of its own.
        yaml: Name of a YAML in conf/ that replaces keys and groups.
        writes: Function from the keys to the file or folder that is written; None for none.
        into: Whether ``writes`` names a folder.
        cache: Whether the command stores results in the cache.
        prepare: Checks and completes ``key=value`` words before anything is composed.
        finish: Completes the composed configuration.
    """

    run: Callable[[Any, dict[str, Any]], Result]
    keys: type[Any] | None = None
    groups: Mapping[str, Any] = field(default_factory=dict)
    groups_last: bool = False
    bare: tuple[str, ...] = ()
    also: Mapping[str, str] = field(default_factory=dict)
    others: str = ""
    open: str = ""
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
        """Name of the configuration in Hydra."""
        return self.yaml or verb.replace(" ", "_")

    def declare(self, verb: str) -> str:
        """Registers the configuration with Hydra and returns its name."""
        from tactileforge.cli._compose import declare

        name = self.name(verb)
        if not self.yaml:
            keys = strict.node(self.keys) if self.keys else {}
            declare(name, self.groups, keys, self.groups_last)
        return name

    def compose(self, verb: str, overrides: Sequence[str] = ()) -> dict[str, Any]:
        """Configuration of the command as plain data; see `compose.composed`."""
        from tactileforge.cli._compose import composed

        return self.completed(composed(self.declare(verb), overrides), overrides)

    def completed(self, config: Any, typed: Sequence[str]) -> dict[str, Any]:
        """A composed configuration, completed and checked, as plain data.

        Args:
            config: Composed configuration.
            typed: ``key=value`` words of the user.

        Raises:
            ConfigError: Nothing reads a key, or a required one has no value.
        """
        from tactileforge.cli._compose import plain
        from tactileforge.cli._known import check_command

        late = self.open and config.get(self.open)  # a package runs it, with keys of its own
        if not self.yaml and not late:
            check_command(self.keys, self.groups, config, typed)
        return plain(self.finish(config) if self.finish else config)

    def start(self, config: dict[str, Any], given: Mapping[str, Any] | None = None) -> Result:
        """Runs the command after a check of its output path.

        Args:
            config: The whole configuration.
            given: Values of the keys, for a command run without Hydra; None takes them from the
                configuration.

        Raises:
            ConfigError: A key is wrong, or the place cannot be written.
        """
        if given is not None and self.keys is not None:
            keys = strict.build(self.keys, "", given)
        else:
            keys = self.build(config)
        # before any work: its result could not be saved
        if out := self.writes(keys):
            check_writable(Path(out), folder=self.into)
        if self.cache:
            check_cache(config.get("cache"))
        return self.run(keys, config)

    def build(self, given: Mapping[str, Any]) -> Any:
        """Keys of the command as their dataclass; None for a command without keys.

        Raises:
            ConfigError: A key is unknown, missing, or of another type.
        """
        if self.keys is None:
            return None
        known = {spec.name for spec in fields(self.keys)}
        return strict.build(self.keys, "", {k: v for k, v in given.items() if k in known})
