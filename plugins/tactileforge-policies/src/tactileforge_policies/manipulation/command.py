"""The runner of the suite ``manipulation``: ``tactileforge bench suite=manipulation``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactileforge.plugins import strict
from tactileforge_policies.manipulation.output import write_outputs
from tactileforge_policies.manipulation.plan import ManipulationOptions, make_plan
from tactileforge_policies.manipulation.run import run_plan


def compare_policies(config: dict[str, Any]) -> list[str]:
    """Trains policies, rolls them out and compares them.

    Args:
        config: Configuration of ``bench``; ``manipulation`` holds the options of the table.

    Returns:
        Cells that were not run, with the reason, a line each.

    Raises:
        ConfigError: An unknown policy or task, or an invalid option.
    """
    options = strict.build(ManipulationOptions, "manipulation", config["manipulation"])
    folder = Path(config["out"] or "runs/bench/manipulation")
    plan = make_plan(options, folder, config["seeds"], config["model"], config["task"])
    print(plan.told(), flush=True)
    results = run_plan(plan)
    _, table, report = write_outputs(plan, results)
    print(table.read_text("utf-8"))
    print(f"report: {report}")
    return sorted({f"{r.cell.rollouts.folder.name}: {r.reason}" for r in results if r.reason})
