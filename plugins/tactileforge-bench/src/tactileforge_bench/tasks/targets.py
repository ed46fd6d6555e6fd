"""Prediction targets of clips, from labels of recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data import flip_labels
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.specs import spec
from tactileforge_bench.tasks import contact
from tactileforge_bench.tasks.facts import label_text, matches_filter
from tactileforge_bench.tasks.source import TaskSource
from tactileforge_bench.tasks.suite import Task

#: Edges of the classes of motion in Sparsh's pose task: mm and degrees.
_SHIFTS = (-5.0, -2.0, -1.0, -0.5, -0.1, 0.1, 0.5, 1.0, 2.0, 5.0)
_TURNS = (-2.0, -1.0, -0.5, -0.2, -0.03, 0.03, 0.2, 0.5, 1.0, 2.0)
#: Share of the friction cone from which a simulated touch slips, and the least normal force, N.
_CONE, _TOUCH_N = 0.95, 0.1
_NUMBERS, _SHARES = "numbers:", "shares:"


@dataclass(frozen=True)
class TargetPart:
    """One predicted quantity.

    Attributes:
        kind: ``classes``, ``force`` (N), ``place`` (shares of the width of the image), or
            ``numbers``.
        truth: float32 (n, columns); class indices where it is classes.
        scale: float32 (n, columns), what counts as 1; ones for classes.
        names: Classes, or axes.
        mirror: Truth of a mirrored clip: ``same``; ``force`` or ``action``, as those labels;
            ``motion`` for classes of shifts along x and y and of a turn, with edges symmetric about
            0; "" where it is not known, as for a place or numbers of any kind.
    """

    kind: str
    truth: Tensor
    scale: Tensor
    names: tuple[str, ...]
    mirror: Literal["", "same", "force", "action", "motion"] = ""

    @property
    def outputs(self) -> int:
        """Number of outputs of a probe."""
        columns = self.truth.shape[1]
        return columns * len(self.names) if self.kind == "classes" else columns

    @property
    def normalised(self) -> Tensor:
        """The truth in normalised units."""
        return self.truth / self.scale

    def flipped(self, horizontal: bool, vertical: bool) -> TargetPart:
        """The truth for mirrored clips.

        Raises:
            ConfigError: It is not known, see `mirror`.
        """
        if not (horizontal or vertical) or self.mirror == "same":
            return self
        if not self.mirror:
            raise ConfigError(
                "flips: what a place or a number is in a mirrored clip is not known; set flips: "
                "false"
            )
        if self.mirror == "motion":
            # a turn changes its sign by either flip, and keeps it by both
            swapped = torch.tensor([horizontal, vertical, horizontal != vertical])
            last = len(self.names) - 1
            return replace(self, truth=torch.where(swapped, last - self.truth, self.truth))
        count = len(self.truth)
        # as a batch: mirrored by the code that mirrors training
        batch = {"action": torch.full((count,), -1), "force": torch.zeros(count, 1, 3)}
        if self.mirror == "force":
            batch["force"] = self.truth[:, None].clone()
        else:
            batch["action"] = self.truth[:, 0].long()
        flip_labels(batch, torch.full((count,), horizontal), torch.full((count,), vertical))
        force, action = batch["force"][:, 0], batch["action"][:, None].float()
        return replace(self, truth=force if self.mirror == "force" else action)


@dataclass(frozen=True)
class Target:
    """Prediction targets of the clips of a source.

    Attributes:
        parts: By name; all have the same length.
        clips: int64 (n,), the clips of the source that have a label.
    """

    parts: dict[str, TargetPart]
    clips: NDArray[np.int64]

    @property
    def names(self) -> NDArray[np.int64] | None:
        """Class of each clip, int64 (n,), if the first part is one column of classes; else None."""
        part = next(iter(self.parts.values()))
        if part.kind != "classes" or part.truth.shape[1] != 1:
            return None
        classes: NDArray[np.int64] = part.truth[:, 0].long().numpy()
        return classes


def build_target(task: Task, source: TaskSource) -> Target:
    """The target of a task on a source.

    Raises:
        ConfigError: An unknown target.
        DataError: No clip has the label.
    """
    if task.target.startswith("label:"):
        # an empty label is not a class: the clip is left out, as one without the label
        parts = {"class": _classes(source, lambda r, _, last: _label(r, task.target[6:], last))}
    elif task.target.startswith(_NUMBERS):
        parts = {"numbers": _numbers(source, task.target.removeprefix(_NUMBERS).split("+"))}
    elif task.target.startswith(_SHARES):
        parts = {"numbers": _numbers(source, task.target[len(_SHARES) :].split("+"), shares=True)}
    elif task.target in TARGETS:
        parts = TARGETS[task.target](task, source)
    else:
        raise ConfigError(
            unknown(
                f"target of task {task.name}",
                task.target,
                [*TARGETS, "label:NAME", "numbers:NAME+NAME", "shares:NAME+NAME"],
            )
        )
    # a clip without one of the columns is left out whole
    good = torch.stack([part.truth.isfinite().all(1) for part in parts.values()]).all(0)
    clips = good.nonzero()[:, 0]
    if not len(clips):
        fix = _partial(parts)
        if task.target.startswith("label:"):
            known = {name for one in source.recordings for name in (*one.labels, *one.tracks)}
            fix += f": {unknown('label', task.target[6:], known)}"
        raise DataError(f"task {task.name}: no clip of the data has the label {task.target!r}{fix}")
    for name, part in parts.items():
        truth, scale = part.truth[clips], part.scale[clips]
        if task.clamp and part.kind == "force":
            # the limit is a share of the scale, not N
            truth = (truth / scale).clamp(-task.clamp, task.clamp) * scale
        parts[name] = replace(part, truth=truth, scale=scale)
    return Target(parts, clips.numpy())


def _partial(parts: dict[str, TargetPart]) -> str:
    """Part of an error: the known axes of a force, if no clip has all of them."""
    for part in parts.values():
        known = part.truth.isfinite().any(0).tolist()
        if part.kind == "force" and any(known):
            axes = [name for name, there in zip(part.names, known, strict=True) if there]
            return (
                f" along all of {', '.join(part.names)} (it has {', '.join(axes)}); a benchmark of "
                "forces needs all axes in one clip"
                f"{'; target: normal_force needs only z' if 'z' in axes else ''}"
            )
    return ""


def _each(source: TaskSource, value: Callable[[Recording, int, int], object]) -> list[object]:
    """A value for each clip, of its recording, first and last frame."""
    return [
        value(source.recordings[number], first, last)
        for (number, last), first in zip(source.index.tolist(), source.first.tolist(), strict=True)
    ]


def _classes(
    source: TaskSource,
    value: Callable[[Recording, int, int], str | None],
    names: tuple[str, ...] = (),
    mirror: Literal["same", "action"] = "same",
) -> TargetPart:
    values = _each(source, value)
    known = names or tuple(sorted({str(label) for label in values if label is not None}))
    place = {name: i for i, name in enumerate(known)}
    truth = torch.tensor(
        [[place[str(label)] if label is not None else torch.nan] for label in values]
    )
    return TargetPart("classes", truth.float(), torch.ones(len(values), 1), known, mirror)


def _label(recording: Recording, name: str, last: int) -> str | None:
    value = _labelled(recording, name, last)
    return None if value is None else label_text(value) or None


def _labelled(recording: Recording, name: str, last: int) -> str | float | None:
    """A label of the recording, or else its track at a frame; None without, and for NaN."""
    track = recording.tracks.get(name)
    if name in recording.labels or track is None:
        return recording.labels.get(name)
    return float(track[last]) if np.isfinite(track[last]) else None


def _newton(task: Task, source: TaskSource, change: bool) -> TargetPart:
    def value(recording: Recording, first: int, last: int) -> NDArray[np.float32]:
        force = recording.force
        if force is None:
            return np.full(3, np.nan, np.float32)
        newton: NDArray[np.float32] = force[last] - force[first] if change else force[last]
        return newton

    truth = np.array(_each(source, value), np.float32).reshape(-1, 3)
    # each sensor has a scale of its own: forces of a stiff gel would outweigh the others
    scale = [
        task.scale or spec(source.recordings[n].sensor).force_scale for n in source.index[:, 0]
    ]
    rows = torch.tensor(scale, dtype=torch.float32)
    return TargetPart("force", torch.from_numpy(truth), rows, ("x", "y", "z"), "force")


def _normal_force(task: Task, source: TaskSource) -> dict[str, TargetPart]:
    """Force along z in newton, for data without the other axes."""
    force = _newton(task, source, change=False)
    z = TargetPart("numbers", force.truth[:, 2:], force.scale[:, 2:], ("z",), "same")
    return {"normal_force": z}


def _slips(recording: Recording, first: int, last: int) -> str | None:
    """Slip labels; in simulation whether shear has reached the friction cone."""
    slip = recording.tracks.get("slip")
    if slip is not None:
        if not slip[last] >= 0:  # a frame without a label
            return None
        return ("stick", "slip")[int(slip[last] > 0)]
    grip, force = recording.labels.get("grip"), recording.force
    if grip is None or force is None:
        return None
    from tactileforge_sim.mechanics.sensor_gels import sensor_gel

    # Coulomb: the contact slips where |(x, y)| reaches friction * z
    x, y, z = (float(value) for value in force[last])
    bound = sensor_gel(recording.sensor).touched(float(grip)).friction * z
    return ("stick", "slip")[int(z > _TOUCH_N and np.hypot(x, y) >= _CONE * bound)]


def _action(recording: Recording, first: int, last: int) -> str | None:
    shown = recording.action
    # a clip over the change of an action shows both
    if shown is None or shown[last] < 0 or shown[first] != shown[last]:
        return None
    return ACTIONS[shown[last]]


def _pose(task: Task, source: TaskSource) -> dict[str, TargetPart]:
    def value(recording: Recording, first: int, last: int) -> list[float]:
        pose = recording.tracks.get("relative_pose")
        if pose is None:
            return [np.nan] * 3
        turn = np.degrees(np.arctan2(pose[last, 1, 0], pose[last, 0, 0]))
        shifts = pose[last, :2, 3] * 1000  # metres
        return [*np.searchsorted(_SHIFTS, shifts), np.searchsorted(_TURNS, turn)]

    truth = torch.tensor(np.array(_each(source, value), np.float32).reshape(-1, 3))
    names = tuple(map(str, range(len(_SHIFTS) + 1)))
    return {"pose": TargetPart("classes", truth, torch.ones_like(truth), names, "motion")}


def _place(task: Task, source: TaskSource) -> dict[str, TargetPart]:
    def value(recording: Recording, first: int, last: int) -> list[float]:
        place = [recording.labels.get(f"center_{axis}_px", np.nan) for axis in "xy"]
        return [float(coordinate) / recording.frames.shape[1] for coordinate in place]

    truth = torch.tensor(np.array(_each(source, value), np.float32).reshape(-1, 2))
    return {"place": TargetPart("place", truth, torch.ones_like(truth), ("x", "y"))}


def _numbers(source: TaskSource, columns: list[str], shares: bool = False) -> TargetPart:
    """Numeric labels as they are; as shares, those in pixels are divided by the image's width."""

    def value(recording: Recording, first: int, last: int) -> list[float]:
        try:
            found = [_labelled(recording, name, last) for name in columns]
            row = [np.nan if value is None else float(value) for value in found]
        except ValueError as error:
            raise DataError(
                f"{recording.key}: a label of {', '.join(columns)} is not a number ({error}); "
                "correct it, or give target: label:NAME"
            ) from error
        width = recording.frames.shape[1] if shares else 1
        return [x / width for x in row]

    truth = torch.tensor(np.array(_each(source, value), np.float32).reshape(-1, len(columns)))
    return TargetPart("numbers", truth, torch.ones_like(truth), tuple(columns))


def _time(task: Task, source: TaskSource) -> dict[str, TargetPart]:
    """Seconds since the first frame of the whole recording."""
    seconds = _each(source, lambda recording, first, last: recording.times[last])
    truth = torch.tensor(np.array(seconds, np.float32))[:, None]
    return {"time": TargetPart("numbers", truth, torch.ones_like(truth), ("time",), "same")}


def _losing(task: Task, source: TaskSource) -> dict[str, TargetPart]:
    """Whether a grasped object is held, or about to be lost; of the recordings in use."""
    grasps = {
        number: contact.last_contact(contact.contact_energy(recording))
        for number, recording in enumerate(source.recordings)
        if matches_filter(source, number, task.split.only)
    }
    states = iter(
        contact.contact_state(grasps.get(number), last, source.recordings[number].times)
        for number, last in source.index.tolist()
    )
    return {"losing": _classes(source, lambda *_: next(states), ("held", "losing"))}


#: Target by name, besides ``label:NAME``, the class that a label of the recording names, and
#: ``numbers:NAME+NAME``, labels as numbers in their own unit, and ``shares:NAME+NAME``, labels in
#: pixels as shares of the width of the image. Of tracks it is the value at the last frame.
TARGETS: dict[str, Callable[[Task, TaskSource], dict[str, TargetPart]]] = {
    "force": lambda task, source: {"force": _newton(task, source, change=False)},
    "delta_force": lambda task, source: {"delta_force": _newton(task, source, change=True)},
    "normal_force": _normal_force,
    "slip": lambda task, source: {
        "slip": _classes(source, _slips, ("stick", "slip")),
        "delta_force": _newton(task, source, change=True),
    },
    "action": lambda _, source: {"action": _classes(source, _action, ACTIONS, "action")},
    "object": lambda _, source: {"object": _classes(source, lambda r, *_: r.object)},
    "place": _place,
    "pose": _pose,
    "time": _time,
    "losing": _losing,
}
