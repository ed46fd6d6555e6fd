"""The plan of a comparison: policies, tasks, trainings and rollouts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tactileforge_bench.fit.pretrain import PretrainJob

from tactileforge.errors import ConfigError, check_names, unknown
from tactileforge_policies.rollouts.actors import SCRIPTED
from tactileforge_policies.rollouts.options import DemonstrationOptions, RolloutOptions, TaskOptions


@dataclass(frozen=True, kw_only=True)
class ComparedPolicy:
    """A row of the table.

    Attributes:
        title: Name of the row in print.
        actor: ``expert`` or ``still`` for a row without training; "" for a trained policy.
        words: Overrides of ``tactileforge train`` for this row.
    """

    title: str
    actor: str = ""
    words: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.actor and self.actor not in SCRIPTED:
            raise ConfigError(unknown("actor", self.actor, SCRIPTED))


@dataclass(frozen=True, kw_only=True)
class ManipulationOptions:
    """The table of manipulation.

    Attributes:
        tasks: Names of tasks of `tactileforge_policies.envs`.
        sensors: Types of sensors; each has demonstrations and policies of its own.
        size: Height and width of their pictures, pixels.
        demonstrations: Number of the expert's episodes for the training of a policy.
        units: Units of the sensors of the demonstrations, in turns; None for one.
        rollouts: Number of episodes of each policy, with the same starts and physics for all.
        policies: Rows, by name.
        against: Names of the rows to compare all others with.
        train: Overrides of every training.
        cross_sensor: Whether policies are rolled out on the other sensors too.
        other_unit: Further unit of the sensors for rollouts, with different gels; None for none.
        processes: Number of simulating processes; None for one per core.
    """

    tasks: list[str]
    sensors: list[str]
    policies: dict[str, ComparedPolicy]
    size: int = 64
    demonstrations: int = 50
    units: list[int] | None = None
    rollouts: int = 100
    against: list[str] = field(default_factory=list)
    train: list[str] = field(default_factory=list)
    cross_sensor: bool = False
    other_unit: int | None = None
    processes: int | None = None


@dataclass(frozen=True)
class Setting:
    """A column of the table: a task and its sensors.

    Attributes:
        task: Name of the task.
        sensor: Sensor of the demonstrations.
        on: Sensor of the rollouts.
        unit: Unit of the sensors of the rollouts; None for that of the demonstrations.
    """

    task: str
    sensor: str
    on: str
    unit: int | None = None

    @property
    def word(self) -> str:
        """Name of the task in folders."""
        return TaskOptions(task=self.task).word

    @property
    def title(self) -> str:
        """Name of the column in print."""
        where = self.sensor if self.on == self.sensor else f"{self.sensor} to {self.on}"
        return f"{self.word}, {where}{'' if self.unit is None else ', other gels'}"


@dataclass(frozen=True)
class Cell:
    """Rollouts of one policy of one training seed in one setting.

    Attributes:
        policy: Name of the row.
        seed: Seed of the training.
        setting: The column.
        train: The training; None for an actor without training.
        rollouts: Options of the rollouts.
    """

    policy: str
    seed: int
    setting: Setting
    train: PretrainJob | None
    rollouts: RolloutOptions


@dataclass(frozen=True)
class Plan:
    """Plan of a table: its options, rows, columns and cells.

    Attributes:
        options: Options of the table.
        folder: Folder of the results.
        seeds: Seeds of the trainings of each policy.
        policies: Chosen rows, by name.
    """

    options: ManipulationOptions
    folder: Path
    seeds: Sequence[int]
    policies: dict[str, ComparedPolicy]

    @property
    def settings(self) -> list[Setting]:
        """Columns of the table."""
        out = []
        for task in self.options.tasks:
            for sensor in self.options.sensors:
                out.append(Setting(task, sensor, sensor))
                if self.options.other_unit is not None:
                    out.append(Setting(task, sensor, sensor, self.options.other_unit))
                others = self.options.sensors if self.options.cross_sensor else []
                out += [Setting(task, sensor, on) for on in others if on != sensor]
        return out

    def demonstrations(self) -> list[DemonstrationOptions]:
        """Sets of demonstrations for the trainings; empty without trainings."""
        if all(row.actor for row in self.policies.values()):
            return []
        return [
            DemonstrationOptions(
                task=task,
                sensor=sensor,
                size=self.options.size,
                n=self.options.demonstrations,
                units=self.options.units,
                processes=self.options.processes,
                out=str(self._demonstrations(task, sensor)),
            )
            for task in self.options.tasks
            for sensor in self.options.sensors
        ]

    def cells(self) -> list[Cell]:
        """Rollouts of every policy in every setting, column by column."""
        return [
            self._cell(name, row, seed, setting)
            for setting in self.settings
            for name, row in self.policies.items()
            for seed in ([0] if row.actor else self.seeds)
        ]

    def _cell(self, name: str, row: ComparedPolicy, seed: int, setting: Setting) -> Cell:
        trained = f"{setting.word}-{setting.sensor}-{_file_name(name)}-{seed}"
        folder = self.folder / "train" / trained
        data = self._demonstrations(setting.task, setting.sensor)
        words = [*self.options.train, "data=demonstrations", f"data.root={data}"]
        job = PretrainJob(trained, folder, [*words, *row.words, f"seed={seed}"])
        on = f"-on-{setting.on}" if setting.on != setting.sensor else ""
        on += "" if setting.unit is None else f"-unit-{setting.unit}"
        rollouts = RolloutOptions(
            task=setting.task,
            sensor=setting.on,
            size=self.options.size,
            env={} if setting.unit is None else {"unit": setting.unit},
            policy=row.actor or str(folder),
            cross_sensor=True,
            n=self.options.rollouts,
            processes=self.options.processes,
            out=str(self.folder / "rollouts" / f"{trained}{on}"),
        )
        return Cell(name, seed, setting, None if row.actor else job, rollouts)

    def _demonstrations(self, task: str, sensor: str) -> Path:
        return self.folder / "demonstrations" / f"{TaskOptions(task=task).word}-{sensor}"

    def told(self) -> str:
        """Describes the amount of work, in words."""
        cells = self.cells()
        jobs = {cell.train.name: cell.train for cell in cells if cell.train}
        done = sum(job.finished for job in jobs.values())
        text = (
            f"{len(self.policies)} policies in {len(self.settings)} settings: "
            f"{len(self.demonstrations())} sets of {self.options.demonstrations} demonstrations, "
            f"{len(jobs)} trainings, {len(cells)} x {self.options.rollouts} rollouts"
        )
        return f"{text}; {done} trainings are there" if done else text


def _file_name(name: str) -> str:
    return re.sub(r"[^\w.-]+", "_", name)


def make_plan(
    options: ManipulationOptions,
    folder: Path,
    seeds: int,
    models: Sequence[str],
    tasks: Sequence[str] | None,
) -> Plan:
    """Makes the plan of a command.

    Args:
        options: Options of the suite.
        folder: Folder of the results.
        seeds: Number of trainings of each policy.
        models: Requested rows by name, or models to load (NAME.TAG, file:PATH); empty for all
            rows.
        tasks: Requested tasks; None for all.

    Raises:
        ConfigError: An unknown row or task.
    """
    check_names("task", tasks or [], options.tasks)
    for name in models:
        if name not in options.policies and "." not in name and not name.startswith("file:"):
            raise ConfigError(unknown("model", name, options.policies, "Or NAME.TAG of the zoo"))
    rows = {
        name: options.policies.get(name, ComparedPolicy(title=name, words=[f"init={name}"]))
        for name in (models or options.policies)
    }
    plain = {**vars(options), "tasks": list(tasks or options.tasks)}
    return Plan(ManipulationOptions(**plain), folder, range(seeds), rows)
