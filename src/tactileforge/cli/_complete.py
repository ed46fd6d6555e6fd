"""Completion for shells; `cli` has the line for bash."""

from __future__ import annotations

import os
import re

from tactileforge import strict
from tactileforge.cli._options import options, yaml_groups
from tactileforge.errors import ConfigError


def complete(line: str | None = None) -> list[str]:
    """Words that may come next.

    Args:
        line: What was typed; None for ``$COMP_LINE``, up to ``$COMP_POINT``.
    """
    from tactileforge.cli._verbs import commands, verbs

    if line is None:
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
    groups = dict(command.groups) or (yaml_groups(command.yaml) if command.yaml else {})
    group, equals, start = word.partition("=")
    if equals:  # the shell completes what follows "=" by itself
        *_, last = re.split(r"[\[,]", start)
        typed = start.removesuffix(last)
        return [typed + name for name in options(group) if name.startswith(last)]
    keys = [*groups, *(strict.node(command.keys) if command.keys else {})]
    return [f"{key}=" for key in keys if key.startswith(word)]
