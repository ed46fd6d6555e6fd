"""``--help`` of a command: how it is typed, its options, and its keys."""

from __future__ import annotations

from tactileforge import strict
from tactileforge.cli._command import Command
from tactileforge.cli._options import options, yaml_groups, yaml_text

_FLAGS = """\
--cfg job  what would be used   --explain KEY  where a value comes from   -m key=1,2  once for each
--config-dir DIR  options of your own, as DIR/GROUP/NAME.yaml"""


def text(verb: str, command: Command) -> str:
    """All that there is to know of a command."""
    bare = "".join(f" {word.upper()}" for word in command.bare)
    groups = dict(command.groups) or (yaml_groups(command.yaml) if command.yaml else {})
    needed = "".join(f" {group}=NAME" for group, option in groups.items() if option == "???")
    lines = [f"tactileforge {verb}{bare}{needed} [key=value ...]", command.about, ""]
    for group, option in groups.items():
        lines += _group(group, option)
    if command.keys is not None:
        lines += [strict.describe(command.keys), ""]
    elif command.yaml:
        lines += [_after_defaults(command.yaml), ""]
    return "\n".join([*lines, _FLAGS])


def _group(group: str, option: str | None) -> list[str]:
    from textwrap import wrap

    known = wrap(f"Known: {', '.join(options(group))}", 96)
    return [*(f"# {line}" for line in known), f"{group}: {option or 'null'}", ""]


def _after_defaults(name: str) -> str:
    """Text of a YAML after its defaults list, without Hydra's own keys."""
    text = yaml_text(name).partition("  - _self_\n")[2].partition("\n\n")[2]
    return text.partition("\nhydra:")[0].strip()
