"""Tasks of a suite, read strictly from its configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from tactileforge.errors import ConfigError, check_names
from tactileforge.plugins import strict


@dataclass(frozen=True, kw_only=True)
class ClipSpec:
    """Placement of clips in time, the same for every model.

    Attributes:
        span: Seconds from the first to the last frame. Models cut their own frames back from the
            same last frame; the change of force is counted over this span.
        hop: Seconds between the ends of neighbouring clips; 0 for one at each frame.
        ends: Fixed ends in place of a hop: whole numbers count frames, negative ones from the end
            (-1 is the last), numbers between 0 and 1 are shares of the recording.
        parts: Parts in time that each recording is cut into, to split by; 0 leaves it whole.
        spread: Whether all models have their frames spread over the span; else each has its own
            spacing, and only those of single frames, which are shown two, the span.
    """

    span: float = 0.2
    hop: float = 0.2
    ends: list[Any] = field(default_factory=list)
    parts: int = 0
    spread: bool = False


@dataclass(frozen=True, kw_only=True)
class SplitPlan:
    """Filters assigning recordings to training, validation and test.

    A filter names facts and the values they may have: ``{side: train, sensor: [digit]}``. Facts are
    ``side`` (of the data set), ``sensor``, ``object``, ``recording``, ``tier``, any label, and
    ``re:PATTERN``, what a pattern finds in the key.

    Attributes:
        train: Filter; what the test takes is left out of it.
        test: Filter; empty with folds, and where the probe ``zero_shot`` is to test all clips.
        validation: Filter of what is taken from training; or ``share``, and ``group``, the fact by
            which recordings are held out together.
        folds: Number of folds; each recording is tested once.
        group: Fact by which folds keep recordings together.
        unseen: Facts of which training and test may share no value.
        only: Filter of the recordings that are used at all.
        unit: Fact by which recordings belong together where intervals draw from them again;
            "" takes ``group``.
    """

    train: dict[str, Any] = field(default_factory=dict)
    test: dict[str, Any] = field(default_factory=dict)
    validation: dict[str, Any] = field(default_factory=lambda: {"share": 0.15})
    folds: int = 0
    group: str = "recording"
    unseen: list[str] = field(default_factory=list)
    only: dict[str, Any] = field(default_factory=dict)
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One task of a suite.

    Attributes:
        name: The word users type.
        title: Name in print; for published numbers, the name on the cards of the zoo.
        data: Data set plugin and its options, or ``{preset: NAME, layouts: [...], ...}`` for a
            preset of the group ``data``.
        target: Predicted quantity; see `targets.TARGETS`.
        probe: ``name``, and options of the probe and of its training.
        metrics: Names; the first is the main one.
        split: Plan of training, validation and test.
        about: The data, in words.
        clip: Rule for cutting clips.
        scale: Newton per axis that count as 1; empty takes those of the sensor.
        clamp: Largest normalised target; 0 for none.
        flips: Whether clips are mirrored at random in training.
        unknown_sensor: ``error``, or ``universal`` to take the universal tokens.
        counted: Whether the release gate counts it, and its mean of all tasks has it.
    """

    name: str
    title: str
    data: dict[str, Any]
    target: str
    probe: dict[str, Any]
    metrics: list[str]
    split: SplitPlan
    about: str = ""
    clip: ClipSpec = ClipSpec()
    scale: list[float] = field(default_factory=list)
    clamp: float = 0.0
    flips: bool = False
    unknown_sensor: str = "error"
    counted: bool = True

    @property
    def sides(self) -> tuple[str, ...]:
        """Sides of the data set to read: all candidates for training, and all sides in filters.

        Without a side in ``only`` or ``train``, training takes train and val less the test.
        """
        plan = self.split
        named: list[str] = []
        for chosen in (plan.only, plan.train, plan.test, plan.validation):
            side = chosen.get("side", [])
            named += map(str, side if isinstance(side, list) else [side])
        free = "side" not in plan.only and "side" not in plan.train
        return tuple(dict.fromkeys([*(("train", "val") if free else ()), *named]))


def parse_task(name: str, config: Mapping[str, Any]) -> Task:
    """A task from plain data.

    Raises:
        ConfigError: A key is unknown, missing, or of another type; names it.
    """
    where = f"tasks.{name}"
    # a name is the whole of a configuration that has no other key
    values = {
        key: {"name": value} if key in ("data", "probe") and isinstance(value, str) else value
        for key, value in config.items()
    }
    clip = strict.build(ClipSpec, f"{where}.clip", values.pop("clip", {}))
    split = strict.build(SplitPlan, f"{where}.split", values.pop("split", None) or {})
    known = [key for key in Task.__dataclass_fields__ if key != "name"]
    check_names(f"key of {where}", values, known)
    plain = {"name": name, "clip": clip, "split": split, **values}
    task = strict.build(Task, where, plain)
    if not task.metrics:
        raise ConfigError(f"{where}: metrics is empty; name at least one")
    if "name" not in task.probe:
        raise ConfigError(f"{where}: probe has no name, e.g. probe: {{name: force}}")
    if task.unknown_sensor not in ("error", "universal"):
        raise ConfigError(f"{where}: unknown_sensor is {task.unknown_sensor!r}: error or universal")
    # zero_shot fits nothing, so without a test all clips are tested
    needs_none = task.probe["name"] == "zero_shot" and not split.test and not split.folds
    if bool(split.test) == bool(split.folds) and not needs_none:
        raise ConfigError(
            f"{where}.split: give one of test, as in test: {{side: val}}, and folds: 5"
        )
    if split.folds and split.folds < 2:
        raise ConfigError(f"{where}.split.folds is {split.folds}; give 2 or more")
    share = split.validation.get("share")
    if share is not None and not (isinstance(share, int | float) and 0 < share < 1):
        raise ConfigError(
            f"{where}.split.validation.share is {share}; give a share between 0 and 1"
        )
    return task
