"""Values as they are typed: one rule for ``~``, quotes and special characters, on every verb.

A value that Hydra's grammar cannot read is plain text, and is quoted for it; so is every value of a
key that names a path. ``~`` is the home folder: a shell does not expand it after ``=``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

#: Last words of keys that name a path.
_PATHS = frozenset(
    {"root", "out", "cache", "dir", "folder", "data_folder", "run", "resume", "init", "file"}
    | {"reference", "path", "calibration"}
)
#: ``~`` or ``~ana`` at the start of a value or of an item of a list.
_HOME = re.compile(r"(?:^|(?<=[\[{,:'\"])|(?<=[\[{,:] ))(~[\w.-]*)(?=/|$)")


def at_home(value: str) -> str:
    """A value with ``~`` as the home folder.

    Example:
        >>> at_home("~/touches") == str(Path.home() / "touches")
        True
        >>> at_home("file:~/a") == f"file:{Path.home()}/a"
        True
        >>> at_home("a~/b")
        'a~/b'
    """
    return _HOME.sub(lambda match: _expanded(match[1]), value) if "~" in value else value


def _expanded(word: str) -> str:
    try:
        return str(Path(word).expanduser())
    except RuntimeError:  # no user of that name
        return word


def unquoted(value: str) -> str:
    r"""A value without its surrounding quotes; quotes inside it are unescaped.

    Example:
        >>> unquoted(r"'it\'s'"), unquoted('"a b"'), unquoted("a'b")
        ("it's", 'a b', "a'b")
    """
    mark = value[:1]
    if len(value) < 2 or mark not in "'\"" or value[-1] != mark or exists(value):
        return value
    inner = value[1:-1]
    if re.search(rf"(?<!\\)(\\\\)*{mark}", inner):  # 'a','b'
        return value
    return re.sub(rf"(\\+)({mark}|$)", lambda m: "\\" * (len(m[1]) // 2) + m[2], inner)


def quoted(value: str) -> str:
    r"""A value of any text, quoted by the rules of Hydra's grammar.

    Example:
        >>> print(quoted("it's"), quoted(r"a\b"))
        'it\'s' 'a\b'
    """
    # Hydra's grammar reads a backslash as itself, except before the quote or at the end
    escaped = re.sub(
        r"(\\*)('|$)", lambda m: m[1] * 2 + ("\\'" if m[2] else ""), value, flags=re.DOTALL
    )
    return f"'{escaped}'"


def hydra_value(value: Any) -> str:
    """Plain data in Hydra's grammar: nested dictionaries, lists, text, numbers and None.

    Example:
        >>> print(hydra_value({"a": [1, None, "x y"], "b": True}))
        {a: [1, null, 'x y'], b: true}
    """
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {hydra_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(hydra_value, value)) + "]"
    if isinstance(value, str):
        return quoted(value)
    return "null" if value is None else str(value).lower()


def for_hydra(word: str, sweeps: bool = False) -> str:
    """Quotes the value of a ``key=value`` word if Hydra would misread it.

    Args:
        word: Word as typed.
        sweeps: Whether commas separate the values of jobs.

    Example:
        >>> for_hydra("data.root=in/Prüfstand")
        "data.root='in/Prüfstand'"
        >>> for_hydra("optim.lr=1e-3"), for_hydra("objective=[pixel,diff]")
        ('optim.lr=1e-3', 'objective=[pixel,diff]')
        >>> for_hydra("data.root=a (1),b=c", sweeps=True)
        "data.root='a (1)','b=c'"
    """
    key, equals, value = word.partition("=")
    if not equals or key.startswith("~"):
        return word
    value = at_home(value)
    names_path = re.split(r"[.@/]", key.lstrip("+"))[-1] in _PATHS
    return f"{key}={_value(value, names_path, sweeps)}"


def _value(value: str, names_path: bool, sweeps: bool) -> str:
    if value in ("", "null") or ("${" in value and _parses(value)):
        return value
    if unquoted(value) != value:
        return quoted(unquoted(value))
    # a file whose name has a comma is not a choice of two values
    if exists(value) and (names_path or not _parses(value) or len(split(value)) > 1):
        return quoted(value)
    if sweeps and len(items := split(value)) > 1:
        return ",".join(_value(item, names_path, False) for item in items)
    if sweeps and re.match(r"(choice|range|interval|glob|tag|shuffle|sort)\(.*\)$", value):
        return value
    if names_path and value[0] not in "[{":
        return quoted(value)
    return value if _parses(value) else _text(value)


def _text(value: str) -> str:
    """Quotes text outside Hydra's grammar: lists and mappings item by item, all else as one."""
    if value[0] in "[{" and value[-1] != {"[": "]", "{": "}"}[value[0]]:
        return value  # an unclosed list is a typing error, so Hydra shall report it
    if value[0] == "[":
        return f"[{','.join(_item(item) for item in split(value[1:-1]))}]"
    if value[0] == "{" and ":" in value:
        pairs = [item.partition(":") for item in split(value[1:-1])]
        return f"{{{','.join(f'{key.strip()}: {_item(rest)}' for key, _, rest in pairs)}}}"
    return quoted(value)


def _item(value: str) -> str:
    value = value.strip()
    return value if not value or _parses(value) else _text(value)


def split(value: str) -> list[str]:
    """The parts between commas, outside quotes and brackets.

    Example:
        >>> split("a,[b,c],'d,e'")
        ['a', '[b,c]', "'d,e'"]
    """
    parts, depth, mark = [""], 0, ""
    for place, letter in enumerate(value):
        if mark:
            mark = "" if letter == mark and value[place - 1] != "\\" else mark
        elif letter in "'\"" and not parts[-1].strip():  # a quote in the middle belongs to a name
            mark = letter
        elif letter in "[{(":
            depth += 1
        elif letter in "]})":
            depth -= 1
        if letter == "," and not mark and depth <= 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def exists(value: str) -> bool:
    """Whether a word is the path of an existing file or folder."""
    try:
        return Path(value).exists()
    except (OSError, ValueError):  # too long for a path, or with a null byte
        return False


def _parses(value: str) -> bool:
    """Whether Hydra's grammar reads a value."""
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    try:
        OverridesParser.create().parse_override(f"key={value}")
    except HydraException:
        return False
    return True
