"""Numbers of real recordings, for comparison with simulated ones."""

from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from omegaconf import OmegaConf
from reality.profiles import profile
from reality.response import response

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings

CONFIG = Path(str(files("tactileforge_datasets.conf") / "data/public_samples.yaml"))

pytestmark = pytest.mark.realdata


def real(realdata: Path, name: str) -> list[Recording]:
    layouts: Any = OmegaConf.to_container(OmegaConf.load(CONFIG).data.layouts)
    layout = {**layouts[name], "hold_out": "none"} if "force" in layouts[name] else layouts[name]
    return list(Recordings(str(realdata), {name: layout}, val=0).recordings("train"))


def test_real_pictures_fall_off_with_frequency(realdata: Path) -> None:
    """Measured independently, by a separate script: -2.7, -3.5, -4.1, -4.4."""
    measured = profile("fots", "digit", real(realdata, "fots_digit")[::6])
    assert measured.faint == 0
    assert measured.of("bands").mean(axis=0) == pytest.approx([-2.7, -3.3, -3.9, -4.2], abs=0.3)
    assert measured.stored == ["png"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "shear", "relative"),
    [("gelsight_mini", (1.50, 1.23), 0.09), ("digit", (0.76, 1.31), 0.06)],
)
def test_real_pictures_answer_to_shear(
    realdata: Path, sensor: str, shear: tuple[float, float], relative: float
) -> None:
    (recording,) = real(realdata, f"touchd_force_{sensor}")
    fit = response(recording)
    assert fit is not None
    assert fit.shear == pytest.approx(shear, rel=0.1)
    assert fit.relative == pytest.approx(relative, abs=0.01)
