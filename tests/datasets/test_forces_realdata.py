"""No public recording with forces is taken for untared, or for one with other axes."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from tactileforge.checks.doubts import check_labels
from tactileforge.checks.sample import sample_of
from tactileforge.checks.untared import drifted, untared
from tactileforge.datasets.recordings import Recordings

CONFIG = Path(str(files("tactileforge_datasets.conf") / "data/public_samples.yaml"))

pytestmark = pytest.mark.realdata


@pytest.mark.slow
def test_no_alarm(realdata: Path) -> None:
    layouts = OmegaConf.to_container(OmegaConf.load(CONFIG).data.layouts)
    forced = {name: keys for name, keys in layouts.items() if keys.get("force")}
    whole = {name: {**keys, "hold_out": "none"} for name, keys in forced.items()}
    parts = [
        one
        for side in ("train", "val")
        for one in Recordings(str(realdata), forced).recordings(side)
    ]
    wholes = list(Recordings(str(realdata), whole).recordings("train"))
    assert (len(parts), len(wholes)) == (20, 2)
    for one in (*parts, *wholes):
        assert untared(one) is None
        assert drifted(one, sample_of(one)) is None
        reasons = {flag.reason for flag in check_labels(one)}
        assert {"axes_exchanged", "stuck_force", "forces_apart"}.isdisjoint(reasons)
    for one in wholes:
        assert one.force is not None
        turned = replace(one, force=one.force[:, [2, 1, 0]])
        assert "axes_exchanged" in {flag.reason for flag in check_labels(turned)}
        shifted = replace(one, force=one.force + np.float32([0, 0, 1.5]))
        assert untared(shifted) is not None
