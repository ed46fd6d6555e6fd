"""The digest of a simulated data set."""

from dataclasses import replace

import pytest
from tactileforge_sim import config
from tactileforge_sim.config import SimConfig

CODE = """def f(x):
    return 2 * x
"""


@pytest.mark.parametrize(
    ("other", "same"),
    [
        ('"""A module."""\n\n\n' + CODE, True),
        ('def f(x):\n    """Doubles."""\n    # twice\n    return (\n        2 * x\n    )\n', True),
        (CODE.replace("2", "3"), False),
        (CODE.replace("x", "y"), False),
    ],
)
def test_words_in_the_code_make_no_new_data_and_numbers_do(other: str, same: bool) -> None:
    assert (config._without_words(CODE) == config._without_words(other)) == same


def test_another_configuration_or_code_is_another_data_set(monkeypatch) -> None:
    known = SimConfig(
        sensors=("digit",),
        indenters="few",
        motions="atomic",
        size=64,
        seconds=0.6,
        force=(0.5, 8.0),
        markers=None,
        viscosity=0.0,
        lag=0.0,
        seed=0,
    )
    before = known.digest()
    assert replace(known).digest() == before
    assert replace(known, seed=1).digest() != before
    monkeypatch.setattr(config, "_code", lambda: "other")
    assert known.digest() != before
