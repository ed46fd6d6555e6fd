"""Validation of a layout's ``times`` and ``order``: the origin of frame times and order."""

from __future__ import annotations

from tactileforge.data.labels.clock import seconds_of
from tactileforge.errors import ConfigError, unknown
from tactileforge.reading.layout_keys import ClockKeys

#: Words for the origin of the times of images.
TIMES = ("even", "names")


def parse_times(times: ClockKeys | str | None, each: str, where: str) -> ClockKeys | str:
    """The origin of the times of frames; "" to detect it, ``even``, ``names``, or a CSV.

    Raises:
        ConfigError: The value is invalid, or does not apply to ``each``.
    """
    times = times or ""
    if isinstance(times, ClockKeys):
        if times.file is None:
            times = ClockKeys(unit=times.unit)
        elif times.column is None:
            raise ConfigError(f"{where}: times: give the column of the times: {{file, column}}")
        if times.unit is not None:
            seconds_of(times.unit, f"{where}: times")
    elif times not in ("", *TIMES):
        known = f"{unknown('times', times, TIMES)}, or a CSV: {{file: times.csv, column: t}}"
        raise ConfigError(f"{where}: {known}")
    by_name = times == "names" or (isinstance(times, ClockKeys) and times.file is None)
    if each == "touch" and times:
        raise ConfigError(f"{where}: times: one image has no times; give each: sequence")
    if each == "video" and by_name:
        raise ConfigError(f"{where}: times: a video has no names of images; give a CSV, or fps:")
    return times


def parse_order(order: ClockKeys | str | None, each: str, where: str) -> ClockKeys | str:
    """The order of the images of a sequence; "" for the natural one, a pattern, or a CSV.

    Raises:
        ConfigError: The value is invalid, or does not apply to ``each``.
    """
    order = order or ""
    if order and each != "sequence":
        raise ConfigError(f"{where}: order: is for images of each: sequence")
    if isinstance(order, ClockKeys) and not (order.file and order.column and order.key):
        raise ConfigError(
            f"{where}: order: give a pattern (order: 'f{{number}}') or {{file, key, column}}"
        )
    if isinstance(order, str) and order and order.count("{number}") != 1:
        raise ConfigError(f"{where}: order: {order!r} needs {{number}} once: order: 'f{{number}}'")
    return order
