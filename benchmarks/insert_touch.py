"""Perception against control in Insert, from the hidden state of its demonstrations.

Perception: what the frozen encoder, pictures and forces say of the plug's tilt, of the load of the
rim and of the way to the socket, by ridge regression on steps with the tongue on the rim; each
episode is predicted by a fit without it, with the penalty that does so best. Control: the
regression of the table on numbers of the hidden state in place of pictures, rolled out from the
same starts.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from common import save
from numpy.typing import NDArray
from reference_press import left_out, scaled
from tactileforge_policies.envs.insert import LONG
from tactileforge_policies.envs.outer import placed
from tactileforge_policies.rollouts.options import DemonstrationOptions, make_environment
from torch import Tensor, nn

import tactileforge
from tactileforge.data import take_steps

Array = NDArray[np.float32]
FINGERS = ("left", "right")
#: Steps of a clip, commands of a chunk, and those carried out, as in the recipe.
CLIP, CHUNK, EXECUTE = 4, 8, 2
NOISE = 0.1
#: Parts of the hidden state, by the name of the inputs.
INPUTS = {
    "tilt, slide, load, depth": ("tilt", "slide", "load", "depth"),
    "tilt, slide, load, depth, side of the socket": ("tilt", "slide", "load", "depth", "side"),
}


@dataclass
class Played:
    """Steps of an episode of the expert: pictures, and numbers by name."""

    rest: dict[str, NDArray[np.uint8]]
    pictures: dict[str, list[NDArray[np.uint8]]] = field(default_factory=dict)
    numbers: dict[str, list[Array]] = field(default_factory=dict)

    def of(self, name: str) -> Array:
        """Numbers of all steps, (T, columns)."""
        return np.stack(self.numbers[name])


def state_of(env: Any, observation: Any) -> dict[str, Array]:
    """Visible and hidden numbers of this moment."""
    plain = env.unwrapped
    tip = placed(np.array([[0.0, LONG]]), plain.object)[0, 0]
    force = plain.wrench()
    found = {
        "state": observation["state"],
        "force": np.concatenate([force[name] for name in FINGERS]),
        "tilt": [plain.held.pose[2]],
        "slide": plain.held.pose[:2],
        "load": [plain.load(plain.sockets)],
        "depth": [plain.depth],
        "side": [np.sign(plain.to - tip)],
    }
    return {name: np.array(value, np.float32) for name, value in found.items()}


def play(count: int) -> list[Played]:
    """Successful episodes of the expert, as ``demos`` plays them."""
    options = DemonstrationOptions(task="insert", out="", n=count)
    env, number = make_environment(options), 0
    episodes: list[Played] = []
    while len(episodes) < count:
        seed = options.episode_seed(number)
        number += 1
        seen, info = env.reset(seed=seed)
        expert, noise = env.unwrapped.expert(), np.random.default_rng(seed)
        episode, ended = Played(env.unwrapped.background()), False
        while not ended:
            action = np.clip(expert(seen), env.action_space.low, env.action_space.high)
            for name, value in (state_of(env, seen) | {"action": action}).items():
                episode.numbers.setdefault(name, []).append(value)
            for name in FINGERS:
                episode.pictures.setdefault(name, []).append(seen[name])
            pushed = NOISE * env.action_space.high * noise.standard_normal(3, np.float32)
            seen, _, failed, late, info = env.step(
                np.clip(action + pushed, env.action_space.low, env.action_space.high)
            )
            ended = failed or late
        if info["success"]:
            episodes.append(episode)
    return episodes


def windows(values: NDArray[Any], length: int) -> NDArray[Any]:
    """The last ``length`` rows up to each; before the first, copies of it."""
    return take_steps(values, np.arange(len(values))[:, None] + np.arange(1 - length, 1))[0]


def features(episodes: list[Played]) -> dict[str, Tensor]:
    """Features of the steps on the rim, by name, float32 (steps, columns)."""
    encoder = tactileforge.load("anytouch2.tiny").encoder.eval()
    rows: dict[str, list[Tensor]] = {}
    for episode in episodes:
        tokens, coarse, rim = [], [], on_rim(episode)
        if not rim.any():
            continue
        for name in FINGERS:
            clips = windows(np.stack(episode.pictures[name]), CLIP)[rim]
            tokens.append(encoded(encoder, clips, episode.rest[name]))
            change = clips.astype(np.float32) - episode.rest[name]
            size = change.shape[2] // 8
            cells = change.reshape(len(change), CLIP, 8, size, 8, size, 3).mean((3, 5))
            coarse += [torch.from_numpy(part).flatten(1) for part in (cells[:, -1], cells[:, 0])]
        forces = windows(episode.of("force"), CLIP)[rim].reshape(len(clips), -1)
        state = windows(episode.of("state"), 2)[rim].reshape(len(clips), -1)
        hidden = [episode.of(name)[rim] for name in ("tilt", "slide", "load", "depth")]
        for name, part in (
            ("AnyTouch 2 (tiny), all tokens", torch.cat(tokens, 1)),
            ("8 x 8 difference, first and last frame", torch.cat(coarse, 1)),
            ("forces of four steps", torch.from_numpy(forces)),
            ("gripper's place and opening", torch.from_numpy(state)),
            ("hidden tilt, slide, load and depth", torch.from_numpy(np.concatenate(hidden, 1))),
        ):
            rows.setdefault(name, []).append(part)
    return {name: torch.cat(parts).float() for name, parts in rows.items()}


def on_rim(episode: Played) -> NDArray[np.bool_]:
    """Steps with the tongue on the rim of the second socket; the first lies behind."""
    above = episode.of("depth")[:, 0] < 1.0  # deeper, the expert no longer feels its way sideways
    near = episode.of("state")[:, 0] > 14.0
    return np.asarray((episode.of("load")[:, 0] > 0) & above & near)


@torch.no_grad()
def encoded(encoder: Any, clips: NDArray[np.uint8], rest: NDArray[np.uint8]) -> Tensor:
    """All tokens of each clip, side by side, float32 (steps, columns)."""
    still = torch.from_numpy(rest).movedim(-1, 0)
    out = []
    for part in torch.split(torch.from_numpy(clips).movedim(-1, -3), 32):
        sensor = encoder.sensor_ids(["digit"] * len(part))
        out.append(encoder(part, still.expand(len(part), -1, -1, -1), sensor)[0].flatten(1))
    return torch.cat(out)


def scores(known: Tensor, truth: Tensor, episode: Tensor) -> dict[str, float]:
    """R2 of tilt, load and sideways command, and how often the command's side is right."""
    guesses = left_out(scaled(known), truth, episode)
    lost = ((guesses - truth) ** 2).sum(1) / ((truth - truth.mean(0)) ** 2).sum(0)
    best = lost.argmin(0)
    found = {
        f"{name}_r2": round(1 - float(lost[best[column], column]), 3)
        for column, name in enumerate(("tilt", "load", "aside"))
    }
    side = guesses[best[2], :, 2].sign() == truth[:, 2].sign()
    return found | {"side": round(float(side.double().mean()), 3)}


def perception(episodes: list[Played]) -> dict[str, Any]:
    """Scores of each kind of features for the hidden state, with the tongue on the rim."""
    rims = [on_rim(one) for one in episodes]
    tilt, load, action = (
        torch.from_numpy(
            np.concatenate([one.of(name)[rim] for one, rim in zip(episodes, rims, strict=True)])
        )
        for name in ("tilt", "load", "action")
    )
    truth = torch.cat([tilt, load, action[:, :1]], 1).double()
    number = torch.cat([torch.full((int(rim.sum()),), i) for i, rim in enumerate(rims)])
    found = {name: scores(row, truth, number) for name, row in features(episodes).items()}
    return {"steps": len(truth), "tilt_rad": float(truth[:, 0].std()), "features": found}


def inputs(moment: dict[str, Array], names: tuple[str, ...]) -> Array:
    """The robot's state, and hidden numbers by name."""
    return np.concatenate([moment[name] for name in ("state", *names)])


class Clone:
    """Regression of chunks on the numbers of two steps, as in the recipe ``imitation``."""

    def __init__(self, episodes: list[Played], names: tuple[str, ...], epochs: int = 60) -> None:
        torch.manual_seed(0)
        self.names = names
        rows, chunks, valid = [], [], []
        for one in episodes:
            numbers = np.concatenate([one.of(name) for name in ("state", *names)], 1)
            rows.append(windows(numbers, 2).reshape(len(numbers), -1))
            ahead = np.arange(len(numbers))[:, None] + np.arange(CHUNK)
            chunk, inside = take_steps(one.of("action"), ahead)
            chunks.append(chunk)
            valid.append(inside)
        known, wanted, kept = (
            torch.from_numpy(np.concatenate(part)) for part in (rows, chunks, valid)
        )
        self.seen = known.amin(0), (known.amax(0) - known.amin(0)).clamp(min=1e-6)
        self.done = wanted.amin((0, 1)), (wanted.amax((0, 1)) - wanted.amin((0, 1))).clamp(min=1e-6)
        out = CHUNK * wanted.shape[-1]
        self.net = nn.Sequential(
            *(nn.Linear(known.shape[1], 256), nn.GELU(), nn.Linear(256, 256), nn.GELU()),
            nn.Linear(256, out),
        )
        optimiser = torch.optim.AdamW(self.net.parameters(), 1e-3, weight_decay=1e-6)
        steps = epochs * (len(known) // 32)
        rate = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
        target = (wanted - self.done[0]) / self.done[1]
        for _ in range(epochs):
            for some in torch.split(torch.randperm(len(known)), 32)[: len(known) // 32]:
                error = (self.predicted(known[some]) - target[some]).abs().mean(-1)
                loss = (error * kept[some]).sum() / kept[some].sum()
                optimiser.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                optimiser.step()
                rate.step()

    def predicted(self, known: Tensor) -> Tensor:
        """Commands from 0 to 1, (B, CHUNK, 3)."""
        out: Tensor = self.net(2 * (known - self.seen[0]) / self.seen[1] - 1)
        return out.view(len(known), CHUNK, -1)

    @torch.no_grad()
    def chunk(self, before: Array, now: Array) -> list[Array]:
        """Commands to carry out, (3,) each."""
        found = self.predicted(torch.from_numpy(np.concatenate([before, now]))[None])[0]
        return list((self.done[0] + found.clamp(0, 1) * self.done[1]).numpy()[:EXECUTE])


def rolled(clone: Clone, count: int) -> dict[str, Any]:
    """Successes and failures by kind, from the starts of the table."""
    env = make_environment(DemonstrationOptions(task="insert", out=""))
    kinds: Counter[str] = Counter()
    for seed in range(count):
        seen, info = env.reset(seed=seed)
        before, queue, ended = None, list[Array](), False
        while not ended:
            now = inputs(state_of(env, seen), clone.names)
            queue = queue or clone.chunk(now if before is None else before, now)
            before = now
            seen, _, failed, late, info = env.step(queue.pop(0))
            ended = failed or late
        kinds["success" if info["success"] else info["failure"]] += 1
    return {"of": count, "successes": kinds.pop("success", 0), "failures": dict(kinds)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--rollouts", type=int, default=20)
    words = parser.parse_args()
    torch.set_num_threads(1)
    episodes = play(words.episodes)
    found: dict[str, Any] = {"episodes": words.episodes, "perception": perception(episodes)}
    print(found, flush=True)
    save("manipulation_insert", found)
    found["control"] = {}
    for title, names in INPUTS.items():
        found["control"][title] = rolled(Clone(episodes, names), words.rollouts)
        print(title, found["control"][title], flush=True)
        save("manipulation_insert", found)


if __name__ == "__main__":
    main()
