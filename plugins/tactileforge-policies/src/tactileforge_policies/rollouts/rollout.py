"""Rollouts of a policy: episodes with fixed seeds, their results, videos and page."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tactileforge.plugins import Bar, claim_folder, one_thread, process_count, run_share, spread
from tactileforge_policies.rollouts.actors import SCRIPTED, fingerprint, make_actor
from tactileforge_policies.rollouts.episode import Episode, play_episode
from tactileforge_policies.rollouts.options import RolloutOptions, make_environment
from tactileforge_policies.rollouts.results import EpisodeResult, Summary, write_results
from tactileforge_policies.rollouts.video import episode_frames, write_video

#: File of the options that the folder was made with.
MADE = "rollout.json"
RESULTS = "results.json"
PAGE = "report.html"
#: Number of missing episodes from which on more processes are worth their start.
_MANY = 4
#: Options without effect on an episode; the policy is identified by its weights instead.
_FREE = ("out", "processes", "n", "shown", "policy")


@dataclass(frozen=True)
class Rollouts:
    """The outcome of `roll_out`.

    Attributes:
        options: Options of the rollouts.
        facts: Options with effect on episodes, hash of the weights, and instruction of the task.
        episodes: Results in the order of their seeds.
        summary: Summary of the episodes.
    """

    options: RolloutOptions
    facts: dict[str, Any]
    episodes: Sequence[EpisodeResult]
    summary: Summary


def roll_out(options: RolloutOptions) -> Rollouts:
    """Plays the missing episodes, and writes ``results.json``.

    Raises:
        ConfigError: Policy and task do not match, or the folder holds different rollouts.
        TactileForgeError: A process failed.
    """
    folder = options.folder
    made = _made(options)
    env = make_environment(options)
    # Built here once, so that errors show before processes start and before anything is written.
    make_actor(options.policy, env, options.cross_sensor)
    made["instruction"] = env.unwrapped.instruction
    env.close()
    claim_folder(folder / MADE, made, "rollouts")
    missing = [n for n in range(options.n) if not _path(folder, n).exists()]
    with Bar(total=options.n, initial=options.n - len(missing), unit="episode") as bar:
        bar.set_description(f"{options.word}, {Path(options.policy).name}")
        _play(options, missing, bar)
    episodes = [EpisodeResult.load(_path(folder, n)) for n in range(options.n)]
    rollouts = Rollouts(options, made, episodes, Summary.of(episodes))
    write_results(folder / RESULTS, made, rollouts.summary, episodes)
    return rollouts


def _play(options: RolloutOptions, numbers: Sequence[int], bar: Any) -> None:
    count = process_count(len(numbers), options.processes)
    if count > 1 and len(numbers) >= _MANY:
        command = [__name__, json.dumps(asdict(options))]
        spread(command, numbers, count, lambda n: _path(options.folder, n).exists(), bar)
        return
    _write(options, numbers, bar.update)


def _write(options: RolloutOptions, numbers: Iterable[int], told: Callable[[], object]) -> None:
    """Plays episodes, and writes the video and then the result of each."""
    env = make_environment(options)
    with one_thread():  # sums do not depend on the number of cores: same results on any machine
        actor = make_actor(options.policy, env, options.cross_sensor)
        for number in numbers:
            episode = play_episode(env, actor, options.episode_seed(number))
            video = f"videos/{number:05d}.mp4"
            seen = write_video(options.folder / video, episode_frames(episode), episode.rate)
            # The result is written last, as its file marks the episode as done.
            result_of(episode, video if seen else "").save(_path(options.folder, number))
            told()
    env.close()


def result_of(episode: Episode, video: str = "") -> EpisodeResult:
    """Result of an episode; forces are rounded to 0.1 mN."""
    return EpisodeResult(
        seed=episode.seed,
        success=episode.success,
        score=episode.score,
        failure=episode.failure,
        steps=len(episode.actions),
        seconds=episode.seconds,
        act_seconds=sum(episode.act_seconds),
        times=episode.times.tolist(),
        force={
            finger: episode.force_of(finger).astype(float).round(4).tolist()
            for finger in episode.fingers
        },
        video=video,
    )


def _path(folder: Path, number: int) -> Path:
    return folder / "episodes" / f"{number:05d}.json"


def _made(options: RolloutOptions) -> dict[str, Any]:
    """Options with effect on the results; a policy is identified by a hash of its weights."""
    plain = {k: v for k, v in asdict(options).items() if k not in _FREE}
    weights = fingerprint(options.policy)
    name = options.policy if options.policy in SCRIPTED else Path(options.policy).name
    return {"policy": name, "weights": weights, **plain}


if __name__ == "__main__":
    run_share(RolloutOptions, _write)
