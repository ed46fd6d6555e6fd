"""Writes a page with simulated and real touches side by side.

Run: python benchmarks/sim_compare.py data=public_samples data.root=DIR out=compare.html
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from reality.compare import CompareOptions, Side, compare_reality
from reality.page import reality_page

from tactileforge.cli import Command, _run
from tactileforge.errors import TactileForgeError
from tactileforge.plugins import registry, write_text


@dataclass(frozen=True, kw_only=True)
class Compare(CompareOptions):
    """A page with simulated and real touches side by side.

    Attributes:
        out: Path of the page.
    """

    out: str = "compare.html"


def compare(keys: Compare, config: dict[str, Any]) -> None:
    """Writes a page with simulated and real touches side by side."""
    dataset = registry.build("datasets", config["data"])
    sides = compare_reality(dataset, keys)
    write_text(Path(keys.out), reality_page(config["data"]["name"], sides))
    for sensor, side in sides.items():
        print(nearest(sensor, side))
    for line in dataset.skipped:
        print(f"note: {line}")
    print(f"page: {keys.out}")


def nearest(sensor: str, side: Side) -> str:
    """Text with the distances of a sensor's simulated touches to each real source."""
    lines = [f"{sensor}: {len(side.simulated.looks)} simulated touches"]
    for source, found in side.apart.items():
        numbers = ", ".join(
            f"{name} {value:.2g}" for name, value in found.items() if value == value
        )
        lines.append(f"  to {source}: {numbers}")
    return "\n".join(lines)


COMMAND = Command(run=compare, keys=Compare, groups={"data": "???"})


def main(argv: Sequence[str]) -> int:
    """Runs the command, and returns its exit status."""
    try:
        return _run.run("sim_compare", COMMAND, argv)
    except TactileForgeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
