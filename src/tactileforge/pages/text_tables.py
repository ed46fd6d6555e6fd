"""Tables as text: aligned columns for a terminal, and Markdown."""

from __future__ import annotations

from collections.abc import Collection, Sequence


def align_columns(rows: Sequence[Sequence[str]]) -> str:
    """Rows of words as aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def markdown_table(
    rows: Sequence[Sequence[str]], *, right: Collection[int] = (), aligned: bool = False
) -> str:
    r"""Rows of words as a Markdown table; the first is its head.

    Args:
        rows: Cells, in Markdown.
        right: Numbers of the columns to align to the right.
        aligned: Whether to pad the cells, for a readable source.

    Example:
        >>> print(markdown_table([("task", "R2"), ("force", "0.9")], right={1}, aligned=True))
        | task  |  R2 |
        |-------|----:|
        | force | 0.9 |
    """
    widths = [max(map(len, column)) if aligned else 0 for column in zip(*rows, strict=True)]
    pads = [f"{'>' if i in right else '<'}{width}" for i, width in enumerate(widths)]
    head, *body = (f"| {' | '.join(map(format, row, pads))} |" for row in rows)
    rules = (f"{'-' * max(2, width + 1)}{'-:'[i in right]}" for i, width in enumerate(widths))
    return "\n".join([head, f"|{'|'.join(rules)}|", *body])
