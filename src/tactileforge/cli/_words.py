"""Words of a command line: flags of Hydra, ``key=value`` words, and bare words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import UnionType
from typing import Any, Union, get_args, get_origin

from tactileforge.cli._quote import at_home, exists, unquoted
from tactileforge.errors import ConfigError, unknown

#: Flags answered by Hydra, and whether a value follows.
_FLAGS = {
    **dict.fromkeys(("-m", "--multirun", "--resolve", "-r", "--hydra-help", "--run"), False),
    **dict.fromkeys(("--cfg", "-c", "--config-dir", "-cd", "--package", "-p"), True),
    **dict.fromkeys(("--info", "-i", "--experimental-rerun"), True),
}
#: Values of a flag, where they are fixed.
_CHOICES = {
    **dict.fromkeys(("--cfg", "-c"), ("job", "hydra", "all")),
    **dict.fromkeys(
        ("--info", "-i"), ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")
    ),
}
#: Flags as they are completed.
FLAGS = ("--help", "--explain", *(flag for flag in _FLAGS if flag.startswith("--")))
#: Options of a group with several at once, each under its own name.
_SEVERAL = re.compile(r"(sensor|objective|head|callbacks)=\[.*\]")
#: Keys of Hydra itself, and the prefixes that add or remove a key.
_OF_HYDRA = re.compile(r"hydra[./]|[+~]")


@dataclass
class Words:
    """Words after a verb.

    Attributes:
        flags: Flags of Hydra, each followed by its value, if any.
        overrides: ``key=value``, as typed.
        bare: Words without ``=``.
        code: ``code=`` words: classes of the user's own for names in files.
        help: Whether help is asked for.
        explain: Key whose value is to be explained; "" for none.
    """

    flags: list[str] = field(default_factory=list)
    overrides: list[str] = field(default_factory=list)
    bare: list[str] = field(default_factory=list)
    code: list[str] = field(default_factory=list)
    help: bool = False
    explain: str = ""

    @property
    def asks_hydra(self) -> bool:
        """Whether only Hydra can answer."""
        return bool(self.flags) or any(_OF_HYDRA.match(word) for word in self.overrides)

    @property
    def typed(self) -> list[str]:
        """Flags and overrides, in the order given to Hydra."""
        return [*self.flags, *self.overrides]

    @property
    def sweeps(self) -> bool:
        """Whether the command is a sweep, with one job for each combination of values."""
        return "-m" in self.flags or "--multirun" in self.flags


def read(argv: Sequence[str]) -> Words:
    """Sorts the words of a command line into flags, overrides and bare words.

    ``--key value`` and ``--key=value`` are ``key=value``, and ``--key`` alone is ``key=true``.

    Raises:
        ConfigError: A flag is unknown, lacks its value or has an unknown one, or a plugin is given
            twice.
    """
    words, rest = Words(), list(argv)
    while rest:
        word = rest.pop(0)
        name, equals, value = word.partition("=")
        if word in ("-h", "--help"):
            words.help = True
        elif name in ("--explain", *_FLAGS) and (name == "--explain" or _FLAGS[name]):
            if not equals and not rest:
                raise ConfigError(f"{word} needs a value")
            value = value if equals else rest.pop(0)
            if value not in _CHOICES.get(name, (value,)):
                raise ConfigError(unknown(f"value of {name}", value, _CHOICES[name]))
            if name == "--explain":
                words.explain = value
            else:
                words.flags += [name, value]
        elif word in _FLAGS:
            words.flags.append(word)
        elif re.fullmatch(r"--[a-z][\w.@/]*", name):
            if not equals:
                # the next word is the value, unless it is a flag or a key=value of its own; a file
                # may be named like either
                follows = rest and (not re.match(r"-|[\w.@/]+=", rest[0]) or exists(rest[0]))
                value = rest.pop(0) if follows else "true"
            words.overrides.append(f"{name[2:]}={value}")
        elif word.startswith("-"):
            raise ConfigError(f"unknown flag {word}; --help shows keys and flags")
        elif re.match(r"~|[+]{0,2}[\w@.:/]+=", word):
            words.overrides.append(word)
        else:
            words.bare.append(word)
    check_twice(words.overrides)
    return words


def check_twice(overrides: Sequence[str]) -> None:
    """Refuses a list with the same plugin twice, since Hydra would take it for one.

    Raises:
        ConfigError: A plugin is given twice.
    """
    for match in filter(None, map(_SEVERAL.fullmatch, overrides)):
        group = match[1]
        for several in re.findall(r"\[([^\]]*)\]", match[0]):  # a sweep has many lists
            names = [name.strip() for name in several.split(",")]
            if twice := [name for name in names if names.count(name) > 1]:
                raise ConfigError(
                    f"{match[0]} has {twice[0]} twice, and each has a name of its own: give it "
                    f"once, and a second one by a name, +{group}@{group}.second={twice[0]}"
                )


def fill(words: Words, keys: Sequence[str], several: bool, verb: str) -> dict[str, Any]:
    """Assigns bare words to keys, in order.

    Args:
        words: Words of the command line.
        keys: Keys that take bare words.
        several: Whether the last key takes all remaining words.
        verb: Verb and action, for errors.

    Raises:
        ConfigError: There are more words than keys.
    """
    rest = list(words.bare)
    given: dict[str, Any] = {}
    for key in keys[:-1] if several else keys:
        if rest and not any(word.startswith(f"{key}=") for word in words.overrides):
            given[key] = unquoted(at_home(rest.pop(0)))
    if several and rest:
        given[keys[-1]], rest = [unquoted(at_home(word)) for word in rest], []
    if rest:
        fix = f"quote a value with a blank; tactileforge {verb} --help lists keys"
        raise ConfigError(f"{rest[0]!r} is not key=value; {fix}")
    return given


def values(words: Sequence[str], hints: Mapping[str, Any]) -> dict[str, Any]:
    """Values of ``key=value`` words, in the types of their keys; values are YAML."""
    pairs = [word.partition("=")[::2] for word in words]
    return {key: _value(key, text, hints.get(key, Any)) for key, text in pairs}


def _value(key: str, text: str, hint: Any) -> Any:
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    if text == "null" and type(None) in kinds:
        return None
    text = at_home(text)
    if set(kinds) <= {str, type(None)}:
        return unquoted(text)  # YAML would turn the name 007 into a number
    import yaml

    try:
        # YAML 1.1 takes 1e-3 for text, as it has no point
        value = yaml.safe_load(text)
        return float(value) if float in kinds and isinstance(value, str) else value
    except yaml.YAMLError as error:
        raise ConfigError(f"{key}={text}: not a value ({' '.join(str(error).split())})") from error
    except ValueError:
        return text


def free_heads(overrides: Sequence[str]) -> list[str]:
    """Overrides with ``++`` before options of heads, named by the recipe or not.

    `finish` gives them to the head of the objective.

    Example:
        >>> free_heads(["seed=1", "head.contrast.width=32"])
        ['seed=1', '++head.contrast.width=32']
    """
    return [f"++{word}" if re.match(r"head\.\w+\.", word) else word for word in overrides]
