"""Changes of the length of a run, and of its machine, on resumption."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from tactileforge.errors import ConfigError
from tactileforge.training import curriculum

log = logging.getLogger(__name__)

#: Keys of ``trainer`` for the length of a run.
LENGTHS = ("max_steps", "max_epochs")
#: Keys of ``trainer`` for its machine: number of processes, kind of device, precision,
#: time that is left.
MACHINE = ("devices", "num_nodes", "accelerator", "precision", "max_time")


def change_run(plain: dict[str, Any], before: Mapping[str, Any], state: Mapping[str, Any]) -> bool:
    """Gives a resumed run another length, or other processes; returns False without a change.

    The curriculum stays that of the planned length; the learning rate is from here on that of a run
    of the new length. On another number of processes epochs have another number of steps: a run by
    epochs then ends by steps, and keeps its total number of steps.

    Args:
        plain: Configuration to continue with; it is changed.
        before: Configuration in the folder of the run.
        state: Checkpoint of the run.

    Raises:
        ConfigError: More than length and machine has changed, or the run is already as long.
    """
    from tactileforge.util.distributed import count_processes  # imports torch; help reads `LENGTHS`

    changed = {
        key: value for key, value in plain["trainer"].items() if value != before["trainer"].get(key)
    }
    has_moved = int(state["processes"]) != count_processes(plain["trainer"])
    if not changed and not has_moved:
        return False
    if others := sorted(changed.keys() - {*LENGTHS, *MACHINE}):
        raise ConfigError(f"resume= changes length and machine of a run, not trainer.{others[0]}")
    by = "max_epochs" if before["trainer"]["max_steps"] == -1 else "max_steps"
    total, epoch = int(state["total"]), int(state["epoch_steps"])
    if has_moved:
        if "max_epochs" in changed and by == "max_epochs":
            raise ConfigError(
                "trainer.max_epochs= on another number of processes, where epochs have another "
                "length: give trainer.max_steps="
            )
        if by == "max_epochs":
            changed = {"max_steps": changed.get("max_steps", total)}
            plain["trainer"] = {**plain["trainer"], **changed, "max_epochs": -1}
            by = "max_steps"
    # in steps, so that a fraction or an epoch is not taken from the new length
    plain["curriculum"] = curriculum.in_steps(plain["curriculum"], total, epoch)
    if not changed.keys() & set(LENGTHS):
        return True
    if by not in changed:
        raise ConfigError(
            f"the run ends by trainer.{by}={before['trainer'][by]}: give another trainer.{by}="
        )
    step, steps = int(state["global_step"]), changed.get("max_steps", -1)
    if 0 <= steps <= step:
        raise ConfigError(f"trainer.max_steps={steps}: the run is already at step {step}")
    if by == "max_steps":
        plain["trainer"]["max_epochs"] = -1  # a run that ends by its steps has an epoch behind it
    log.warning(
        "resume: from step %d on with %s; the learning rate is that of a run of the new length "
        "(it falls to 0 at its end), the curriculum stays as planned for %d steps",
        step,
        ", ".join(f"trainer.{key}={value}" for key, value in changed.items()),
        total,
    )
    return True
