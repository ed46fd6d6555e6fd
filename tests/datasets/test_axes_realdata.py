"""On real recordings the imprint moves in the direction of the shear."""

from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from omegaconf import OmegaConf

from tactileforge.datasets.recordings import Recordings

CONFIG = Path(str(files("tactileforge_datasets.conf") / "data/public_samples.yaml"))
#: Frames over which the imprint moves, and normal force (N) that keeps it visible.
STEP, PRESSED = 5, 0.5

pytestmark = pytest.mark.realdata


def motion_and_force(
    realdata: Path, name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Motion of the imprint (n, 2) in pixels right and down, shear (n, 2), and its change."""
    layout = OmegaConf.to_container(OmegaConf.load(CONFIG).data.layouts[name]) | {
        "hold_out": "none"
    }
    (recording,) = Recordings(str(realdata), {name: layout}).recordings("train")
    assert recording.force is not None
    assert recording.no_contact is not None
    grey = recording.frames.read(range(len(recording.frames))).astype(np.float32).mean(axis=-1)
    still = np.median(recording.no_contact.read(range(3)).astype(np.float32).mean(axis=-1), axis=0)
    pressed = np.nan_to_num(recording.force[:, 2]) > PRESSED
    rows = np.flatnonzero(pressed[:-STEP] & pressed[STEP:])
    window = cv2.createHanningWindow(grey.shape[:0:-1], cv2.CV_32F)
    moved = [cv2.phaseCorrelate(grey[i] - still, grey[i + STEP] - still, window)[0] for i in rows]
    change = recording.force[rows + STEP] - recording.force[rows]
    return np.array(moved), recording.force[rows + STEP // 2, :2], change[:, :2]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["touchd_force_gelsight_mini", "touchd_force_digit"])
def test_the_imprint_moves_where_the_shear_points(realdata: Path, name: str) -> None:
    """Each direction of motion follows the shear of its own axis, and not the other's.

    The gel gives by the change of the shear, and the object slips in its direction.
    """
    moved, shear, change = motion_and_force(realdata, name)
    explained = np.zeros((2, 2))
    for direction in range(2):
        for axis in range(2):
            by = np.stack([shear[:, axis], change[:, axis], np.ones(len(moved))], axis=1)
            slope, *_ = np.linalg.lstsq(by, moved[:, direction], rcond=None)
            explained[direction, axis] = np.corrcoef(by @ slope, moved[:, direction])[0, 1]
            if direction == axis:
                assert slope[0] > 0
                assert slope[1] > 0
    assert explained.diagonal().min() > 0.6
    assert max(explained[0, 1], explained[1, 0]) < 0.3
