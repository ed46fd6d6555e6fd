"""A small task for rollouts: move to the place shown by the finger's picture.

The finger's brightness is the place; the camera and the state do not show it. Importing this
registers ``Reach-v0``, without a limit of its own. The expert fails if ``seed % 5 == 3``.
"""

import gymnasium
import numpy as np
from gymnasium import spaces

FINGERS = ("left", "right")


class Reach(gymnasium.Env):
    fingers = FINGERS
    control_rate = 6.0
    task = "reach"
    instruction = "move to the place that the finger feels"
    action_names = ("dplace", "dopening")
    state_names = ("place", "opening")

    def __init__(self, sensor="digit", size=32, rate=6.0, hopeless=False, unit=0):
        self.sensor, self.size, self.control_rate = sensor, size, rate
        self.hopeless, self.unit = hopeless, unit
        picture = spaces.Box(0, 255, (size, size, 3), np.uint8)
        camera = spaces.Box(0, 255, (96, 96, 3), np.uint8)
        state = spaces.Box(-100, 100, (2,), np.float32)
        self.observation_space = spaces.Dict(
            {"left": picture, "right": picture, "image": camera, "state": state}
        )
        self.action_space = spaces.Box(-10, 10, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.number = seed
        self.place, self.opening, self.broken = 0.0, 10.0, False
        self.goal = float(self.np_random.uniform(-10, 10))
        return self._observation(), self._info()

    def step(self, action):
        self.place += float(action[0])
        self.opening += float(action[1])
        self.broken = self.opening < 5
        info = self._info()
        return self._observation(), info["score"], info["success"] or self.broken, False, info

    def background(self):
        return {
            name: np.full((self.size, self.size, 3), 128 + self.unit, np.uint8) for name in FINGERS
        }

    def wrench(self):
        return {"left": np.array([0, 0, 1.0]), "right": np.array([0.1, 0, abs(self.place)])}

    def expert(self):
        def act(observation):
            if self.hopeless or self.number % 5 == 3:
                return np.array([0.0, -9.0], np.float32)
            return np.array([np.clip(self.goal - self.place, -2, 2), 0], np.float32)

        return act

    def _observation(self):
        level = np.uint8(128 + 10 * self.goal)
        view = np.full((96, 96, 3), 40, np.uint8)
        view[40:56, 40:56] = int(128 + 5 * np.clip(self.place, -20, 20))
        return {
            "left": np.full((self.size, self.size, 3), level, np.uint8),
            "right": np.full((self.size, self.size, 3), 128, np.uint8),
            "image": view,
            "state": np.array([self.place, self.opening], np.float32),
        }

    def _info(self):
        score = max(0.0, 1 - abs(self.goal - self.place) / 10)
        success = abs(self.goal - self.place) < 0.1 and not self.broken
        failure = "crushed" if self.broken else ""
        return {"success": success, "score": score, "failure": failure, "force": self.wrench()}


gymnasium.register("Reach-v0", Reach)
