import pytest

from tactileforge import settings
from tactileforge.errors import ConfigError


def test_words_change_the_yaml() -> None:
    config = settings.load("sim", ["out=x", "sensors=[digit]", "markers=true", "force=[1,2.5]"])
    assert (config.out, config.sensors, config.markers) == ("x", ["digit"], True)
    assert (config.force, config.size) == ([1, 2.5], 240)
    assert "out: ???" in settings.text("sim")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], r"give out=\.\.\."),
        (["out=x", "sise=3"], "unknown key 'sise'; did you mean 'size'"),
        (["out=x", "size"], "'size' is not key=value"),
    ],
)
def test_mistakes_are_named(words: list[str], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        settings.load("sim", words)
