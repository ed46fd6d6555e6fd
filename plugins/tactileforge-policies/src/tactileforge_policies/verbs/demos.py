"""Records the scripted expert of a task, to train policies on."""

from __future__ import annotations

from typing import Any

from tactileforge.cli import Command
from tactileforge.errors import command
from tactileforge_policies.rollouts.options import DemonstrationOptions


def _demos(keys: DemonstrationOptions, _: dict[str, Any]) -> None:
    """Records the scripted expert of a task, as shards for the training of policies."""
    from tactileforge_policies.rollouts.demonstrations import write_demonstrations

    made = write_demonstrations(keys)
    print(f"{made.episodes} episodes: {keys.out}")
    if made.failed:
        kinds = ", ".join(f"{seed} {kind}" for seed, kind in made.failed.items())
        tried = made.episodes + len(made.failed)
        print(f"left out, the expert failed in {len(made.failed)} of {tried}; seeds: {kinds}")
    words = ("recipe=imitation", "data=demonstrations", f"data.root={keys.out}")
    print(f"train on them: {command('train', *words)}")


COMMANDS = {"": Command(run=_demos, keys=DemonstrationOptions, into=True)}
