"""Base of data sets with the usual figure of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactileforge.contracts import Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Drawn:
    """Adds the figure of a recording to a data set."""

    def plot(self, recording: Recording) -> Figure:
        """A figure of a recording: frames, frames less the background, forces, actions."""
        # imported here: matplotlib takes a second, and training draws no figure
        from tactileforge.reading.figure import plot_recording

        return plot_recording(recording)
