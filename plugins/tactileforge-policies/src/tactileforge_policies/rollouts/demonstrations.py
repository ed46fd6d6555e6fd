"""Demonstrations: episodes of the scripted expert as shards, one file per episode."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.data import (
    ArrayFrames,
    Index,
    IndexEntry,
    Packed,
    describe_recording,
    encode_image,
    keep_whole,
    write_shard,
)
from tactileforge.errors import DataError, TactileForgeError
from tactileforge.plugins import (
    Bar,
    claim_folder,
    one_thread,
    process_count,
    run_share,
    sealed,
    spread,
    unsealed,
    write_text,
)
from tactileforge_policies.reference import GAIN_LABEL, reference_gain
from tactileforge_policies.rollouts.actors import Expert
from tactileforge_policies.rollouts.episode import Episode, play_episode
from tactileforge_policies.rollouts.options import DemonstrationOptions, make_environment

#: File of the options that the folder was made with.
MADE = "demonstrations.json"
#: Tier of each task in the tactile dynamic pyramid.
_TIERS = {"grasp": 5, "wipe": 4, "insert": 2, "chip": 1}
#: Number of missing episodes from which on more processes are worth their start.
_MANY = 4
_NONE = ArrayFrames(np.zeros((1, 1, 1, 3), np.uint8))


@dataclass(frozen=True)
class WrittenDemonstrations:
    """The outcome of `write_demonstrations`.

    Attributes:
        episodes: Number of stored episodes.
        failed: Kind of failure of the episodes left out, by seed.
    """

    episodes: int
    failed: dict[int, str]


def write_demonstrations(options: DemonstrationOptions) -> WrittenDemonstrations:
    """Writes episodes until there are enough; a killed command resumes where it stopped.

    Args:
        options: Task, number of episodes and folder.

    Raises:
        ConfigError: The folder holds different demonstrations.
        TactileForgeError: The expert fails in more than half of the episodes.
    """
    make_environment(options.of_unit(0)).close()  # errors in options show before processes start
    folder = Path(options.out)
    claim_folder(folder / MADE, _made(options), "demonstrations")
    keep_whole(sorted(folder.glob("episode-*.tar")))
    _forget_damaged(folder)
    tried = 0
    with Bar(total=options.n, desc="demonstrations", unit="episode") as bar:
        while (kept := len(_kept(folder, tried))) < options.n:
            if tried > 2 * options.n + 10:
                raise TactileForgeError(
                    f"task={options.task}: the expert failed in {tried - kept} of {tried} episodes "
                    f"({_kinds(_failed(folder, options, tried))}); change env= or limit="
                )
            numbers = range(tried, tried + options.n - kept)
            _play(options, folder, [n for n in numbers if not _done(folder, n)], bar)
            tried = numbers.stop
        bar.update(options.n - int(bar.n))
    return _index(options, folder, tried)


def _forget_damaged(folder: Path) -> None:
    """Removes damaged notes of failures; their episodes are then played again."""
    for path in folder.glob("failed/*.json"):
        try:
            unsealed(path.read_bytes())["failure"]
        except (ValueError, KeyError):
            path.unlink()


def _play(options: DemonstrationOptions, folder: Path, numbers: Sequence[int], bar: Any) -> None:
    count = process_count(len(numbers), options.processes)
    if count > 1 and len(numbers) >= _MANY:
        spread(
            [__name__, json.dumps(asdict(options))],
            numbers,
            count,
            lambda n: _path(folder, n).exists(),
            bar,
        )
        return
    _write(options, numbers, lambda: bar.update())


def _write(
    options: DemonstrationOptions, numbers: Iterable[int], told: Callable[[], object]
) -> None:
    """Plays episodes and writes each as a shard, or a note of its failure."""
    folder, expert = Path(options.out), Expert()
    envs: dict[Any, Any] = {}
    with one_thread():  # sums do not depend on the number of cores: same bytes on any machine
        for number in numbers:
            played = options.of_unit(number)
            unit = played.env.get("unit")
            if unit not in envs:
                envs[unit] = make_environment(played)
            env = envs[unit]
            episode = play_episode(env, expert, options.episode_seed(number), options.noise)
            if episode.success:
                packed = pack_episode(episode, env, f"{options.word}_{number:05d}", options)
                write_shard(_path(folder, number), packed)
                told()
            else:
                write_text(_failure(folder, number), sealed({"failure": episode.failure}))
    for env in envs.values():
        env.close()


def pack_episode(
    episode: Episode, env: Any, name: str, options: DemonstrationOptions
) -> list[Packed]:
    """Packs one recording per finger; the first has the camera, all have state and actions.

    Args:
        episode: Episode of T steps; T frames are stored, each before the action of its step.
        env: Environment of the episode.
        name: Name of the episode.
        options: Options of the demonstrations.
    """
    plain = env.unwrapped
    # An episode has one more observation than actions; the last one has no command, and is dropped.
    steps = len(episode.actions)
    times = episode.times[:steps]
    tracks = {
        "state": episode.seen("state")[:steps].astype(np.float32),
        "robot_action": np.stack(episode.actions).astype(np.float32),
    }
    labels = {"episode": name, "task": plain.task}
    numbers = {"seed": float(episode.seed), "success": float(episode.success)}
    gains = _gains(episode, plain)
    out = []
    for place, finger in enumerate(episode.fingers):
        about = Recording(
            key=f"{name}/{finger}",
            sensor=plain.sensor,
            frames=_NONE,
            times=times,
            no_contact=None,
            force=episode.force_of(finger)[:steps],
            text=plain.instruction,
            image_times=times if place == 0 else None,
            labels={**labels, "finger": finger, **numbers, **gains.get(finger, {})},
            tracks=tracks,
            source="simulated by tactileforge",
            tier=_TIERS.get(options.word, 5),
            licence="CC0-1.0",
        )
        views = [*episode.seen("image")[:steps]] if place == 0 else []
        out.append(
            Packed(
                describe_recording(about),
                options.codec,
                _encoded(episode.seen(finger)[:steps], options.codec),
                _encoded([episode.background[finger]], options.codec),
                _encoded(views, options.codec),
            )
        )
    return out


def _gains(episode: Episode, plain: Any) -> dict[str, dict[str, float]]:
    """Label of the reference press, by finger; none without ``reference()`` or on a faint press."""
    pressed = plain.reference() if hasattr(plain, "reference") else {}
    try:
        return {
            finger: {GAIN_LABEL: reference_gain(episode.background[finger], press, finger)}
            for finger, press in pressed.items()
        }
    except DataError as error:
        # demonstrations are of use without it; training refuses those by name that need it
        warnings.warn(f"no label {GAIN_LABEL}: {error}", stacklevel=2)
        return {}


def _encoded(pictures: Any, codec: str) -> list[bytes]:
    return [encode_image(picture, codec) for picture in pictures]


def _index(options: DemonstrationOptions, folder: Path, tried: int) -> WrittenDemonstrations:
    """Writes the index, all as ``train``; ``data=demonstrations`` draws the validation split."""
    entries = [IndexEntry.of(_path(folder, n)) for n in _kept(folder, tried)]
    failed = _failed(folder, options, tried)
    made = {**_made(options), "failed": {str(seed): kind for seed, kind in failed.items()}}
    Index(f"{options.word}_demonstrations", {"train": entries, "val": []}, made=made).save(folder)
    return WrittenDemonstrations(len(entries), failed)


def _path(folder: Path, number: int) -> Path:
    return folder / f"episode-{number:05d}.tar"


def _failure(folder: Path, number: int) -> Path:
    return folder / "failed" / f"{number:05d}.json"


def _done(folder: Path, number: int) -> bool:
    return _path(folder, number).exists() or _failure(folder, number).exists()


def _kept(folder: Path, tried: int) -> list[int]:
    return [n for n in range(tried) if _path(folder, n).exists()]


def _failed(folder: Path, options: DemonstrationOptions, tried: int) -> dict[int, str]:
    paths = {options.episode_seed(n): _failure(folder, n) for n in range(tried)}
    return {
        seed: unsealed(path.read_bytes())["failure"]
        for seed, path in paths.items()
        if path.exists()
    }


def _kinds(failed: dict[int, str]) -> str:
    kinds = list(failed.values())
    return ", ".join(f"{kind} {kinds.count(kind)}" for kind in sorted(set(kinds)))


def _made(options: DemonstrationOptions) -> dict[str, Any]:
    """Options with effect on the bytes: all but the folder and the number of processes."""
    return {k: v for k, v in asdict(options).items() if k not in ("out", "processes")}


if __name__ == "__main__":
    run_share(DemonstrationOptions, _write)
