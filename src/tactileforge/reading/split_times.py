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

    Returns:
        The function; 0 for every row without a second column, or where the numbers are not whole
        seconds and parts of one.

    Example:
        >>> rows = [("row 2", {"stamp.sec": "17", "stamp.nanosec": "250000000"})]
        >>> part_of_second("stamp.sec", rows)(rows[0][1])
        Decimal('0.25')
    """
    if nanoseconds := nanoseconds_beside(column, [cells for _, cells in rows]):
        return lambda cells: Decimal(cells[nanoseconds]) / 10**9
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


def nanoseconds_beside(column: str, rows: Sequence[Cells]) -> str:
    """Column of nanoseconds behind seconds since 1970, both with numbers for names.

    Returns:
        The column; "" without one, and for columns with names.
    """
    beside = str(int(column) + 1) if column.isdecimal() else ""
    if not rows or beside not in rows[0]:
        return ""
    pairs = [(cells[column], cells[beside]) for cells in rows]
    if not all(first.isdecimal() and then.isdecimal() for first, then in pairs):
        return ""
    # ten digits from 2001 to 2286; all nanoseconds of a message below a millisecond are unlikely
    are_seconds = all(len(first) == 10 and int(then) < 10**9 for first, then in pairs)
    return beside if are_seconds and max(int(then) for _, then in pairs) >= 10**6 else ""
