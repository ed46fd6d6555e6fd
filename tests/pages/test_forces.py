"""Figures of force."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.pages.figures import drawing
from tactileforge.pages.forces import (
    agreement_figure,
    draw_recording,
    prediction_figure,
    recording_figure,
)
from tactileforge.pages.text_tables import align_columns, markdown_table


@pytest.fixture
def press() -> Recording:
    times = np.arange(1000) / 100
    force = np.stack([np.full(1000, np.nan), np.sin(times), 0.01 * np.cos(times)], 1)
    frames = ArrayFrames(np.zeros((1000, 1, 1, 3), np.uint8))
    action = np.repeat([0, 2], 500)
    return Recording(
        key="a",
        sensor="digit",
        frames=frames,
        no_contact=None,
        times=times,
        force=force.astype(np.float32),
        action=action,
    )


def lengths(svg: str, stroke: str) -> list[int]:
    """Points of each path of a colour; a gap or a dot begins anew."""
    paths = re.findall(rf'<path d="([^"]+)"[^>]*stroke: {re.escape(stroke)}', svg)
    return [len(re.findall("[ML]", path)) for path in paths]


def test_force_over_time_is_a_line_each_axis_of_at_most_400_samples(press: Recording) -> None:
    with drawing(4, 2) as (_, axes):
        draw_recording(axes, press)
        drawn = [np.array(line.get_xydata()) for line in axes.lines]
        low, high = axes.get_ylim()
    assert [line.shape for line in drawn] == [(400, 2)] * 3
    assert np.isnan(drawn[0][:, 1]).all()
    np.testing.assert_allclose(drawn[1][:, 1], np.sin(drawn[1][:, 0]), atol=1e-6)
    assert (drawn[1][0, 0], drawn[1][-1, 0]) == (press.times[0], press.times[-1])
    assert low < -1 < 1 < high


def test_noise_does_not_fill_the_panel(press: Recording) -> None:
    assert press.force is not None
    quiet = replace(press, force=0.001 * press.force)
    with drawing(4, 2) as (_, axes):
        draw_recording(axes, quiet)
        low, high = axes.get_ylim()
    assert high - low == pytest.approx(0.2, abs=1e-3)


def test_stretches_of_an_action_are_named_where_there_is_room(press: Recording) -> None:
    svg = recording_figure(press, [0.0])
    assert svg.count("var(--shade)") == 2
    assert ">press<" in svg
    assert 'aria-label="force over time"' in svg
    assert 'aria-label="actions over time"' in recording_figure(replace(press, force=None), [])


def test_every_point_is_drawn_in_the_colour_and_shape_of_its_class() -> None:
    truth = np.linspace(-1, 1, 21)
    classes = np.array([0] * 10 + [1] * 5 + [6] * 6)  # the seventh class has another shape
    svg = agreement_figure([(truth, truth**2, classes, 0.9)], ("measured (N)", "predicted (N)"))
    assert lengths(svg, "var(--c0)") == [20]  # a dot is a short line: two points
    assert lengths(svg, "var(--c1)") == [10]
    assert svg.count("<use") >= 6
    assert 'aria-label="predicted (N) against measured (N)"' in svg


def test_predictions_beyond_the_limits_lie_on_the_edge() -> None:
    truth = np.linspace(-1, 1, 5)
    group = (truth, 100 * truth, np.zeros(5, np.int64), 0.9)
    svg = agreement_figure([group], ("true", "predicted"), limits=(-1.0, 1.0), words="r 1.00")
    (dots,) = re.findall(r'<path d="([^"]+)"[^>]*stroke: var\(--c0\)', svg)
    heights = [float(y) for y in re.findall(r"M [\d.]+ ([\d.]+)", dots)]
    assert heights[0] == heights[1] > heights[2] > heights[3] == heights[4]
    assert ">r 1.00<" in svg


def test_a_prediction_lies_over_every_part_of_what_was_measured() -> None:
    first, second = np.arange(3.0), np.arange(5.0, 9.0)
    svg = prediction_figure(
        [(first, first), (second, second)], {"val": (second, second + 0.1)}, "z"
    )
    assert lengths(svg, "currentColor")[-2:] == [3, 4]
    assert ">z (N)<" in svg


def test_a_markdown_table_is_padded_where_its_source_is_read() -> None:
    rows = [("task", "R2"), ("force", "0.9")]
    assert markdown_table(rows) == "| task | R2 |\n|---|---|\n| force | 0.9 |"
    assert markdown_table(rows, right={1}, aligned=True).splitlines() == [
        "| task  |  R2 |",
        "|-------|----:|",
        "| force | 0.9 |",
    ]
    assert align_columns([*rows, ("x", "")]) == "task   R2\nforce  0.9\nx"
