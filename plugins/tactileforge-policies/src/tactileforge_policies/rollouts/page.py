"""The page of rollouts: success, failures, videos and forces."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from itertools import chain, zip_longest

import numpy as np
from markupsafe import Markup

from tactileforge.pages import (
    Section,
    Series,
    card,
    cards,
    facts,
    force_curves_figure,
    html_page,
    joined,
    legend,
    number,
    panel,
    panels,
    paragraph,
    percent,
    piece,
    table,
    verdict,
)
from tactileforge_policies.rollouts.results import EpisodeResult, wilson
from tactileforge_policies.rollouts.rollout import Rollouts

#: Colour classes of success and failure in figures.
_CLASSES = {True: 2, False: 1}
_AXES = ("x (shear)", "y (shear)", "z (normal)")
#: Largest number of episodes in the figures of forces.
_LINES = 100
_SIMULATED = (
    "Success in a simulation says how policies compare with each other in it; it is no proof for a "
    "robot."
)


def rollout_page(rollouts: Rollouts) -> str:
    """Builds the page as HTML.

    Args:
        rollouts: Outcome of `roll_out`.
    """
    options, made = rollouts.options, rollouts.facts
    sections = [
        Section("episodes", "Episodes", _episodes(rollouts)),
        Section("failures", "Failures", _failures(rollouts)),
        Section("forces", "Forces", _forces(rollouts.episodes)),
        Section("about", "About", _about(rollouts)),
    ]
    title = f"Rollouts: {options.word} by {made['policy']}"
    return html_page(title, _top(rollouts), sections)


def _top(rollouts: Rollouts) -> Markup:
    summary, made = rollouts.summary, rollouts.facts
    about = {
        "Success": f"{percent(summary.success)} ({summary.successes} of {summary.n})",
        "95 % interval": f"{percent(summary.low)} to {percent(summary.high)}",
        "Mean score": number(summary.score),
        "Policy": made["policy"],
        "Sensor": made["sensor"],
        "Steps a second": number(summary.steps_per_second),
    }
    return paragraph(made["instruction"]) + facts(about) + paragraph(_SIMULATED, soft=True)


def _episodes(rollouts: Rollouts) -> Markup:
    shown = chosen_episodes(rollouts.episodes, rollouts.options.shown)
    words = (
        f"{len(shown)} of {len(rollouts.episodes)}, failures and successes in turn: the camera, "
        f"and {' and '.join(rollouts.episodes[0].force)}. Below, the normal force on each finger."
    )
    names = legend(dict(enumerate(rollouts.episodes[0].force)))
    return paragraph(words, soft=True) + names + cards([_card(rollouts, e) for e in shown], rem=22)


def chosen_episodes(episodes: Sequence[EpisodeResult], count: int) -> list[EpisodeResult]:
    """Chooses ``count`` episodes, failures and successes in turn, ordered by seed."""
    failed = [episode for episode in episodes if not episode.success]
    done = [episode for episode in episodes if episode.success]
    mixed = [e for e in chain.from_iterable(zip_longest(failed, done)) if e is not None]
    return sorted(mixed[:count], key=lambda episode: episode.seed)


def _card(rollouts: Rollouts, episode: EpisodeResult) -> Markup:
    end = "success" if episode.success else episode.failure
    words = f"{episode.steps} steps, score {number(episode.score)}"
    return card(f"Seed {episode.seed}: {end}", _video(rollouts, episode) + _own(episode), words)


def _video(rollouts: Rollouts, episode: EpisodeResult) -> Markup:
    path = rollouts.options.folder / episode.video
    if not episode.video or not path.is_file():
        return paragraph("No video: this OpenCV writes no VP9.", soft=True)
    text = base64.b64encode(path.read_bytes()).decode()
    return piece("video", f"data:video/mp4;base64,{text}", f"episode of seed {episode.seed}")


def _own(episode: EpisodeResult) -> Markup:
    curves = [(_curve(episode, finger, 2), place) for place, finger in enumerate(episode.force)]
    words = f"normal force on {' and '.join(episode.force)} over time"
    return force_curves_figure(curves, "z (N)", words, height=1.6)


def _curve(episode: EpisodeResult, finger: str, axis: int) -> Series:
    return np.array(episode.times), np.array(episode.force[finger])[:, axis]


def _failures(rollouts: Rollouts) -> Markup:
    summary = rollouts.summary
    if not summary.failures:
        return verdict([("good", f"All {summary.n} episodes succeeded.")])
    rows = []
    for kind, count in summary.failures.items():
        seeds = [str(e.seed) for e in rollouts.episodes if e.failure == kind]
        more = f" and {len(seeds) - 8} more" if len(seeds) > 8 else ""
        low, high = wilson(count, summary.n)
        interval = f"{percent(low)} to {percent(high)}"
        rows.append((kind, str(count), interval, f"text|{', '.join(seeds[:8])}{more}"))
    head = ("Kind", "episodes", "share, 95 % interval", "text|seeds")
    return table("failures-table", head, rows, "A timeout is an episode that reached its limit.")


def _forces(episodes: Sequence[EpisodeResult]) -> Markup:
    names = {_CLASSES[True]: "success", _CLASSES[False]: "failure"}
    drawn = [
        panel(f"{finger}, {axis}", _overlaid(episodes[:_LINES], finger, place))
        for finger in episodes[0].force
        for place, axis in enumerate(_AXES)
    ]
    words = f"Force on each finger, in newton, of the first {min(len(episodes), _LINES)} episodes."
    return joined([paragraph(words, soft=True), legend(names), panels(drawn)])


def _overlaid(episodes: Sequence[EpisodeResult], finger: str, axis: int) -> Markup:
    curves = [(_curve(e, finger, axis), _CLASSES[e.success]) for e in episodes]
    words = f"force {'xyz'[axis]} on {finger} over time, an episode a line"
    return force_curves_figure(curves, f"{'xyz'[axis]} (N)", words)


def _about(rollouts: Rollouts) -> Markup:
    return table("about-table", ("Key", "text|value"), list(_rows(rollouts)))


def _rows(rollouts: Rollouts) -> Iterator[tuple[str, str]]:
    for key, value in rollouts.facts.items():
        if key != "instruction" and value not in (None, {}):
            yield key, f"text|{value}"
    yield "ms of an action", f"text|{number(rollouts.summary.act_ms)}"
    yield "results", f"text|{rollouts.options.folder / 'results.json'}"
