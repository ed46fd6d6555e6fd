"""Comparison of simulated touches with a data set, per type of sensor and per source."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from tactileforge_inspect.frame_stats import evenly

from reality.profiles import Profile, distances, profile, ratio
from reality.simulated import config, simulated, trial
from tactileforge.contracts import Dataset, Recording
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.plugins import Bar
from tactileforge.specs import published

#: Largest number of sources by the first folder of their keys; more are grouped by `source`.
_SOURCES = 8
#: Name of the simulated touches.
SIMULATED = "simulated"


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """Options of a comparison.

    Attributes:
        sensors: Types of sensors; None for all types in both the data and the simulator.
        recordings: Largest number of recordings read per source.
        scenes: Number of simulated touches of each sensor.
        trials: Number of simulated force trials; only used for data with forces.
        indenters: Indenters of the simulated touches, see `tactileforge_sim.config.SimConfig`.
        motions: Motions of the simulated touches, see `tactileforge_sim.config.SimConfig`.
        newton: Range of the largest normal force of the touches, lowest and highest, N.
        markers: Whether the simulated gels have markers; None for their types' default.
        seed: Seed of the simulated touches.
    """

    sensors: tuple[str, ...] | None = None
    recordings: int = 60
    scenes: int = 30
    trials: int = 3
    indenters: str | tuple[str, ...] = "all"
    motions: str | tuple[str, ...] = "atomic"
    newton: tuple[float, float] = (0.5, 8.0)
    markers: bool | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.recordings < 1 or self.scenes < 1 or self.trials < 0:
            raise ConfigError(
                f"recordings={self.recordings}, scenes={self.scenes}, trials={self.trials}: give 1 "
                "or more, 1 or more, 0 or more"
            )
        for sensor in self.sensors or ():
            if sensor not in published.SIMULATED:
                raise ConfigError(unknown("simulated sensor", sensor, published.SIMULATED))


@dataclass(frozen=True)
class Side:
    """One type of sensor, simulated and real.

    Attributes:
        simulated: Profile of the simulated touches.
        real: Profiles of the real sources.
    """

    simulated: Profile
    real: Sequence[Profile] = field(default_factory=list)

    @cached_property
    def apart(self) -> dict[str, dict[str, float]]:
        """Distances of the simulated touches to each source, see `profiles.distances`."""
        return {real.name: distances(self.simulated, real) for real in self.real}

    @cached_property
    def among(self) -> dict[tuple[str, str], dict[str, float]]:
        """Distances between real sources, a simulator's best possible result."""
        return {
            (a.name, b.name): distances(a, b)
            for i, a in enumerate(self.real)
            for b in self.real[i + 1 :]
        }

    def ratio(self, name: str) -> float:
        """Ratio of the distances of one measure, see `profiles.ratio`."""
        apart, among = (
            [distance[name] for distance in sources.values()]
            for sources in (self.apart, self.among)
        )
        return ratio(apart, among)


def compare_reality(
    dataset: Dataset, options: CompareOptions, progress: bool = True
) -> dict[str, Side]:
    """Measures a data set, and simulated touches on its types of sensors.

    Args:
        dataset: Real touches; the splits ``train`` and ``val`` are read.
        options: Sensors and numbers of touches.
        progress: Whether to show progress bars.

    Returns:
        Both sides of the comparison, by type of sensor.

    Raises:
        ConfigError: The data has no simulated sensor, or lacks a requested one.
        DataError: No touch of a sensor can be measured.
    """
    by_sensor = _by_sensor(dataset)
    wanted = options.sensors or tuple(name for name in published.SIMULATED if name in by_sensor)
    for sensor in wanted:
        if sensor not in by_sensor:
            raise ConfigError(
                f"sensors={sensor}: the data has no recording of this sensor, only of "
                f"{', '.join(sorted(by_sensor)) or 'none'}; leave it out, or give other data"
            )
    if not wanted:
        raise ConfigError(
            "the simulator knows none of the data's sensors "
            f"({', '.join(sorted(by_sensor)) or 'none'}), only "
            f"{', '.join(published.SIMULATED)}; give recordings of one of these"
        )
    return {sensor: _side(sensor, by_sensor[sensor], options, progress) for sensor in wanted}


def _by_sensor(dataset: Dataset) -> dict[str, list[Recording]]:
    out: dict[str, list[Recording]] = {}
    for split in ("train", "val"):
        for recording in dataset.recordings(split):
            out.setdefault(recording.sensor, []).append(recording)
    return out


def _side(
    sensor: str, recordings: Sequence[Recording], options: CompareOptions, progress: bool
) -> Side:
    real = []
    for name, of_source in by_source(recordings).items():
        rows = evenly(len(of_source), options.recordings).tolist()
        chosen = (of_source[row] for row in rows)
        bar = Bar(chosen, desc=f"{sensor}, {name}", total=len(rows), disable=not progress)
        real.append(profile(name, sensor, bar))
    real = [measured for measured in real if measured.looks]
    if not real:
        raise DataError(
            f"{sensor}: not one of {len(recordings)} recordings shows a touch that differs from "
            "its background; give recordings with backgrounds (docs/data.md)"
        )
    return Side(
        _simulated(sensor, options, any(measured.responses for measured in real), progress), real
    )


def _simulated(sensor: str, options: CompareOptions, forces: bool, progress: bool) -> Profile:
    shown = config(
        sensor,
        indenters=options.indenters,
        motions=options.motions,
        force=options.newton,
        markers=options.markers,
        seed=options.seed,
    )
    out = profile(SIMULATED, sensor, simulated(shown, range(options.scenes), progress))
    if not out.looks:
        raise DataError(f"{sensor}: no simulated touch is visible; raise newton={options.newton}")
    if forces:
        pressed = trial(sensor, markers=options.markers, seed=options.seed)
        scenes = simulated(pressed, range(options.trials), progress)
        out.responses = profile(SIMULATED, sensor, scenes).responses
    return out


def by_source(recordings: Iterable[Recording]) -> dict[str, list[Recording]]:
    """Recordings by the first part of their key, or by `source` for more than `_SOURCES` keys."""
    sources: dict[str, list[Recording]] = {}
    listed = list(recordings)
    for recording in listed:
        sources.setdefault(recording.key.split("/")[0], []).append(recording)
    if len(sources) > _SOURCES:
        sources = {}
        for recording in listed:
            sources.setdefault(recording.source or "source not given", []).append(recording)
    return sources
