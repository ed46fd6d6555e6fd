"""Steps per second of the four tasks, on one thread, and success of the expert and of a replay.

Episodes of the scripted expert on several sensors, 64 pixels; the time of a step includes the
search for the equilibrium, both frames and the third-person view. ``--replays N`` also moves the
gripper along the expert's path of another episode: the success of a policy without feedback.
``--picture FILE`` draws an episode of each task.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import cv2
import gymnasium
import numpy as np
import torch
from common import save
from numpy.typing import NDArray
from tactileforge_policies import envs

SENSORS = ("digit", "gelsight_mini", "duragel")


def episode(env: gymnasium.Env[Any, Any], seed: int, way: list[Any] | None = None) -> Any:
    """An episode of the expert, or along the states of another: last info, and observations."""
    seen, info = env.reset(seed=seed)
    plain: Any = env.unwrapped
    act, shown, over = plain.expert(), [seen], False
    while not over:
        action = act(seen)
        if way is not None:
            goal = way[min(len(shown), len(way) - 1)]["state"]
            action = np.clip(goal - seen["state"], env.action_space.low, env.action_space.high)  # type: ignore[attr-defined]
        seen, _, ended, cut, info = env.step(action)
        shown.append(seen)
        over = ended or cut
    return info, shown


def speed(task: str, sensor: str, episodes: int, first: int) -> dict[str, Any]:
    """Speed and success of the expert."""
    env = gymnasium.make(envs.env_id(task), sensor=sensor)
    episode(env, first)  # warm-up: kernels and units are computed once
    steps, won, start, wall = 0, 0, time.process_time(), time.perf_counter()
    for seed in range(first, first + episodes):
        info, shown = episode(env, seed)
        steps, won = steps + len(shown) - 1, won + info["success"]
    spent, passed = time.process_time() - start, time.perf_counter() - wall
    return {
        "task": task,
        "sensor": sensor,
        "episodes": episodes,
        "success": won,
        "steps": steps,
        "steps_per_cpu_second": round(steps / spent, 1),
        "steps_per_second": round(steps / passed, 1),
    }


def replays(task: str, count: int) -> dict[str, Any]:
    """Success of the expert's path replayed in other episodes."""
    env = gymnasium.make(envs.env_id(task), size=16)
    plain: Any = env.unwrapped
    blank = {name: np.zeros((16, 16, 3), np.uint8) for name in plain.fingers}
    # A replay ignores the frames: blank ones save their rendering.
    plain._fingers.pictures = lambda moment: {name: one.copy() for name, one in blank.items()}
    ends = [episode(env, 2000 + s, episode(env, 1000 + s)[1])[0] for s in range(count)]
    return {
        "task": task,
        "replays": count,
        "success": sum(one["success"] for one in ends),
        "score": round(float(np.mean([one["score"] for one in ends])), 2),
    }


def picture(path: Path, columns: int = 5) -> None:
    """Draws one episode a row: third-person view and right finger, at even times."""
    rows = []
    for task in envs.TASKS:
        _, shown = episode(gymnasium.make(envs.env_id(task), size=96), 3)
        picked = [shown[i] for i in np.linspace(0, len(shown) - 1, columns).astype(int)]
        cells: list[NDArray[np.uint8]] = [
            np.concatenate([one["image"], one["right"], np.full((96, 4, 3), 255, np.uint8)], 1)
            for one in picked
        ]
        rows += [np.concatenate(cells, 1), np.full((4, columns * 196, 3), 255, np.uint8)]
    cv2.imwrite(str(path), np.concatenate(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])


def main() -> None:
    """Runs the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--replays", type=int, default=0)
    parser.add_argument("--sensors", nargs="*", default=SENSORS)
    parser.add_argument("--tasks", nargs="*", default=list(envs.TASKS))
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--name", default="envs")
    args = parser.parse_args()
    torch.set_num_threads(1)
    if args.picture:
        picture(args.picture)
        return
    rows = [speed(t, s, args.episodes, args.first) for t in args.tasks for s in args.sensors]
    rows += [replays(task, args.replays) for task in args.tasks if args.replays]
    save(args.name, {"rows": rows})


if __name__ == "__main__":
    main()
