"""Moved data of a run: ``data.root=NEW`` with ``resume=``, and for ``report``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tactileforge.cli._quote import unquoted
from tactileforge.errors import ConfigError

#: Folders of data: of the data set, or of a source of a mixture.
_ROOT = re.compile(r"data(\.sources\.[^.=]+)?\.root=")


def taken_out(overrides: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """The other words, and the new folder of each key.

    Args:
        overrides: ``key=value`` words.

    Example:
        >>> taken_out(["seed=1", "data.root='a b'"])
        (['seed=1'], {'data.root': 'a b'})
    """
    moved = [word.partition("=") for word in overrides if _ROOT.match(word)]
    rest = [word for word in overrides if not _ROOT.match(word)]
    return rest, {path: unquoted(value) for path, _, value in moved}


def put_in(config: dict[str, Any], moved: Mapping[str, str]) -> None:
    """Sets the new folders in the configuration of a run, in place.

    Raises:
        ConfigError: The run has no such key.
    """
    for path, value in moved.items():
        *groups, last = path.split(".")
        node = config
        for group in groups:
            node = node.get(group) or {}
        if last not in node:
            raise ConfigError(f"{path}=: the run has no such key")
        node[last] = str(Path(value).expanduser().absolute())
