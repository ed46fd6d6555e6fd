"""The page of a data set, as HTML."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from tactileforge.contracts import Dataset
from tactileforge.errors import ConfigError
from tactileforge.pages import Section, html_page, next_commands, preformatted
from tactileforge.plugins import write_text
from tactileforge_inspect import issues, sections
from tactileforge_inspect.findings import InspectionFindings
from tactileforge_inspect.scan import scan_dataset


def inspect(
    dataset: Dataset,
    name: str,
    path: Path,
    recordings: int = 400,
    progress: bool = True,
    doubts: Sequence[str] = (),
    layout: str = "",
) -> InspectionFindings:
    """Write a page on a data set: its content, its images and its problems.

    All recordings are counted, and ``recordings`` of them, spread over the sensors, are decoded: at
    most 24 frames each, and all frames of ten recordings with force. Memory does not grow with
    their number.

    Args:
        dataset: Data set with the splits ``train`` and ``val``.
        name: Name on the page.
        path: Path of the page, one HTML file without links to the network.
        recordings: Number of recordings to decode.
        progress: Whether to show progress bars.
        doubts: What was guessed of the data set and has to be checked, a line each.
        layout: What the data set was read by, as YAML to copy; "" to leave it out.

    Returns:
        The findings; as text, a summary of a few lines.

    Raises:
        ConfigError: ``recordings`` is below 1.
        DataNotFoundError: The data is missing.
        DataError: No recording can be opened.
    """
    if recordings < 1:
        raise ConfigError(f"recordings={recordings}: give 1 or more")
    contents = scan_dataset(dataset, recordings, progress)
    read = Section("read", "What was read", preformatted(layout))
    parts = [
        *([read] if layout else []),
        sections.totals(contents),
        sections.sheets(contents),
        sections.strips(contents),
        sections.label_histograms(contents),
        issues.duplicates_section(contents),
        issues.suspicious_section(contents),
        next_commands(_next(name, dataset)),
    ]
    write_text(
        path, html_page(f"Data set {name}", issues.top_section(name, contents, doubts), parts)
    )
    return contents.findings


def _next(name: str, dataset: Dataset) -> list[tuple[str, str]]:
    """Next commands for a data set, with objectives for its labels."""
    where = shlex.quote(f"data.root={getattr(dataset, 'root', 'DIR')}")
    root = "" if name == "sim" else f" {where}"
    learned = ["pixel", "diff", *(["force"] if "force" in dataset.provides else [])]
    objective = "" if name == "sim" else f" 'objective=[{','.join(learned)}]'"
    return [
        (f"tactileforge data check data={name}{root}", "the same checks as lines, for a script"),
        (
            f"tactileforge data pack data={name}{root} out=packed",
            "pack it into shards, read faster",
        ),
        (
            f"tactileforge train data={name}{root} scale=demo{objective}",
            "train a small encoder on it",
        ),
    ]
