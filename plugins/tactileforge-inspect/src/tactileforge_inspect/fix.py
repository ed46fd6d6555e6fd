"""Writes keys that put recordings right into the layout file of a folder."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tactileforge.checks import Finding
from tactileforge.contracts import Dataset
from tactileforge.datasets import LAYOUT_FILE
from tactileforge.errors import ConfigError
from tactileforge.plugins import dump_yaml, load_yaml, write_text


def fix_layouts(dataset: Dataset, findings: Sequence[Finding]) -> dict[str, dict[str, Any]]:
    """Write the keys of findings that all recordings of a layout agree on.

    Args:
        dataset: A data set of layouts, in the file of its folder.
        findings: Findings, with their keys.

    Returns:
        Keys that were written, by the layout.

    Raises:
        ConfigError: The data has no layout file, or its layouts are those of the command line.
    """
    root = getattr(dataset, "root", None)
    file = Path(root) / LAYOUT_FILE if root is not None else None
    if file is None or not file.is_file() or getattr(dataset, "_given", None):
        raise ConfigError(
            f"fix=true writes into {LAYOUT_FILE} of the folder, and this data has none: write the "
            "layout there first (data inspect DIR keeps a guess of it)"
        )
    wanted: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for one in findings:
        layout = one.where.partition("/")[0]
        for key, value in one.keys.items():
            wanted[layout][key].append(value)
    counts: dict[str, int] = defaultdict(int)
    for split in ("train", "val"):
        for recording in dataset.recordings(split):
            counts[recording.key.partition("/")[0]] += 1
    plain = load_yaml(file.read_text("utf-8"))
    fixed: dict[str, dict[str, Any]] = {}
    for layout, keys in wanted.items():
        if layout not in plain["layouts"]:
            continue
        # a key of the layout is one of all its files: where only some are wrong, it would break
        # the others
        agreed = {
            key: values[0]
            for key, values in keys.items()
            if len(values) == counts[layout] and all(value == values[0] for value in values)
        }
        if agreed:
            plain["layouts"][layout] |= agreed
            fixed[layout] = agreed
    if fixed:
        # what was written by hand is kept beside it, with its comments
        write_text(file.with_suffix(".yaml.before"), file.read_text("utf-8"))
        write_text(file, dump_yaml(plain))
    return fixed
