"""``tactileforge sim compare``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from tactileforge import registry, settings
from tactileforge.files import write_text
from tactileforge.reality.compare import CompareOptions, Side, compare_reality


def main(argv: Sequence[str]) -> int:
    """Runs the verb.

    Args:
        argv: The words after ``tactileforge sim compare``.

    Returns:
        The exit code.

    Raises:
        TactileForgeError: Something is wrong; says the fix.
    """
    if argv in (["--help"], ["-h"]):
        print(settings.text("compare"))
        return 0
    from tactileforge.compose import plain

    config = plain("compare", argv)
    options = CompareOptions(
        **{field.name: _frozen(config[field.name]) for field in fields(CompareOptions)}
    )
    dataset = registry.build("datasets", config["data"])
    sides = compare_reality(dataset, options)

    from tactileforge.reality.page import reality_page

    write_text(Path(config["out"]), reality_page(config["data"]["name"], sides))
    for sensor, side in sides.items():
        print(_told(sensor, side))
    for line in dataset.skipped:
        print(f"note: {line}")
    print(f"page: {config['out']}")
    return 0


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _told(sensor: str, side: Side) -> str:
    """The nearest real source by each number."""
    lines = [f"{sensor}: {len(side.simulated.looks)} simulated touches"]
    for source, distances in side.apart.items():
        numbers = ", ".join(
            f"{name} {value:.2g}" for name, value in distances.items() if value == value
        )
        lines.append(f"  to {source}: {numbers}")
    return "\n".join(lines)
