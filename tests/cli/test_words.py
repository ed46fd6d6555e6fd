"""Names like numbers keep their letters, for every verb."""

import pytest

from tactileforge.cli._words import values


@pytest.mark.parametrize("text", ["007", "1.0", "1e3", "0x1f", "1_000", "010", "yes", "7"])
def test_a_name_of_digits_stays_as_it_is_typed(text: str) -> None:
    hints = {"object": str | None, "name": str, "count": int}
    words = [f"object={text}", f"name={text}", "count=7"]
    assert values(words, hints) == {"object": text, "name": text, "count": 7}
