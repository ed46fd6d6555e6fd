"""Times in two columns, whole seconds and the part of a second, as ROS and C write them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from typing import TypeAlias

#: Cells of a row, by their columns.
Cells: TypeAlias = Mapping[str, str]

_SECONDS = re.compile(r"(?<![a-z])(secs?|seconds?)(?![a-z])")
#: Beginnings of words for a part of a second, how many make one, and their seconds.
_PARTS = {"nano": 10**9, "n": 10**9, "micro": 10**6, "u": 10**6, "milli": 10**3, "m": 10**3}


def part_of_second(column: str, rows: Sequence[tuple[str, Cells]]) -> Callable[[Cells], Decimal]:
    """Function from the cells of a row to the part of a second beside its whole seconds.

    Args:
        column: Column of the seconds, such as ``secs``, ``sec`` or ``stamp.sec``.
        rows: Place and cells of each row.

    Returns:
        The function; 0 for every row without a second column, or where the numbers are not whole
        seconds and parts of one.

    Example:
        >>> rows = [("row 2", {"stamp.sec": "17", "stamp.nanosec": "250000000"})]
        >>> part_of_second("stamp.sec", rows)(rows[0][1])
        Decimal('0.25')
    """
    header = {name.casefold().strip(): name for name in (rows[0][1] if rows else {})}
    plain = column.casefold().strip()
    for begin, count in _PARTS.items() if _SECONDS.search(plain) else ():
        # `nsec`, or the word alone; a letter alone may be anything, such as a mass m
        alone = [_SECONDS.sub(begin, plain)] if len(begin) > 1 else []
        for word in (_SECONDS.sub(rf"{begin}\1", plain), *alone):
            beside = header.get(word)
            # in every row: one part that is none, or as large as a second, and it is another column
            if beside is not None and all(
                cells[column].isdecimal()
                and cells[beside].isdecimal()
                and int(cells[beside]) < count
                for _, cells in rows
            ):
                return lambda cells, beside=beside, count=count: Decimal(cells[beside]) / count  # type: ignore[misc]
    return lambda cells: Decimal(0)
