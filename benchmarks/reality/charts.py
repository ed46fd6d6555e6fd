"""Charts of simulated beside real touches, in the style of the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import FuncFormatter, LogLocator

from reality import measures
from reality.profiles import Profile
from tactileforge.pages import CLASSES, INK, drawing, svg
from tactileforge.pages.figures import SHADE


def spectra_chart(profiles: Sequence[Profile]) -> Markup:
    """Median spectrum of each source relative to its lowest frequencies; the first is black.

    Args:
        profiles: Profiles of the sources, the simulated one first.
    """
    with drawing(5.2, 3.2) as (figure, axes):
        for start in measures.BANDS:
            axes.axvline(start, color=SHADE, linewidth=1.0)
        for number, profile in enumerate(profiles):
            power = profile.of("spectrum")
            low = np.nanmean(power[:, measures.RINGS < measures.LOW], axis=1, keepdims=True)
            level = np.median(np.log10(np.maximum(power, 1e-9) / low), axis=0)
            axes.plot(measures.RINGS, level, color=_colour(number), linewidth=_width(number))
        axes.set(xlabel="cycles per pixel", ylabel="log10 of power", xlim=(0, 0.5))
        return svg(figure, "power of the difference image over frequency, simulated and real")


def touches_chart(profiles: Sequence[Profile]) -> Markup:
    """Contrast against contact area, one point per touch.

    Args:
        profiles: Profiles of the sources, the simulated one first.
    """
    with drawing(5.2, 3.2) as (figure, axes):
        for number, profile in reversed(list(enumerate(profiles))):
            style = {"color": _colour(number), "markersize": 4, "markeredgewidth": 0}
            axes.plot(100 * profile.of("area"), profile.of("contrast"), "o", alpha=0.7, **style)
        axes.set(xscale="log", xlabel="contact, share of the image (%)")
        axes.set(yscale="log", ylabel="change in contact (grey levels)")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(FuncFormatter(lambda value, _: ""))
        return svg(figure, "contrast against contact area of touches, simulated and real")


def _colour(number: int) -> str:
    return CLASSES[(number - 1) % len(CLASSES)][0] if number else INK


def _width(number: int) -> float:
    return 1.4 if number else 2.4
