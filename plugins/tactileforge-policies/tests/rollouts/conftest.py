from types import SimpleNamespace

import numpy as np
import pytest
from tactileforge_policies import policy as loading


class Feels:
    """A policy for ``reach_env``: moves to the place shown by the finger's brightness."""

    fingers = ("left", "right")
    sensor = ("digit", "digit")
    state_size = action_size = 2
    rate = 6.0
    tasks = ()
    uses_touch, uses_image, uses_force, uses_reference = True, False, False, False

    def reset(self, background=None, seed=0):
        self.base = float(background["left"].mean())

    def step(self, frames, state, image=None, force=None):
        assert image is None
        assert force is None
        goal = (frames["left"].mean() - self.base) / 10
        return np.array([np.clip(goal - state[0], -2, 2), 0], np.float32)


@pytest.fixture
def policy(monkeypatch, tmp_path):
    """A file loaded as a policy; a test may change the policy's attributes."""
    path = tmp_path / "policy.safetensors"
    path.write_bytes(b"weights")
    loaded = Feels()
    monkeypatch.setattr(loading, "load_policy", lambda word: loaded)
    return SimpleNamespace(path=str(path), loaded=loaded)
