"""Guesses about numbers by their names and values: units of time, and signs of forces."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.clock import UNITS, date_unit
from tactileforge.reading.guessing.view_words import words_of

#: Words of units of time.
_TIME_WORDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanoseconds"), "ns"),
}
#: Plausible rates, rows a second: no two units of time fit one step.
_RATES = 0.5, 500.0
#: Share of the steps that rise in times, of which a few may be damaged.
_RISING = 0.99
#: Ratio of the most negative normal force to the largest from which pressing is negative.
_PULLING = 3.0
#: The axes of forces, as all lines to be checked say them.
AXES = "x right, y down, z into the gel, pressing positive"


def named_time_unit(name: str) -> str:
    """The unit of time at the end of a name; "" for a name without one.

    Example:
        >>> named_time_unit("time_ms"), named_time_unit("t [\u00b5s]"), named_time_unit("stamps")
        ('ms', 'us', '')
    """
    words = words_of(name.replace("\u00b5", "u").replace("\u03bc", "u"))
    return _TIME_WORDS.get(words[-1], "") if words else ""


def likely_unit(step: float) -> str:
    """The unit of time for a step of a camera or sensor; "" for none.

    Example:
        >>> likely_unit(0.033), likely_unit(33), likely_unit(33_000_000)
        ('s', 'ms', 'ns')
    """
    rates = ((unit, step * seconds) for unit, seconds in UNITS.items())
    return next((unit for unit, one in rates if _RATES[0] * one < 1 <= _RATES[1] * one), "")


def time_unit(name: str, values: NDArray[Any]) -> tuple[str, str]:
    """Unit of times, and the reason for it; ``frames`` for counters, "" for other values.

    Args:
        name: Name of the array.
        values: Times of an episode, (T,).

    Raises:
        ValueError: The name says another unit than the values.

    Example:
        >>> time_unit("t_ms", np.arange(3) * 33)
        ('ms', 'as its name says')
    """
    steps = np.diff(values.astype(np.float64) if values.dtype.kind == "u" else values)
    if len(steps) < 1 or not np.isfinite(values).all() or (steps > 0).mean() < _RISING:
        return "", "its values do not rise"
    step, date, named = float(np.median(steps)), date_unit(values), named_time_unit(name)
    if date and named and named != date:
        raise ValueError(f"its name says {named}, and its values are dates in {date}")
    if named:
        return named, "as its name says"
    if date:
        return date, "its values are dates since 1970"
    if step == 1 and (values == np.rint(values)).all():
        return "frames", "its values count"
    if unit := likely_unit(step):
        rate = 1 / (step * UNITS[unit])
        return unit, f"a step of {step:.4g} makes {rate:.4g} rows a second"
    return "", f"its unit is not known (a step of {step:.4g})"


def is_turned(force: NDArray[np.float64]) -> bool:
    """Whether a normal force is largely negative, as pressing never is.

    Example:
        >>> is_turned(np.array([0.1, -5.0])), is_turned(np.array([-0.1, 5.0]))
        (True, False)
    """
    values = force[np.isfinite(force)]
    if not len(values):
        return False
    low, high = float(values.min()), float(values.max())
    return low < -_PULLING * max(0.0, high) < 0 or high <= 0 > low


def guess_sign(name: str, force: NDArray[np.float64], doubts: list[str]) -> dict[str, Any]:
    """Guess the key of the sign of forces; {} where pressing is positive.

    Args:
        name: Name of the normal force.
        force: float64 (n,), the normal force, in any unit; NaN for no value.
        doubts: Lines, added to.
    """
    if not is_turned(force):
        return {}
    doubts.append(f"force: {name} is negative where it is large, so z is turned")
    return {"sign": [1, 1, -1]}
