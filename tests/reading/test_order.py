"""Numbers in names count by value; where two orders are possible, that is said."""

from pathlib import Path

import pytest

from tactileforge.errors import DataError
from tactileforge.reading.order import by_pattern, name_keys, order_doubt


def in_order(*stems: str) -> list[str]:
    paths = [Path(f"{stem}.png") for stem in stems]
    keys = name_keys(paths)
    return [path.stem for path in sorted(reversed(paths), key=lambda path: keys[path])]


@pytest.mark.parametrize(
    "stems",
    [
        ["gp_8.05_f1", "gp_8.27_f2", "gp_8.5_f3"],
        ["gp_9.75_f1", "gp_10.25_f2", "gp_10.5_f3"],
        ["a0.05", "a0.1", "a0.25", "a1"],
        [f"v1.{i}" for i in range(1, 13)],
        ["x1.1", "x1.9", "x1.10"],
        ["2026.11.4_7", "2026.11.5_3", "2026.11.25_12"],
        ["f2", "f10", "f0011"],
        ["-1.5", "-1.05", "0", "0.25"],
    ],
)
def test_natural_order(stems: list[str]) -> None:
    assert in_order(*stems) == stems
    assert order_doubt([Path(f"{stem}.png") for stem in stems]) == ""


def test_two_orders_are_said() -> None:
    closing = in_order("gp_8.5_f1", "gp_8.27_f2", "gp_8.05_f3")
    said = order_doubt([Path(f"{stem}.png") for stem in closing])
    assert said.startswith("two orders are possible: 'gp_8.05_f3' is read first, but by the number")
    assert "1 to 3, 'gp_8.5_f1' is the first; give order:" in said
    parts = in_order("a1.9", "a1.25", "a1.31")
    assert parts == ["a1.25", "a1.31", "a1.9"]
    said = order_doubt([Path(f"{stem}.png") for stem in parts])
    assert "with points that are not fractions, 'a1.9' comes before 'a1.25'" in said


def test_a_pattern_gives_the_order() -> None:
    paths = [Path(f"{stem}.png") for stem in ("gp_8.05_f3", "gp_8.27_f2", "gp_8.5_f1")]
    assert by_pattern(paths, "_f{number}", "a") == paths[::-1]
    assert by_pattern(paths, "gp_{number}_f", "a") == paths
    assert by_pattern(paths, "gp*f{number}", "a") == paths[::-1]
    with pytest.raises(
        DataError, match=r"f3\.png: no number where order: '_g\{number\}' of layout"
    ):
        by_pattern(paths, "_g{number}", "a")
    with pytest.raises(DataError, match=r"has the number of gp_8\.05_f3\.png by order"):
        by_pattern(paths, "gp_{number}.", "a")
