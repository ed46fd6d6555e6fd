"""Demonstrations, trainings and rollouts of a plan; finished parts are not repeated."""

from __future__ import annotations

from dataclasses import dataclass

from tactileforge_bench.fit.pretrain import pretrain

from tactileforge.errors import TactileForgeError
from tactileforge.plugins import write_text
from tactileforge_policies.manipulation.plan import Cell, Plan
from tactileforge_policies.rollouts.demonstrations import write_demonstrations
from tactileforge_policies.rollouts.page import rollout_page
from tactileforge_policies.rollouts.results import EpisodeResult, Summary
from tactileforge_policies.rollouts.rollout import PAGE, roll_out


@dataclass(frozen=True)
class CellResult:
    """A cell after its rollouts.

    Attributes:
        cell: The cell.
        episodes: Results of its episodes; empty where it was not run.
        reason: Reason why it was not run; "" where it was.
    """

    cell: Cell
    episodes: list[EpisodeResult]
    reason: str = ""

    @property
    def summary(self) -> Summary:
        """Sum of the episodes."""
        return Summary.of(self.episodes)


def run_plan(plan: Plan) -> list[CellResult]:
    """Runs all cells. A failed training is reported, and the other cells go on.

    Raises:
        ConfigError: The folder holds results of a different configuration.
        KeyboardInterrupt: It was stopped; the same call resumes it.
    """
    for options in plan.demonstrations():
        write_demonstrations(options)
    return [_run(cell) for cell in plan.cells()]


def _run(cell: Cell) -> CellResult:
    if cell.train is not None:
        pretrain(cell.train)
        if not cell.train.finished:
            reason = cell.train.failed or f"its training did not end, see {cell.train.folder}"
            return CellResult(cell, [], reason)
    try:
        done = roll_out(cell.rollouts)
    except TactileForgeError as error:
        return CellResult(cell, [], str(error))
    write_text(cell.rollouts.folder / PAGE, rollout_page(done))
    return CellResult(cell, list(done.episodes))
