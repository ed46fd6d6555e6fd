"""Text and images from data sets: read as plain values, within limits, without running code.

A name in braces (``${...}``) stays text: it is never looked up, so that nothing of this machine
(its environment, its other files) gets into the results made of the data.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import yaml

from tactileforge.util.pointers import pointer_words
from tactileforge.util.regular import check_regular

if TYPE_CHECKING:
    from PIL import Image

#: Most characters of a YAML text, and most values in it, counted as often as aliases repeat them.
_MAX_YAML, _MAX_NODES = 1 << 19, 100_000
#: Most pixels of a picture: 8192 x 4096, of which decoders make up to six copies.
MAX_PIXELS = 1 << 25


class _Loader(yaml.SafeLoader):
    """YAML 1.2's numbers, no dates, and no key twice."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        counts = Counter(map(str, keys))
        if twice := [key for key in keys if key != "<<" and counts[str(key)] > 1]:
            raise ValueError(f"line {node.start_mark.line + 1}: {twice[0]!r} comes twice")
        return super().construct_mapping(node, deep)


# dates stay text: they are keys and names of recordings, and PyYAML's would not be written back as
# they were
_Loader.yaml_implicit_resolvers = {
    first: [(tag, rule) for tag, rule in rules if not tag.endswith(":timestamp")]
    for first, rules in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
# PyYAML reads 1e-3 as text: it follows YAML 1.1, with a dot in every float (yaml/pyyaml#173). Can
# go once it follows YAML 1.2
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?\d[\d_]*(\.\d*)?[eE][-+]?\d+$"),
    list("-+0123456789"),
)


class _Dumper(yaml.SafeDumper):
    """Quotes strings not read as text by `_Loader`."""


_Dumper.yaml_implicit_resolvers = _Loader.yaml_implicit_resolvers


def dump_yaml(plain: Any, **options: Any) -> str:
    """Writes plain values as YAML, to be read back by `load_yaml`; keys keep their order."""
    text: str = yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=True, **options)
    return text


def load_yaml(text: str) -> Any:
    """Reads the values of a YAML text.

    Raises:
        ValueError: The text is not YAML, has a key twice, or is too large or nested too deep.

    Example:
        >>> load_yaml("a: [1, 2e-3, '${oc.env:HOME}', 2026-01-01]")
        {'a': [1, 0.002, '${oc.env:HOME}', '2026-01-01']}
    """
    if len(text) > _MAX_YAML:
        raise ValueError(f"{len(text)} characters, where {_MAX_YAML} are the limit")
    try:
        loader = _Loader(text)
        root = loader.get_single_node()
        if root is None:
            return None
        # counted before it is built: a few lines of nested aliases stand for billions of values
        if _size(root, {}) > _MAX_NODES:
            raise ValueError(f"more than {_MAX_NODES} values, with those that aliases repeat")
        return loader.construct_document(root)
    except yaml.YAMLError as error:
        raise ValueError(f"not YAML: {_in_a_line(error)}") from error
    except RecursionError as error:
        raise ValueError("not YAML of ours: nested too deep, or in itself") from error


def _in_a_line(error: yaml.YAMLError) -> str:
    """The fault and its place: the parser's own words take five lines, with the text in them."""
    mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
    if mark is None or not problem:
        return " ".join(str(error).split())
    return f"line {mark.line + 1}, column {mark.column + 1}: {problem}"


def _size(node: Any, known: dict[int, int]) -> int:
    """Values of a node, each as often as it is repeated."""
    if id(node) not in known:
        inner = node.value if isinstance(node, yaml.CollectionNode) else ()
        parts = [part for item in inner for part in (item if isinstance(item, tuple) else (item,))]
        known[id(node)] = 1 + sum(_size(part, known) for part in parts)
    return known[id(node)]


def load_json(text: str | bytes) -> Any:
    """Reads the values of a JSON text.

    Raises:
        ValueError: The text is not JSON, or is nested too deep.

    Example:
        >>> load_json('{"fps": 30}')
        {'fps': 30}
    """
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deep") from error
    except ValueError as error:
        words = pointer_words(text.encode() if isinstance(text, str) else text)
        raise ValueError(words or str(error)) from error


def open_picture(file: str | Path | IO[bytes]) -> Image.Image:
    """Opens an image with Pillow; its size must be within limits.

    Raises:
        OSError: The file cannot be read, or is a pipe or device.
        SyntaxError: The header of the image is damaged.
        ValueError: The image has more than `MAX_PIXELS` pixels, or the file is damaged.
    """
    from PIL import Image

    if isinstance(file, str | Path):
        check_regular(file)
    try:
        opened = Image.open(file)
    # a warning arrives here where warnings are errors, as in tests
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise ValueError(str(error)) from error
    if opened.width * opened.height > MAX_PIXELS:
        opened.close()
        raise ValueError(
            f"{opened.width} x {opened.height} pixels, where {MAX_PIXELS:,} in all are the limit"
        )
    return opened
