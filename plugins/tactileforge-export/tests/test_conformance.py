"""The conformance suite of encoders uses the verb of this package."""

import pytest
from tactileforge_export import write

from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import TactileForgeError
from tactileforge.testing.results import CheckResult, CheckSubject, run_check
from tactileforge.testing.trained_encoders import exported_it_is_the_same

OPTIONS = {"size": "tiny", "depth": 1, "image_size": 32, "frames": 2}


def checked() -> CheckResult:
    return run_check(
        exported_it_is_the_same, CheckSubject("encoders", TactileViT, "tactile_vit", OPTIONS)
    )


@pytest.mark.slow
def test_an_encoder_is_exported_without_a_word(capsys: pytest.CaptureFixture[str]) -> None:
    result = checked()
    assert (result.status, result.detail) == ("ran", "")
    assert capsys.readouterr() == ("", "")


def test_a_file_that_differs_fails_the_check(monkeypatch: pytest.MonkeyPatch) -> None:
    def differs(*_: object, **__: object) -> None:
        raise TactileForgeError("the file's outputs differ")

    monkeypatch.setattr(write, "export", differs)
    result = checked()
    assert result.status == "failed"
    assert "the file's outputs differ" in result.detail
