"""Records the scripted expert of a task, to train policies on."""

from __future__ import annotations

from typing import Any

from tactileforge.cli._command import Command
from tactileforge.rollouts.demonstrations import DemonstrationOptions, write_demonstrations


def _demos(keys: DemonstrationOptions, _: dict[str, Any]) -> None:
    """Records the scripted expert of a task, as shards that policies are trained on."""
    made = write_demonstrations(keys)
    total = made.train + made.val
    print(f"{total} episodes ({made.train} for training, {made.val} for validation): {keys.out}")
    if made.failed:
        kinds = ", ".join(f"{seed} {kind}" for seed, kind in made.failed.items())
        print(f"left out, the expert failed: {len(made.failed)} of {total + len(made.failed)}")
        print(f"their seeds: {kinds}")
    print(f"train on them: tactileforge train recipe=diffusion_policy data.root={keys.out}")


COMMANDS = {"": Command(run=_demos, keys=DemonstrationOptions)}
