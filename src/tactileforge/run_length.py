"""The length of a run, which may change when the run is resumed."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from tactileforge import curriculum
from tactileforge.errors import ConfigError

log = logging.getLogger(__name__)

#: Keys of ``trainer`` that are the length of a run.
LENGTHS = ("max_steps", "max_epochs")


def change_length(
    plain: dict[str, Any], before: Mapping[str, Any], state: Mapping[str, Any]
) -> bool:
    """Gives a resumed run another length; False where it is the same.

    The curriculum stays that of the length that the run was planned with; the learning rate is from
    here on that of a run of the new length.

    Args:
        plain: The configuration to go on with; it is changed.
        before: That of the run, as it is in its folder.
        state: Checkpoint of the run.

    Raises:
        ConfigError: More than the length has changed, or the run is already as long.
    """
    changed = {
        key: value for key, value in plain["trainer"].items() if value != before["trainer"].get(key)
    }
    if not changed:
        return False
    if others := sorted(changed.keys() - set(LENGTHS)):
        raise ConfigError(f"resume= changes the length of a run alone, not trainer.{others[0]}")
    by = "max_epochs" if before["trainer"]["max_steps"] == -1 else "max_steps"
    if by not in changed:
        raise ConfigError(
            f"the run ends by trainer.{by}={before['trainer'][by]}: give another trainer.{by}="
        )
    step, steps = int(state["global_step"]), changed.get("max_steps", -1)
    if 0 <= steps <= step:
        raise ConfigError(f"trainer.max_steps={steps}: the run is already at step {step}")
    total = int(state["total"])
    plain["curriculum"] = curriculum.in_steps(plain["curriculum"], total, int(state["epoch_steps"]))
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
