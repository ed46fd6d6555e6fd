"""The commit beside results."""

from pathlib import Path

import pytest

from tactileforge.util import provenance


def test_the_commit_is_that_of_the_checkout_and_of_no_other(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / ".git").mkdir()
    monkeypatch.setattr(provenance, "__file__", str(tmp_path / "a" / "b" / "provenance.py"))
    assert provenance.commit() == ""
