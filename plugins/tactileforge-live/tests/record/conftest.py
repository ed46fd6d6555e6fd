import pytest
from tactileforge_live.record.options import RecordOptions

from tactileforge.sensors.background import Background


@pytest.fixture
def options(tmp_path):
    """Options for a take of a second without a background."""

    def make(**given):
        defaults = {
            "out": str(tmp_path / "out"),
            "seconds": 0.6,
            "segment": 0.2,
            "pause": 0.0,
            "background": Background(seconds=0.0),
            "codec": "png",
        }
        return RecordOptions(**(defaults | given))

    return make
