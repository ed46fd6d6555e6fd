"""``--help`` of a command: its usage line, its options, and its keys."""

from __future__ import annotations

import re
from collections.abc import Sequence
from inspect import Parameter
from textwrap import wrap

from tactileforge.cli._command import Command
from tactileforge.cli._options import MULTI, options, yaml_groups, yaml_options, yaml_text
from tactileforge.cli._verbs import builtin, commands
from tactileforge.plugins import local, registry
from tactileforge.plugins.distributions import is_ours
from tactileforge.util import strict

_FLAGS = """\
--cfg job  what would be used   --explain KEY  where a value comes from   -m key=1,2  once for each
--config-dir DIR  options of your own, as DIR/GROUP/NAME.yaml
GROUP=NAME --help  the keys of that option too; all of them: docs/keys.md"""

#: Groups whose first YAML lists all keys with their meanings.
_WHOLE = ("trainer", "optim", "batch")


def text(verb: str, command: Command, typed: Sequence[str] = ()) -> str:
    """Full help of a command: usage, summary, options and keys.

    Args:
        verb: Verb and action as typed.
        command: Command of that verb and action.
        typed: Words beside ``--help``; the keys of options chosen by them are listed too.
    """
    bare = "".join(f" {word.upper()}" for word in command.bare)
    groups = dict(command.groups) or (
        yaml_groups(command.yaml, _typed("scale", typed)) if command.yaml else {}
    )
    needed = "".join(f" {group}=NAME" for group, option in groups.items() if option == "???")
    lines = [f"tactileforge {verb}{bare}{needed} [key=value ...]", command.about, ""]
    for group, option in groups.items():
        chosen = _typed(group, typed) or option
        of_objectives = group == "head" and not _typed(group, typed) and _typed("objective", typed)
        if of_objectives:
            chosen = f"one for each of {of_objectives}"
        known = wrap(f"Known: {', '.join(options(group))}", 96)  # 98 columns with "# "
        lines += [*(f"# {line}" for line in known), f"{group}: {chosen or 'null'}", ""]
        lines += _keys_of_heads(of_objectives) if of_objectives else option_keys(group, chosen)
    if command.keys is not None:
        lines += [_described(command), ""]
    elif command.yaml:
        lines += [_after_defaults(command.yaml), ""]
    return "\n".join([*lines, _FLAGS])


def _typed(group: str, typed: Sequence[str]) -> str:
    """Option of a group among words of the user; "" without one."""
    return next((w.partition("=")[2] for w in typed if w.startswith(f"{group}=")), "")


def _names(chosen: str) -> list[str]:
    """One name, or several: ``[pixel,diff]``."""
    return [name for name in re.split(r"[\[\],\s]+", chosen) if name]


def _keys_of_heads(objectives: str) -> list[str]:
    """Keys of the heads of typed objectives."""
    lines = []
    for name in _names(objectives):
        if local.is_local(name):
            registry.adopt("objectives", name, "objective")
        if local.is_local(name) or name in registry.names("objectives"):
            head = registry.head_of(name)
            lines += [f"head.{local.key_of(name)}:  # {head}", *plugin_keys("head", head), ""]
    return lines


def option_keys(group: str, chosen: str | None) -> list[str]:
    """Keys of the chosen options of a group, each with its meaning and default."""
    if group in _WHOLE and chosen in yaml_options(group):
        rows = [f"  {line}" for line in yaml_text(f"{group}/{chosen}").rstrip().splitlines()]
        return [f"{group}:", *rows, ""]
    if group not in registry.GROUPS or chosen in (None, "???"):
        return []
    lines = []
    for name in _names(chosen):
        own = local.is_local(name)
        if own:
            registry.adopt(registry.GROUPS[group], name, group)
        if own or name in registry.names(registry.GROUPS[group]):
            place = f"{group}.{local.key_of(name)}" if group in MULTI else group
            lines += [f"{place}:  # {name}", *plugin_keys(group, name), ""]
    return lines


def keys_page() -> str:
    """The page docs/keys.md: every key of every verb and plugin, of the core and our packages."""
    lines = [_HEAD]
    # whatever else is installed where it is written
    ours = [one for one in registry.list_plugins() if is_ours(one.distribution)]
    added = {one.name.partition(".")[0] for one in ours if one.kind == "verbs"}
    for verb in [*builtin(), *sorted(added - builtin().keys())]:
        for action, command in commands(verb).items():
            if command.keys is not None and (rows := _described(command)):
                lines += [f"### {f'{verb} {action}'.strip()}", "", *_block(rows)]
    lines += ["## Training", "", "`tactileforge train` has these in groups.", ""]
    lines += _block(_after_defaults("train"))
    for group, option in yaml_groups("train").items():
        if group not in _WHOLE:
            continue
        lines += [f"### {group}={option}", "", *_block("\n".join(option_keys(group, option)))]
    for kind in (*registry.KINDS, "callbacks"):
        group = next((key for key, value in registry.GROUPS.items() if value == kind), "")
        if not group:
            continue
        place = f"{group}.NAME" if group in MULTI else group
        also = f", and `{place}.KEY=`."
        if group == "optim":
            also += f" Each has {', '.join(f'`{key}`' for key in _shared(group))} too, as `adamw`."
        lines += [f"## {kind.capitalize()}", "", f"`{group}=NAME`{also}", ""]
        for plugin in ours:
            if plugin.kind != kind or (group == "optim" and plugin.name in yaml_options(group)):
                continue  # with a YAML: listed above
            if rows := "\n".join(plugin_keys(group, plugin.name, "", shared=False)):
                lines += [f"### {group}={plugin.name}", "", *_block(rows)]
    return "\n".join(lines).rstrip() + "\n"


def _described(command: Command) -> str:
    """Keys of a command with their meanings, by their typed names."""
    rows = strict.describe(command.keys) if command.keys else ""
    for name, key in command.also.items():
        rows = re.sub(rf"^{key}:", f"{name}:", rows, flags=re.MULTILINE)
    return rows


_HEAD = """\
# Keys

```bash
tactileforge train data=recordings --help
```

All keys of all verbs and plugins, of the core and of the packages that `make test` installs: what
each means, and its default; `???` has to be given.
`tactileforge plugins keys markdown=true` writes this page from where they are defined.

## Verbs
"""


def _block(rows: str) -> list[str]:
    return ["```yaml", rows.strip("\n"), "```", ""]


def _shared(group: str) -> dict[str, list[str]]:
    """Keys of every optimizer, with their lines: those of the YAML beyond its class."""
    if group != "optim":
        return {}
    own, rows, lines = registry.options("optimizers", "adamw"), {}, []
    for line in yaml_text("optim/adamw").splitlines()[1:]:
        lines.append(line)
        if not line.startswith("#"):
            rows[line.partition(":")[0]], lines = lines, []
    return {key: said for key, said in rows.items() if key not in {*own, "name"}}


def plugin_keys(group: str, name: str, indent: str = "  ", shared: bool = True) -> list[str]:
    """Keys of a plugin as YAML, each with its meaning and default.

    Args:
        group: Its group.
        name: Its name.
        indent: Begin of each line.
        shared: Whether keys that every optimizer has are listed, too.
    """
    kind = registry.GROUPS[group]
    said = registry.meanings(kind, name)
    if group == "callbacks":  # Lightning's own say more, in its documentation
        said = {key: text.partition(". ")[0] for key, text in said.items()}
    lines = []
    if group == "objective":
        lines = [f"{indent}# Largest weight; a curriculum begins with 0.", f"{indent}weight: 1.0"]
    for key, default in registry.options(kind, name).items():
        value = strict.TO_GIVE if default is Parameter.empty else strict.written(default)
        lines += [*strict.comment(said.get(key, ""), indent), f"{indent}{key}: {value}"]
    for rows in _shared(group).values() if shared else ():
        lines += [f"{indent}{row}" for row in rows]
    return lines


def _after_defaults(name: str) -> str:
    """Text of a YAML after its defaults list, without Hydra's own keys."""
    text = yaml_text(name).partition("  - _self_\n")[2].partition("\n\n")[2]
    return text.partition("\nhydra:")[0].strip()
