"""Completion for shells; `cli` has the line for bash."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence

from tactileforge.cli._help import option_keys
from tactileforge.cli._options import options, own_places, yaml_groups
from tactileforge.cli._words import FLAGS
from tactileforge.errors import ConfigError
from tactileforge.util import strict


def complete(line: str | None = None) -> list[str]:
    """Candidates for the next word.

    Args:
        line: The typed line; None for ``$COMP_LINE``, up to ``$COMP_POINT``.
    """
    from tactileforge.cli._verbs import commands, verbs

    if line is None:  # bash gives the place of the cursor: what is behind it does not count
        line = os.environ.get("COMP_LINE", "")[
            : int(os.environ.get("COMP_POINT", "0") or 0) or None
        ]
    _, *words = line.split(" ")
    *before, word = words or [""]
    if not before:
        return [f"{verb} " for verb in verbs() if verb.startswith(word)]
    try:
        known = commands(before[0])
    except ConfigError:
        return []
    if len(before) == 1 and "" not in known:
        return [f"{action} " for action in known if action.startswith(word)]
    command = known.get("") or known.get(before[1])
    if command is None:
        return []
    dashes = "--" if word.startswith("--") else ""
    _, own = own_places([], before)
    groups = dict(command.groups) or (yaml_groups(command.yaml) if command.yaml else {})
    group, equals, start = word.removeprefix("--").partition("=")
    if equals:  # bash replaces only the part after "=", so candidates are values alone
        *_, last = re.split(r"[\[,]", start)
        typed = start.removesuffix(last)
        return [typed + name for name in options(group, own) if name.startswith(last)]
    own_keys = strict.node(command.keys) if command.keys else {}
    keys = [*groups, *own_keys, *_below(group, groups, before)]
    flags = [flag for flag in FLAGS if dashes and flag.startswith(word)]
    return [*flags, *(f"{dashes}{key}=" for key in dict.fromkeys(keys) if key.startswith(group))]


def _below(word: str, groups: Mapping[str, str], before: Sequence[str]) -> list[str]:
    """Keys of the option of a group, as ``trainer.max_steps``, once the group is typed."""
    group, dot, _ = word.partition(".")
    if not dot or group not in groups:
        return []
    typed = [word.partition("=")[2] for word in before if word.startswith(f"{group}=")]
    chosen = typed[-1] if typed else groups[group]
    lines, place = option_keys(group, chosen), ""
    found = []
    for line in lines:
        name, colon, _ = line.partition(":")
        if not colon or name.lstrip().startswith("#"):
            continue
        if line[0] != " ":
            place = name
        elif not name.startswith("   "):
            found.append(f"{place}.{name.strip()}")
    return found
