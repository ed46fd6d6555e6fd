"""Results of rollouts: one file per episode, and their summary."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import NormalDist, fmean
from typing import Any

from tactileforge.errors import DataError
from tactileforge.plugins import sealed, strict, unsealed, write_text

#: Two-sided 95 % quantile of the normal distribution.
_Z = NormalDist().inv_cdf(0.975)


@dataclass(frozen=True, kw_only=True)
class EpisodeResult:
    """Result of one episode.

    Attributes:
        seed: Seed of its start and physics.
        success: Whether the task was done.
        score: Score, 0 to 1, with partial credit.
        failure: Kind of failure; "" for success.
        steps: Number of actions.
        seconds: Computing time of simulation and actor, s.
        act_seconds: Computing time of all actions of the actor, s.
        times: Times of the forces, s.
        force: Force on each finger, x, y and z at each time, N.
        video: Path of its video, relative to the folder of the results; "" where the installed
            OpenCV cannot write VP9.
    """

    seed: int
    success: bool
    score: float
    failure: str
    steps: int
    seconds: float
    act_seconds: float
    times: list[float]
    force: dict[str, list[list[float]]]
    video: str = ""

    def save(self, path: Path) -> None:
        """Writes the result atomically, with a checksum."""
        write_text(path, sealed(asdict(self)))

    @classmethod
    def load(cls, path: Path) -> EpisodeResult:
        """Reads a file of `save`.

        Raises:
            DataError: The file is damaged.
        """
        try:
            return strict.build(cls, str(path), unsealed(path.read_bytes()))
        except ValueError as error:
            raise DataError(f"{path}: damaged ({error}); remove it, and go on") from error


def wilson(successes: int, count: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson, 1927); it stays within 0 and 1, even for shares 0 and 1.

    Example:
        >>> [round(end, 3) for end in wilson(18, 20)]
        [0.699, 0.972]
    """
    if not count:
        return 0.0, 1.0
    share, spread = successes / count, _Z**2 / count
    middle = (share + spread / 2) / (1 + spread)
    half = math.sqrt(share * (1 - share) * spread + spread**2 / 4) / (1 + spread)
    return max(0.0, middle - half), min(1.0, middle + half)


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Summary of some episodes.

    Attributes:
        n: Number of episodes.
        successes: Number of successful episodes.
        success: Share of successful episodes.
        low: Lower end of its 95 % interval (Wilson).
        high: Upper end of its 95 % interval (Wilson).
        score: Mean score, 0 to 1.
        failures: Number of episodes by kind of failure, most frequent first.
        steps_per_second: Steps computed per second by one process, simulation and actor together.
        act_ms: Mean computing time of an action of the actor, ms.
    """

    n: int
    successes: int
    success: float
    low: float
    high: float
    score: float
    failures: dict[str, int]
    steps_per_second: float
    act_ms: float

    @classmethod
    def of(cls, episodes: Sequence[EpisodeResult]) -> Summary:
        """Summarises episodes."""
        successes = sum(episode.success for episode in episodes)
        steps = sum(episode.steps for episode in episodes)
        low, high = wilson(successes, len(episodes))
        kinds = Counter(episode.failure for episode in episodes if not episode.success)
        return cls(
            n=len(episodes),
            successes=successes,
            success=successes / len(episodes),
            low=low,
            high=high,
            score=fmean(episode.score for episode in episodes),
            failures=dict(kinds.most_common()),
            steps_per_second=steps / max(1e-9, sum(episode.seconds for episode in episodes)),
            act_ms=1e3 * sum(episode.act_seconds for episode in episodes) / max(1, steps),
        )

    @property
    def line(self) -> str:
        """Success and its interval in words."""
        interval = f"{100 * self.low:.1f} to {100 * self.high:.1f} %"
        return (
            f"{self.successes} of {self.n} succeed, {100 * self.success:.1f} % "
            f"(95 % interval {interval})"
        )


def write_results(
    path: Path, made: dict[str, Any], summary: Summary, episodes: Sequence[EpisodeResult]
) -> None:
    """Writes ``results.json``: the options, the summary, and a row per episode.

    Args:
        path: Path of the file.
        made: Options of the rollouts, with a hash of the weights.
        summary: Summary of the episodes.
        episodes: Results in the order of their seeds; times and forces are left out.
    """
    heavy = ("times", "force")
    rows = [{k: v for k, v in asdict(row).items() if k not in heavy} for row in episodes]
    text = {"rollout": made, "summary": asdict(summary), "episodes": rows}
    write_text(path, json.dumps(text, indent=1))
