"""Training data named by a model's file, and its overlap with the gate's held-out data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any

from tactileforge.hub import Header

#: Sets of which the gate holds objects out, and the share that training has to leave out
#: (`datasets.reading.splits.is_held_out` of the object's name, as `data=gsmini_slip`
#: asks for). The second is the first as its authors publish it (`data=incipient_slip`).
HELD_OUT = {
    "gsmini_slip_franka": 0.5,
    "franka-servo/datasets/base_data_for_training": 0.5,
    "octopi_physiclear": 0.5,
}
#: Sets that are held out as a whole.
KEPT = (
    "wedge_ball_presses",
    "taxim_calibration/gelsight_mini",
    "digit_tactile_320x240.mp4",
    "anytouch2_umi_cable",
    "gelslam_mini",
)


def trained_on(header: Header) -> list[str]:
    """Names of data sets, sorted; of layouts their folders."""
    node = header.recipe.get("data") or {"name": header.data.get("name") or "unknown"}
    return sorted({name for name, _ in _sets(node)})


def seen(header: Header) -> list[str]:
    """Held-out data of the gate possibly seen in training, sorted; ideally empty."""
    overlap = []
    for name, held_out in _sets(header.recipe.get("data") or {}):
        for known, share in HELD_OUT.items():
            if known in name and held_out < share:
                overlap.append(f"{known} (val={held_out:g}, not {share:g})")
        overlap += [f"{kept} (held out)" for kept in KEPT if kept in name]
    return sorted(set(overlap))


def _sets(node: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Names of data sets with their held-out share of objects; 0 where not split by object."""
    for inner in (node.get("sources") or {}).values():
        yield from _sets(inner)
    layouts = {name: layout for name, layout in (node.get("layouts") or {}).items() if layout}
    for name, layout in layouts.items():
        # `split` in the recipes of older models
        by_object = layout.get("hold_out", layout.get("split")) == "object"
        files = layout.get("videos") or layout.get("images") or ""
        path = str(
            PurePosixPath(str(layout.get("path", name))) / (files if files == str(files) else "")
        )
        yield path, float(node.get("val", 0.1)) if by_object else 0.0
    if not node.get("sources") and not layouts:
        root = str(node.get("root") or "")
        yield f"{node.get('name', 'unknown')} {root}".strip(), 0.0
