from dataclasses import replace

import numpy as np
import pytest
from matplotlib import pyplot

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.reading.figure import plot_recording


@pytest.fixture
def touch() -> Recording:
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 256, (20, 32, 32, 3), np.uint8)
    return Recording(
        key="one",
        sensor="digit",
        frames=ArrayFrames(frames),
        times=np.arange(20) / 30,
        no_contact=ArrayFrames(frames[:1]),
        force=rng.normal(size=(20, 3)).astype(np.float32),
        action=np.repeat([0, -1, 3, 2], 5),
        text="press a ball",
    )


def test_a_panel_for_everything_that_there_is(touch: Recording) -> None:
    figure = plot_recording(touch)
    assert [panel.get_ylabel() for panel in figure.axes] == [
        "frames",
        "minus background",
        "N",
    ]
    strip = figure.axes[0].images[0].get_array()
    assert strip is not None
    assert strip.shape == (32, 8 * 32, 3)
    curves = np.array([line.get_ydata() for line in figure.axes[2].lines])
    np.testing.assert_array_equal(curves.T, touch.force)
    spans = [(span.get_x(), span.get_x() + span.get_width()) for span in figure.axes[2].patches]  # type: ignore[attr-defined]
    np.testing.assert_allclose(
        spans, [(0, 4 / 30), (10 / 30, 14 / 30), (15 / 30, 19 / 30)], atol=2e-3
    )
    assert pyplot.get_fignums() == []


def test_the_background_is_grey_where_nothing_changes(touch: Recording) -> None:
    strip = plot_recording(touch).axes[1].images[0].get_array()
    assert strip is not None
    np.testing.assert_allclose(np.asarray(strip)[:, :32].mean(), 128, atol=1)


def test_a_still_without_labels(touch: Recording) -> None:
    bare = replace(touch.part(0, 1), no_contact=None, force=None, action=None, text=None)
    figure = plot_recording(bare)
    assert len(figure.axes) == 1
    figure.canvas.draw()
