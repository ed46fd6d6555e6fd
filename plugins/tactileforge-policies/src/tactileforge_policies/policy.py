"""``tactileforge_policies.load_policy``: a trained policy for step-by-step use on a robot."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from tactileforge.contracts import NEUTRAL_BACKGROUND, Batch, Views
from tactileforge.data import resize_frame
from tactileforge.encoders import views_of
from tactileforge.errors import ConfigError, DataError
from tactileforge.runs import BEST, read_checkpoint, read_config
from tactileforge.training import build_parts
from tactileforge_policies.heads.base import PolicyHead
from tactileforge_policies.reference import reference_gain, with_gain
from tactileforge_policies.robot import Robot

Image = NDArray[np.uint8]


class Policy:
    """A policy in evaluation mode, with its own clips, queue of commands and backgrounds.

    Args:
        encoder: The touch encoder.
        head: The policy head.

    Attributes:
        fingers: Names of its fingers.
        sensor: Type of the sensor of each finger.
        state_size: Numbers of the proprioception, S.
        action_size: Numbers of a command, A.
        rate: Commands a second in training, Hz.
        tasks: Names of its tasks, from the label ``task`` of its demonstrations; may be empty.
        uses_touch: Whether it reads pictures of touch.
        uses_image: Whether it reads the camera.
        uses_force: Whether it reads forces, N.
        uses_reference: Whether it needs a reference press of each finger.
    """

    def __init__(self, encoder: Any, head: PolicyHead) -> None:
        self.robot: Robot = head.robot
        self.fingers = self.robot.fingers
        self.sensor = list(self.robot.sensors)
        self.state_size, self.action_size = self.robot.state_size, self.robot.action_size
        self.rate = self.robot.rate
        self.tasks = self.robot.tasks
        self.uses_touch = self.robot.touch == "frames"
        self.uses_force = self.robot.touch == "force"
        self.uses_image = bool(self.robot.image_size)
        self.uses_reference = self.uses_touch and self.robot.reference_press
        self._encoder = encoder.requires_grad_(False).eval()
        self._head = head.requires_grad_(False).eval()
        self._span = (encoder.frames - 1) * self.robot.stride + 1
        self.reset()

    def reset(
        self,
        background: Mapping[str, Image] | None = None,
        seed: int = 0,
        reference: Mapping[str, Image] | None = None,
    ) -> None:
        """Starts an episode: forgets all frames and commands.

        Args:
            background: Frame without contact of each finger, uint8 (H, W, 3); None for no
                subtraction.
            seed: Seed of the initial noise of commands.
            reference: Frame of each finger in the reference press, uint8 (H, W, 3), where the
                policy was trained with one; needs the background.

        Raises:
            ConfigError: The fingers differ from the policy's, or a frame is invalid.
            DataError: A reference press changes nothing; see `reference.reference_gain`.
        """
        if background is not None and self.uses_touch:
            self._check_fingers("background", background)
            for name in self.fingers:
                _check_picture(f"background of {name}", background[name])
        self._background = background
        self._gains = self._measured(background, reference)
        self._generator = torch.Generator().manual_seed(seed)
        self._queue: deque[NDArray[np.float32]] = deque()
        self._touch: deque[Mapping[str, Image]] = deque(maxlen=self._span)
        self._seen: deque[dict[str, NDArray[Any]]] = deque(maxlen=self.robot.observations)

    def step(
        self,
        frames: Mapping[str, Image],
        state: ArrayLike,
        image: Image | None = None,
        force: Mapping[str, ArrayLike] | None = None,
    ) -> NDArray[np.float32]:
        """Returns the command for this step; call it `rate` times a second.

        A new chunk is predicted when the commands of the last one are used up. The steps between
        return at once.

        Args:
            frames: Frame of each finger, uint8 (H, W, 3), of the size of its background.
            state: Proprioception, (S,).
            image: Camera image, uint8 (h, w, 3), where the policy uses one.
            force: Force on each finger, (3,), N, where the policy uses them.

        Returns:
            float32 (A,), in the units of the demonstrations.

        Raises:
            ConfigError: Wrong fingers, sizes or types, or a missing image or force. The step is
                then ignored, and may be repeated.
            DataError: A state or force is not finite; the step is ignored as well.
        """
        perceived = self._perceived(state, image, force)
        if self.uses_touch:
            self._touch.append(self._felt(frames))
        self._seen.append(perceived)
        if not self._queue:
            with torch.no_grad():
                chunk = self._head.act(self._views(), self._batch(), self._generator)
            self._queue.extend(chunk[0, : self._head.execute].float().cpu().numpy())
        return self._queue.popleft()

    def _felt(self, frames: Mapping[str, Image]) -> dict[str, Image]:
        self._check_fingers("frames", frames)
        for name in self.fingers:
            _check_picture(f"frame of {name}", frames[name])
            shape = frames[name].shape
            if self._background is not None and shape != self._background[name].shape:
                raise ConfigError(
                    f"frame of {name}: {shape}, and its background is "
                    f"{self._background[name].shape}; give both as the sensor takes them"
                )
        if self.uses_reference and not self._gains:
            raise ConfigError(
                "the policy was trained with reference presses: give reset(background=, "
                "reference=), a frame of each finger at rest and in the press"
            )
        out = {name: self._resized(frames[name]) for name in self.fingers}
        for name, gain in self._gains.items():
            out[name] = with_gain(out[name], self._rest(name), gain)
        return out

    def _measured(
        self, background: Mapping[str, Image] | None, reference: Mapping[str, Image] | None
    ) -> dict[str, float]:
        """Gain of each finger; empty for a policy without reference presses."""
        if not self.uses_reference or background is None or reference is None:
            return {}
        self._check_fingers("reference press", reference)
        for name in self.fingers:
            _check_picture(f"reference press of {name}", reference[name])
        return {
            name: reference_gain(background[name], reference[name], name) for name in self.fingers
        }

    def _perceived(
        self, state: ArrayLike, image: Image | None, force: Mapping[str, ArrayLike] | None
    ) -> dict[str, NDArray[Any]]:
        seen: dict[str, NDArray[Any]] = {"state": np.asarray(state, np.float32)}
        if seen["state"].shape != (self.state_size,):
            raise ConfigError(
                f"state: {seen['state'].shape}, and the policy was trained on ({self.state_size},)"
                "; give the same numbers in the same order"
            )
        if self.uses_image:
            if image is None:
                raise ConfigError("the policy uses a camera: give image=, uint8 (h, w, 3)")
            _check_picture("image", image)
            seen["images"] = resize_frame(image, (self.robot.image_size, self.robot.image_size))
        if self.uses_force:
            if force is None:
                raise ConfigError("the policy was trained on forces: give force= of each finger, N")
            self._check_fingers("force", force)
            rows = [np.asarray(force[name], np.float32) for name in self.fingers]
            seen["forces"] = np.concatenate(rows)
        if not all(np.isfinite(values).all() for values in seen.values()):
            raise DataError("state or force: a number that is not finite; check the robot's driver")
        return seen

    def _batch(self) -> Batch:
        """Builds one sample of the last observations; repeats the first where there are few."""
        missing = self.robot.observations - len(self._seen)
        rows = [self._seen[0]] * missing + list(self._seen)
        batch: Batch = {
            key: torch.from_numpy(np.stack([row[key] for row in rows]))[None] for key in rows[0]
        }
        if self.uses_image:
            batch["images"] = batch["images"].movedim(-1, -3)
        return batch

    def _views(self) -> Views:
        if not self.uses_touch:
            return views_of(self._encoder, {})
        held = [self._touch[0]] * (self._span - len(self._touch)) + list(self._touch)
        held = held[:: self.robot.stride]
        clips = [np.stack([one[name] for one in held]) for name in self.fingers]
        frames = torch.from_numpy(np.stack(clips)).movedim(-1, -3)
        rest = torch.from_numpy(np.stack([self._rest(name) for name in self.fingers]))
        sensor = self._encoder.sensor_ids(self.sensor)
        tokens: Tensor = self._encoder(frames, rest.movedim(-1, -3), sensor)[0]
        # Rounded to float16, as the stored tokens in training are (`EpisodeClips.remember`).
        return views_of(self._encoder, {"tokens": tokens.half()[None]})

    def _resized(self, frame: Image) -> Image:
        return resize_frame(frame, self._encoder.image_size)

    def _rest(self, name: str) -> Image:
        if self._background is None:
            return np.full((*self._encoder.image_size, 3), NEUTRAL_BACKGROUND, np.uint8)
        return self._resized(self._background[name])

    def _check_fingers(self, what: str, given: Mapping[str, Any]) -> None:
        if set(given) != set(self.fingers):
            raise ConfigError(
                f"{what} of {', '.join(sorted(given)) or 'no finger'}, and the policy feels with "
                f"{', '.join(self.fingers)}; give one of each"
            )

    def check_sensors(self, sensors: Mapping[str, str] | str) -> None:
        """Raises a ConfigError if a robot's fingers or sensors differ from the policy's.

        Args:
            sensors: Type of the sensor of each finger, or one for all.
        """
        if isinstance(sensors, str):
            sensors = dict.fromkeys(self.fingers, sensors)
        self._check_fingers("sensors", sensors)
        for name, mine in zip(self.fingers, self.sensor, strict=True):
            if self.uses_touch and sensors[name] != mine:
                raise ConfigError(
                    f"finger {name!r} has a {sensors[name]}, and the policy was trained with a "
                    f"{mine}; use that sensor, or train on demonstrations of the other"
                )


def load_policy(run: str | Path) -> Policy:
    """Loads the policy of a run, with its best weights if they were stored, else its last.

    No code of the files is executed; they name plugins, and only installed ones are built.

    Args:
        run: Folder of a run of ``tactileforge train``, or a checkpoint in it.

    Raises:
        DataNotFoundError: There is no such run.
        ConfigError: The run has no policy, or the checkpoint does not fit it.

    Example:
        >>> policy = load_policy("runs/chip")  # doctest: +SKIP
        >>> policy.reset(background)  # doctest: +SKIP
        >>> action = policy.step(fingers, state, image)  # doctest: +SKIP
    """
    path = Path(run)
    folder = path.parent.parent if path.is_file() else path
    config = read_config(folder)
    config["facts"] = config.get("facts") or config.get("robot")  # "robot" in older runs
    if not config["facts"]:
        raise ConfigError(f"{folder}: its run trained no policy; train recipe=diffusion_policy")
    best = folder / BEST
    state = read_checkpoint(path if path.is_file() or not best.is_file() else best)["state_dict"]
    encoder, heads, _ = build_parts(config, frozenset({"action_chunk"}))
    found = {key: head for key, head in heads.items() if isinstance(head, PolicyHead)}
    if len(found) != 1:
        raise ConfigError(f"{folder}: {len(found)} heads that act; one is needed")
    ((key, head),) = found.items()
    for module, prefix in ((encoder, "encoder."), (head, f"heads.{key}.")):
        own = {k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)}
        try:
            module.load_state_dict(own)
        except RuntimeError as error:
            raise ConfigError(f"{path}: the weights do not fit config.yaml: {error}") from error
    return Policy(encoder, head)


def _check_picture(what: str, picture: Any) -> None:
    """Raises a ConfigError unless a picture is uint8 (H, W, 3)."""
    shape, kind = np.shape(picture), getattr(picture, "dtype", type(picture).__name__)
    if kind != np.uint8 or len(shape) != 3 or shape[-1] != 3:
        raise ConfigError(f"{what}: {kind} {shape}; give RGB, uint8 (H, W, 3)")
