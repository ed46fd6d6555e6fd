"""Rolls a policy out in a task: success, failures, videos."""

from __future__ import annotations

from typing import Any

from tactileforge.cli import Command
from tactileforge.plugins import write_text
from tactileforge_policies.rollouts.options import RolloutOptions


def _rollout(keys: RolloutOptions, _: dict[str, Any]) -> None:
    """Rolls a policy out in a task: success with its interval, failures, videos and forces."""
    from tactileforge_policies.rollouts.page import rollout_page
    from tactileforge_policies.rollouts.rollout import PAGE, RESULTS, roll_out

    rollouts = roll_out(keys)
    write_text(keys.folder / PAGE, rollout_page(rollouts))
    summary = rollouts.summary
    print(f"{keys.word} on {keys.sensor}, {rollouts.facts['policy']}: {summary.line}")
    print(f"mean score {summary.score:.2f}, {summary.steps_per_second:.1f} steps a second")
    if summary.failures:
        kinds = ", ".join(f"{kind} {count}" for kind, count in summary.failures.items())
        print(f"failures: {kinds}")
    print(f"results: {keys.folder / RESULTS}\nreport: {keys.folder / PAGE}")


COMMANDS = {
    "": Command(run=_rollout, keys=RolloutOptions, writes=lambda keys: keys.folder, into=True)
}
