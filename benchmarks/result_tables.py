"""Writes the tables of growth.json (docs/fast.md) and of damaged files (docs/reliability.md).

Run: python result_tables.py
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from textwrap import TextWrapper
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results"
END = "<!-- end -->"
#: Items in lines as those of the pages are.
_FILLED = TextWrapper(110, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
#: Exponent at the large end, and growth of memory from the smallest to the largest size, MB, above
#: which a row has a note.
LINEAR, GROWS = 1.1, 10.0
#: Exponent at the large end below which a row is named below the table only.
FLAT = 0.2
#: Why a cost grows faster than linear, or memory grows, by what there is more of and the verb.
NOTES: dict[tuple[str, str], str] = {
    ("seconds", "sim"): "memory is that of the most detailed shape so far, not of the number of "
    "touches: of 23 touches, looked at one by one, five raised it, and the thirteen last did not.",
    ("sensors", "sim"): "all sensors feel a touch together, so the gels and pictures of one touch "
    "on each are in memory at once.",
    ("images of each of 4 classes", "bench"): "features are in a mapped file, whose pages count "
    "here; the probe reads them.",
    ("epochs of the probe", "bench"): "`linear` is fitted until it has converged, whatever the "
    "number of epochs.",
    ("recordings of 20 frames", "inspect"): "pictures of 400 recordings at most are looked at, "
    "and compared in pairs; of the others labels only.",
    ("classes of 8 images", "bench"): "L-BFGS keeps 100 directions of a layer that has a row a "
    "class and a column an axis of the images, so that work is classes x images.",
}


def needs_note(row: Mapping[str, Any]) -> bool:
    """Whether a row grows faster than it should."""
    return bool(row["slope_large"] > LINEAR or row["mb"][-1] - row["mb"][0] > GROWS)


def growth_table(result: Mapping[str, Any]) -> str:
    """Cost against the amount of work, with notes on rows."""
    lines = [
        "| more | verb | sizes | CPU s | slope, at the large end | memory, MB |",
        "|---|---|---|---|---|---|",
    ]
    flat = [row for row in result["rows"] if row["slope_large"] < FLAT and not needs_note(row)]
    for row in result["rows"]:
        if row in flat:
            continue
        cells = [
            row["grows"],
            row["verb"],
            ", ".join(str(one) for one in row["sizes"]),
            ", ".join(f"{one:.1f}" for one in row["cpu_s"]),
            f"{row['slope']:.2f}, {row['slope_large']:.2f}",
            ", ".join(f"{one:.0f}" for one in row["mb"]),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    notes = [
        f"- `{row['verb']}`, {row['grows']}: {note}"
        for row in result["rows"]
        if (note := NOTES.get((row["grows"], row["verb"])))
    ]
    said = []
    for grows, rows in groupby(flat, key=lambda row: row["grows"]):
        verbs = ", ".join(f"`{row['verb']}`" for row in rows)
        said.append(f"{grows} ({verbs})")
    if said:
        notes.append(f"- No growth, with a slope below {FLAT} at the large end: {'; '.join(said)}.")
    filled = [line for note in notes for line in _FILLED.wrap(note)]
    return "\n".join([*lines, *([""] if notes else []), *filled]) + "\n"


#: Formats by the readers of their files.
FORMATS: dict[str, tuple[str, ...]] = {
    "zarr 2 and 3, also in a zip": (
        "zarr 2", "zarr 3", "zarr in a zip", "reactive_diffusion", "touch_in_the_wild", "manifeel",
    ),
    "HDF5": ("HDF5", "HDF5, groups", "freetacman", "aloha", "vtouch", "omnisharing"),
    "npz and npy": ("npz", "png, npy", "npy, CSV", "feats", "points", "tactile_tracking"),
    "MATLAB 5 and 7.3": ("mat 5", "mat 7.3"),
    "LeRobot 2.1 and 3.0": ("LeRobot 2.1, video", "LeRobot 3.0, video", "LeRobot 3.0, parquet"),
    "parquet": ("gelsight_mini_pretrain", "tactile_mnist", "image_tables"),
    "ROS 2 bags, sqlite3": ("bag, sqlite3",),
    "ROS 2 bags, mcap": ("bag, mcap", "bag, mcap zstd"),
    "ROS 1 bags": ("bag, ROS 1",),
    "shards": ("shards, index", "shards, no index"),
    "tars of samples": ("tars of samples", "fota"),
    "videos and tables": ("mp4, CSV", "avi, CSV", "gelslam", "octopi"),
    "pickles": ("pickle", "sparsh_force", "sparsh_pose", "sparsh_slip", "touch_slide"),
    "checkpoints, models and calibrations": ("checkpoint", "model", "calibration"),
    "heads and published weights": (
        "class head", "published weights, pt", "published weights, safetensors",
    ),
}  # fmt: skip
_TABLES_BESIDE = "tables of forces beside pictures"
_PICTURES = "pictures, tables and other files"


def format_of(name: str) -> str:
    """Format of a reader."""
    if name.startswith("forces in"):
        return _TABLES_BESIDE
    return next((one for one, names in FORMATS.items() if name in names), _PICTURES)


def instead_table(found: Mapping[str, Any]) -> str:
    """Outcomes for sets with a replaced file, by format."""
    lines = [
        "| format | readers | times | said | same | silent | traceback, hang, 500 MB |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [_instead_row(name, held) for name, held in _by_format(found)]
    lines.append(_instead_row("all", [*found.values()]))
    return "\n".join(lines) + "\n"


def _instead_row(name: str, rows: list[Any]) -> str:
    def total(*keys: str) -> int:
        return sum(row[key] for row in rows for key in keys)

    cells = [
        len(rows),
        *(total(key) for key in ("mutants", "named", "equal", "silent")),
        total("traceback", "hang", "memory"),
    ]
    return f"| {name} | {' | '.join(map(str, cells))} |"


def _by_format(found: Mapping[str, Any]) -> Iterator[tuple[str, list[Any]]]:
    """Formats and the rows of their readers, in the order of the page."""
    order = (*FORMATS, _TABLES_BESIDE, _PICTURES)
    rows = sorted(found.items(), key=lambda item: order.index(format_of(item[0])))
    for name, group in groupby(rows, key=lambda item: format_of(item[0])):
        yield name, [row for _, row in group]


def mutants_table(found: Mapping[str, Any]) -> str:
    """Outcomes of damaged files, by format and by checksum."""
    lines = [
        "| format | checksum | bytes | silent | structure | silent | refused | counted | same | "
        "traceback, hang, 500 MB |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, held in _by_format(found):
        lines.append(_mutants_row(name, "own" if held[0]["checksum"] else "none", held))
    for said, own in (("own", True), ("none", False)):
        held = [row for row in found.values() if row["checksum"] is own]
        lines.append(_mutants_row(f"all {len(held)} readers", said, held))
    return "\n".join(lines) + "\n"


def _mutants_row(name: str, checksum: str, rows: list[Any]) -> str:
    def total(*keys: str, ways: tuple[str, ...] = ("bytes", "structure")) -> int:
        return sum(row.get(way, {}).get(key, 0) for row in rows for way in ways for key in keys)

    every = tuple(key for key in rows[0]["structure"])
    cells = [
        total(*every, ways=("bytes",)),
        total("silent", ways=("bytes",)),
        total(*every, ways=("structure",)),
        total("silent", ways=("structure",)),
        total("refused", "nameless"),
        total("counted"),
        total("equal"),
        total("traceback", "hang", "memory"),
    ]
    return f"| {name} | {checksum} | {' | '.join(map(str, cells))} |"


#: Page, mark, file of results and table.
TABLES = (
    ("fast.md", "<!-- made by benchmarks/growth.py -->\n", "growth.json", growth_table),
    (
        "reliability.md",
        "<!-- made by benchmarks/reader_mutants.py --instead -->\n",
        "reader_instead.json",
        instead_table,
    ),
    (
        "reliability.md",
        "<!-- made by benchmarks/reader_mutants.py -->\n",
        "reader_mutants.json",
        mutants_table,
    ),
)


def page_with(page: str, mark: str, table: str) -> str:
    """A page with a table between its mark and the next end."""
    before, _, rest = page.partition(mark)
    return before + mark + table + END + rest.partition(END)[2]


def main() -> None:
    for name, mark, results, table in TABLES:
        path = ROOT / "docs" / name
        made = table(json.loads((RESULTS / results).read_text("utf-8")))
        path.write_text(page_with(path.read_text("utf-8"), mark, made), "utf-8")


if __name__ == "__main__":
    main()
