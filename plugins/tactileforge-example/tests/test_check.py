"""The check against the contract, and on labels of its own."""

from tactileforge_example.check import WORN, WornGel

from tactileforge.checks import Seen, made_touch
from tactileforge.testing import check


def test_conformance() -> None:
    assert not [result for result in check("check", WornGel) if result.status == "failed"]


def test_the_limit() -> None:
    assert not list(WornGel().look(Seen(made_touch(labels={"presses": WORN}))))
    (found,) = WornGel().look(Seen(made_touch(labels={"presses": WORN + 1})))
    assert "10001 presses" in found.words
