"""The curriculum: a pure function from the step to the weight of each objective, without torch.

Paper, section Training Recipe: ``weight(i) = max(0, i - start) / (total - start) * max`` for align,
match and force; pixel and diff are constant; the chance of the universal sensor token rises
linearly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from tactileforge.errors import ConfigError, check_names, unknown

KEYS = ("unit", "objective", "universal", "values")

Unit = Literal["fraction", "epoch", "step"]


@dataclass(frozen=True)
class Ramp:
    """A linear rise, in steps.

    Attributes:
        start: Last step at which the value is still ``low``.
        end: First step at which it is ``high``; with ``end <= start`` it jumps after ``start``.
        low: Value until ``start``.
        high: Value from ``end`` on.
    """

    start: float = 0.0
    end: float = 0.0
    low: float = 0.0
    high: float = 1.0

    def __call__(self, step: int) -> float:
        """The value at a step."""
        if step < self.start or (step == self.start and self.end > self.start):
            return self.low
        # also for end <= start: the ramp is then a jump
        if step >= self.end:
            return self.high
        share = (step - self.start) / (self.end - self.start)
        return self.low + share * (self.high - self.low)


@dataclass(frozen=True)
class Curriculum:
    """Weights of objectives, and the chance of the universal sensor token.

    Attributes:
        ramps: Weight of each objective, a function of the step.
        universal: Chance that a sample takes the universal sensor tokens, 0 to 1.
        values: Ramps of further numbers, by their place in the configuration, such as
            ``encoder.mask_ratio``.

    Example:
        >>> plan = Curriculum({"pixel": Ramp(), "force": Ramp(start=50, end=100, high=0.1)})
        >>> plan.weights(75)
        {'pixel': 1.0, 'force': 0.05}
    """

    ramps: Mapping[str, Callable[[int], float]]
    universal: Ramp = field(default_factory=lambda: Ramp(high=0.0))
    values: Mapping[str, Ramp] = field(default_factory=dict)

    def weights(self, step: int) -> dict[str, float]:
        """Weight of each objective at an optimiser step; 0 means it is not computed."""
        return {name: ramp(step) for name, ramp in self.ramps.items()}


@dataclass(frozen=True)
class OwnRamp:
    """The curve of an objective itself, see `contracts.Ramped`, times its largest weight.

    Attributes:
        name: Name of the objective.
        factor: Function from the share of the run, 0 to 1, to a factor of the weight.
        high: The weight.
        total: Steps of the run.
    """

    name: str
    factor: Callable[[float], float]
    high: float
    total: int

    def __call__(self, step: int) -> float:
        """The value at a step.

        Raises:
            ConfigError: The factor is not a number, not finite or below 0.
        """
        share = min(1.0, step / max(1, self.total))
        factor = self.factor(share)
        if not isinstance(factor, int | float) or not 0 <= factor < math.inf:
            raise ConfigError(
                f"objective {self.name}: ramp({share:.3g}) is {factor!r}; give a finite number, 0 "
                "or more"
            )
        return self.high * factor


def without_waiting(config: Mapping[str, Any], weights: Mapping[str, float]) -> dict[str, Any]:
    """The curriculum without the rows of its earliest objectives, where none starts at once.

    They have their weight from the first step: before, nothing would be learnt.

    Args:
        config: Configuration of the curriculum; see `from_config`.
        weights: Largest weight of each objective.

    Example:
        >>> rows = {"force": {"start": 0.5}, "align": {"start": 0.75}}
        >>> without_waiting({"objective": rows}, {"force": 0.1, "align": 1.0})
        {'objective': {'align': {'start': 0.75}}}
        >>> without_waiting({"objective": rows}, {"pixel": 1.0, "force": 0.1})["objective"].keys()
        dict_keys(['force', 'align'])
    """
    rows = _rows(config)
    used = [name for name, weight in weights.items() if weight > 0]
    starts = [
        _number(f"curriculum.objective.{name}", rows[name], "start", 0.0) if name in rows else 0.0
        for name in used
    ]
    first = min(starts, default=0.0)
    early = [name for name, start in zip(used, starts, strict=True) if start == first > 0]
    kept = {name: row for name, row in rows.items() if name not in early}
    return {**config, "objective": kept} if early else {**config}


def from_config(
    config: Mapping[str, Any],
    weights: Mapping[str, float],
    total: int,
    epoch: int,
    own: Mapping[str, Callable[[float], float]] | None = None,
) -> Curriculum:
    """Reads a curriculum from its configuration.

    Args:
        config: ``unit`` (``fraction`` of the run, ``epoch`` or ``step``), ``objective`` (for each
            objective ``start`` and ``end``; None as end is the end of the run; an objective without
            a row has its weight from the first step), ``universal`` (``start``, ``end``, ``low``,
            ``high``), ``values`` (such rows for numbers of the encoder, a head or an objective, at
            their place: ``values.encoder.mask_ratio``).
        weights: Largest weight of each objective.
        total: Steps of the run.
        epoch: Steps of an epoch.
        own: Curves of objectives, for those without a row; see `OwnRamp`.

    Raises:
        ConfigError: An unknown unit or key, a ramp that ends before it starts, a weight below 0, or
            a chance outside 0 to 1.
    """
    check_names("key in curriculum", config, KEYS)
    units = {"fraction": total, "epoch": epoch, "step": 1}
    unit = config.get("unit", "fraction")
    if unit not in units:
        raise ConfigError(unknown("curriculum.unit", unit, units))

    def ramp(where: str, row: Any, low: float, high: float) -> Ramp:
        start = _number(where, row, "start", 0.0) * units[unit]
        stop = total if row.get("end") is None else _number(where, row, "end") * units[unit]
        _check_keys(where, row)
        if not math.isfinite(start + stop):  # first, because NaN passes the comparison below
            raise ConfigError(
                f"{where}: start={row.get('start')}, end={row.get('end')}; give finite numbers"
            )
        if stop < start:
            raise ConfigError(f"{where}: ends at step {stop:g}, before it starts ({start:g})")
        return Ramp(start, stop, low, high)

    for name, weight in weights.items():
        if not isinstance(weight, int | float) or not 0 <= weight < math.inf:
            raise ConfigError(f"objective.{name}.weight={weight}: give a finite number, 0 or more")
    rows, own = _rows(config), own or {}
    ramps: dict[str, Callable[[int], float]] = {}
    for name, weight in weights.items():
        if name in rows:
            ramps[name] = ramp(f"curriculum.objective.{name}", rows[name], 0.0, weight)
        elif name in own:
            ramps[name] = OwnRamp(name, own[name], weight, total)
        else:
            ramps[name] = Ramp(low=weight, high=weight)
    where, row = "curriculum.universal", config.get("universal") or {"high": 0.0}
    universal = ramp(where, row, *(_number(where, row, key, 0.0) for key in ("low", "high")))
    if not (0 <= universal.low <= 1 and 0 <= universal.high <= 1):
        said = f"low={universal.low}, high={universal.high}"
        raise ConfigError(f"{where}: {said}; give chances, 0 to 1")
    values = {}
    for place, row in value_rows(config).items():
        where = f"curriculum.values.{place}"
        low, high = (_number(where, row, key) for key in ("low", "high"))
        if not math.isfinite(low + high):
            raise ConfigError(f"{where}: low={low}, high={high}; give finite numbers")
        values[place] = ramp(where, row, low, high)
    return Curriculum(ramps, universal, values)


def _number(where: str, row: Any, key: str, default: float | None = None) -> float:
    """Reads a number of a row; None counts as absent, if there is a default."""
    if not isinstance(row, Mapping):
        raise ConfigError(f"{where}={row}: give {{start: A, end: B}}")
    value = default if row.get(key) is None else row[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{where}.{key}={value}: give a number")
    return float(value)


def value_rows(config: Mapping[str, Any]) -> dict[str, Any]:
    """Rows of the changing numbers, by their place in the configuration.

    Raises:
        ConfigError: A row is not a mapping.
    """
    rows: dict[str, Any] = {}
    waiting = [("", config.get("values") or {})]
    while waiting:
        place, node = waiting.pop()
        for key, value in node.items():
            at = f"{place}.{key}".removeprefix(".")
            if not isinstance(value, Mapping):
                raise ConfigError(f"curriculum.values.{at}={value}: give {{low: A, high: B}}")
            if _is_value(value):
                rows[at] = value
            else:
                waiting.append((at, value))
    return rows


def _is_value(node: Mapping[str, Any]) -> bool:
    return bool({"low", "high"} & node.keys())


def _rows(config: Mapping[str, Any]) -> dict[str, Any]:
    """Rows of the objectives; a null row counts as absent."""
    return {key: row for key, row in (config.get("objective") or {}).items() if row is not None}


def _check_keys(where: str, row: Mapping[str, Any]) -> None:
    place, _, name = where.rpartition(".")
    known = ("start", "end") if place.endswith("objective") else ("start", "end", "low", "high")
    for key in row:
        if key in ("low", "high") and key not in known:
            raise ConfigError(
                f"{where}.{key}: an objective's weight rises from 0 to objective.{name}.weight; "
                f"set that, and leave {key} out"
            )
        if key not in known:
            raise ConfigError(unknown(f"key in {where}", key, known))


def in_steps(config: Mapping[str, Any], total: int, epoch: int) -> dict[str, Any]:
    """Converts a curriculum to steps, independent of the length of the run.

    Args:
        config: Configuration of the curriculum; see `from_config`.
        total: Steps of the run.
        epoch: Steps of an epoch.

    Example:
        >>> in_steps({"unit": "fraction", "objective": {"force": {"start": 0.5}}}, 200, 50)
        {'unit': 'step', 'objective': {'force': {'start': 100.0, 'end': 200.0}}}
    """
    unit = {"fraction": total, "epoch": epoch, "step": 1}[config.get("unit", "fraction")]

    def row(row: Mapping[str, Any]) -> dict[str, Any]:
        end = row.get("end")
        last = total if end is None else end * unit
        return {**row, "start": float(row.get("start") or 0) * unit, "end": float(last)}

    def values(node: Mapping[str, Any]) -> dict[str, Any]:
        return {k: row(v) if _is_value(v) else values(v) for k, v in node.items()}

    rows = {name: row(node) for name, node in _rows(config).items()}
    more = {"universal": row(config["universal"])} if config.get("universal") else {}
    if config.get("values"):
        more["values"] = values(config["values"])
    return {**config, "unit": "step", "objective": rows, **more}
