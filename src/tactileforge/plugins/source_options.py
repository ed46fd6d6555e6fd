"""Options of a plugin from its source text, so that help and composing import no torch.

Only what is plain is read: a class at the top of its module whose ``__init__``, its own or that of
its first base, has literals as defaults, or names of literals. All else gives None, and the plugin
is imported.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from inspect import Parameter
from pathlib import Path
from typing import Any, Literal, Optional, Union


@cache
def _module(name: str) -> ast.Module | None:
    """Syntax tree of a module that is not imported; None without readable source."""
    top, *rest = name.split(".")
    try:
        spec = find_spec(top)  # of a submodule it would import the parents
    except (ImportError, ValueError):
        return None
    places = list(spec.submodule_search_locations or ()) if spec and rest else []
    paths = [Path(place, *rest) for place in places]
    if spec and spec.origin and not rest:
        paths = [Path(spec.origin).with_suffix("")]
    for path in paths:
        for file in (path.with_suffix(".py"), path / "__init__.py"):
            if file.is_file():
                try:
                    return ast.parse(file.read_text("utf-8"))
                except (SyntaxError, ValueError, OSError):
                    return None
    return None


def read_options(target: str) -> dict[str, Any] | None:
    """Constructor parameters of ``module:Class`` and their defaults; None where they are not plain.

    Args:
        target: Value of an entry point.

    Returns:
        Defaults by name, `inspect.Parameter.empty` for none, without ``self``.
    """
    name, _, wanted = target.partition(":")
    tree = _module(name)
    if tree is None:
        return None
    kinds = [node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == wanted]
    if len(kinds) != 1 or kinds[0].decorator_list or kinds[0].keywords:
        return None
    methods = {node.name: node for node in kinds[0].body if isinstance(node, ast.FunctionDef)}
    made = methods.get("__init__")
    if made is None and "__new__" not in methods and len(kinds[0].bases) == 1:
        base = ast.unparse(kinds[0].bases[0])
        if base == "nn.Module" and "nn" in _imported(tree):
            return {}
        return read_options(_imported(tree).get(base, f"{name}:{base}"))
    if made is None or made.decorator_list or "__new__" in methods or made.args.posonlyargs:
        return None
    given = made.args
    first = len(given.args) - len(given.defaults)
    pairs: list[tuple[ast.arg, ast.expr | None]] = [
        (arg, given.defaults[place - first] if place >= first else None)
        for place, arg in enumerate(given.args)
    ][1:]
    pairs += list(zip(given.kwonlyargs, given.kw_defaults, strict=True))
    found = {}
    for arg, default in pairs:
        try:
            found[arg.arg] = Parameter.empty if default is None else _value(default, tree)
        except (ValueError, KeyError, TypeError, ZeroDivisionError):
            return None
    return found


#: Names in hints that are resolved; a hint with others is not read.
_HINTS = {
    **{one.__name__: one for one in (bool, int, float, str, list, tuple, dict)},
    **{"Any": Any, "Literal": Literal, "Mapping": Mapping, "Sequence": Sequence, "Path": Path},
    **{"Optional": Optional, "Union": Union},
}


def read_hints(target: str) -> dict[str, Any]:
    """Constructor parameters of ``module:Class`` and their types, Any for types with other names.

    Args:
        target: Value of an entry point.
    """
    name, _, wanted = target.partition(":")
    tree = _module(name)
    for node in tree.body if tree else ():
        if not isinstance(node, ast.ClassDef) or node.name != wanted:
            continue
        for one in node.body:
            if isinstance(one, ast.FunctionDef) and one.name == "__init__":
                given = [*one.args.args, *one.args.kwonlyargs]
                return {arg.arg: _hint(arg.annotation) for arg in given}
        if tree and len(node.bases) == 1:
            base = ast.unparse(node.bases[0])
            return read_hints(_imported(tree).get(base, f"{name}:{base}"))
    return {}


def _hint(node: ast.expr | None) -> Any:
    """Type written in a hint; Any for one with other names."""
    if node is None:
        return Any
    names = {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
    plain = (ast.Name, ast.Constant, ast.Subscript, ast.Tuple, ast.BinOp, ast.BitOr, ast.Load)
    if not names <= _HINTS.keys() or not all(isinstance(one, plain) for one in ast.walk(node)):
        return Any
    try:
        return eval(compile(ast.Expression(node), "hint", "eval"), {"__builtins__": {}}, _HINTS)
    except TypeError:
        return Any


def read_attribute(target: str, attribute: str) -> Any:
    """Literal of an attribute of ``module:Class`` itself; None without one.

    Args:
        target: Value of an entry point.
        attribute: Name of the attribute.
    """
    name, _, wanted = target.partition(":")
    tree = _module(name)
    for node in tree.body if tree else ():
        if isinstance(node, ast.ClassDef) and node.name == wanted:
            for one in node.body:
                places = one.targets if isinstance(one, ast.Assign) else []
                if isinstance(one, ast.AnnAssign) and one.value is not None:
                    places = [one.target]
                if any(isinstance(x, ast.Name) and x.id == attribute for x in places):
                    assert isinstance(one, ast.Assign | ast.AnnAssign)
                    value = one.value
                    return value.value if isinstance(value, ast.Constant) else None
    return None


def read_docstrings(target: str) -> list[str]:
    """Docstrings of ``module:Class``, of its ``__init__``, and of its first bases, nearest last."""
    name, _, wanted = target.partition(":")
    tree = _module(name)
    found: list[str] = []
    for node in tree.body if tree else ():
        if isinstance(node, ast.ClassDef) and node.name == wanted:
            base = ast.unparse(node.bases[0]) if node.bases else ""
            if tree and base.isidentifier():
                found += read_docstrings(_imported(tree).get(base, f"{name}:{base}"))
            found.append(ast.get_docstring(node) or "")
            made = [one for one in node.body if isinstance(one, ast.FunctionDef)]
            found += [ast.get_docstring(one) or "" for one in made if one.name == "__init__"]
    return found


def _constants(tree: ast.Module) -> dict[str, ast.expr]:
    """Names with one value at the top of a module."""
    found: dict[str, ast.expr] = {}
    twice = set()
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            targets = [node.target]
        for target in targets:
            if isinstance(target, ast.Name) and isinstance(node, ast.Assign | ast.AnnAssign):
                twice |= {target.id} & found.keys()
                assert node.value is not None
                found[target.id] = node.value
    return {name: value for name, value in found.items() if name not in twice}


def _imported(tree: ast.Module) -> dict[str, str]:
    """``module:name`` of each name that a module imports at its top from another."""
    return {
        item.asname or item.name: f"{node.module}:{item.name}"
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and node.module and not node.level
        for item in node.names
    }


def _value(node: ast.expr, tree: ast.Module) -> Any:
    """Value of a literal, of a quotient of literals, or of a name of one.

    Raises:
        ValueError, KeyError: It is none of these.
    """
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
        return _value(node.left, tree) / _value(node.right, tree)
    if isinstance(node, ast.Dict) and all(node.keys):
        keys = [_value(key, tree) for key in node.keys if key is not None]
        return dict(zip(keys, (_value(value, tree) for value in node.values), strict=True))
    if isinstance(node, ast.List | ast.Tuple):
        items = [_value(item, tree) for item in node.elts]
        return items if isinstance(node, ast.List) else tuple(items)
    if not isinstance(node, ast.Name):
        return ast.literal_eval(node)
    constants = _constants(tree)
    if node.id in constants:
        return _value(constants[node.id], tree)
    module, _, name = _imported(tree)[node.id].partition(":")
    home = _module(module)
    if home is None:
        raise KeyError(node.id)
    return _value(ast.Name(name), home)
