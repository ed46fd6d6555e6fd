"""The page of a comparison: images, spectra and measures of simulated and real touches."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from markupsafe import Markup

from reality import charts
from reality.compare import Side
from reality.measures import Array
from reality.profiles import DISTANCES, Profile, correlations
from reality.touches import StrongestTouch
from tactileforge.pages import (
    NONE,
    Section,
    amplified_difference,
    figure,
    heading,
    html_page,
    joined,
    legend,
    number,
    panel,
    panels,
    paragraph,
    table,
    verdict,
)
from tactileforge.pages.page import group_name, stack

#: Gain of the amplified difference images, the same everywhere.
_GAIN = 4.0
#: Threshold of a far distance, as a ratio to the distance between real sources.
_FAR = 1.5
_METHOD = """
A touch is the frame that differs most from the picture without contact, and its change is the
difference of the two. All pictures are averaged down to 240 pixels on their shorter side.
"""
_CONFOUNDED = """
Real pictures went through a camera and a codec before they were measured, and both change what is
compared. H.264 and MPEG-4 remove fine detail and most of the noise of a still picture, repeat
blocks from frame to frame, and halve the resolution of colour: the noise and the detail of a video
are lower bounds. JPEG adds blocks of 8 pixels and removes what its quality asks for. The palette of
a GIF adds steps of some grey levels, which count as detail and as noise. Sharpening, white balance
and automatic exposure count as the sensor's. Pictures that were made smaller have lost noise. So
compare with each source by itself, and trust the lossless ones most (PNG); the table of each sensor
says how a source is stored.

Objects and forces differ between sets, and contact area, contrast and spectrum depend on them. How
far real sources are from each other says how much of a distance that can be.

A source may be one unit: its colours say nothing about others.
"""


def reality_page(name: str, sides: Mapping[str, Side]) -> str:
    """The page, as HTML.

    Args:
        name: Name of the data set.
        sides: Results by type of sensor, see `compare.compare_reality`.
    """
    verdicts = verdict(_verdict(sensor, side) for sensor, side in sides.items())
    top = paragraph(" ".join(_METHOD.split()), soft=True) + verdicts
    parts = [_section(sensor, side) for sensor, side in sides.items()]
    words = joined(paragraph(" ".join(text.split())) for text in _CONFOUNDED.split("\n\n"))
    last = Section("confounds", "What codec, camera and objects confound", words)
    return html_page(f"Simulated touch beside {name}", top, [*parts, last])


def _verdict(sensor: str, side: Side) -> tuple[str, str]:
    """Kind and text of a verdict: the measures further from real sources than these mutually."""
    ratios = {name: side.ratio(name) for name in DISTANCES}
    far = [f"{name} ({number(ratio)} times)" for name, ratio in ratios.items() if ratio > _FAR]
    if len(side.real) < 2:
        kind, words = "plain", "one real source, so nothing says which distance is small"
    elif far:
        kind, words = (
            "bad",
            f"further from real sources than these from each other: {', '.join(far)}",
        )
    else:
        kind, words = "good", "as near to real sources as these are to each other"
    return kind, f"{sensor}: {words}."


def _section(sensor: str, side: Side) -> Section:
    profiles = [side.simulated, *side.real]
    drawn = [
        panel(
            "Spectrum of the change",
            charts.spectra_chart(profiles),
            "Median over touches, over the power below 0.03 cycles per pixel.",
        ),
        panel("Contrast and contact", charts.touches_chart(profiles), "A point a touch."),
    ]
    body = _pictures(profiles) + heading("Spectrum, contrast, contact")
    names = {place: profile.name for place, profile in enumerate(side.real)}
    body += legend(names, ink=side.simulated.name) + panels(drawn, wide=True)
    body += _numbers(sensor, profiles) + _distances(sensor, side)
    return Section(sensor, sensor, body)


def _pictures(profiles: Sequence[Profile]) -> Markup:
    words = (
        f"Background, touch, and {_GAIN:g} times the difference around mid-grey, the same for all."
    )
    body = heading("Images") + paragraph(words, soft=True)
    for profile in profiles:
        words = _count(len(profile.looks), "touch")
        if profile.faint:
            words += f", {profile.faint} too faint to measure"
        body += group_name(profile.name, words) + stack(_card(touch) for touch in profile.shown)
    return body


def _card(touch: StrongestTouch) -> Markup:
    levels = [np.clip(np.round(part), 0, 255) for part in (touch.background, touch.picture)]
    shown = [*(part.astype(np.uint8) for part in levels), amplified_difference(touch.change, _GAIN)]
    words = [f"{touch.key}, {name}" for name in ("background", "touch", "difference")]
    return figure(shown, touch.key, words, columns=3, width=3 * touch.picture.shape[1])


def _count(count: int, word: str) -> str:
    return f"{count} {word}{'es' if count != 1 else ''}"


def _numbers(sensor: str, profiles: Sequence[Profile]) -> Markup:
    rows = [(name, *(tell(profile) for profile in profiles)) for name, tell in _ROWS.items()]
    note = (
        "Medians over touches; in brackets what 80 % of them lie between. Power in bands of cycles "
        "per pixel, over that below 0.03. Noise: deviation of a pixel over neighbouring frames "
        "without contact. Detail: what a blur of 2 pixels takes away. Change per newton: root mean "
        "square over the contact, fitted over force trials with the imprint moved back; shear at "
        "constant normal force."
    )
    head = ("", *(f"text|{profile.name}" for profile in profiles))
    return heading("Numbers") + table(f"{sensor}-numbers", head, rows, note)


def _spread(values: Array) -> str:
    known = values[np.isfinite(values)]
    if not len(known):
        return NONE
    low, middle, high = (_rounded(float(value)) for value in np.quantile(known, (0.1, 0.5, 0.9)))
    return middle if low == high else f"{middle} ({low} to {high})"


def _rounded(value: float) -> str:
    """Three digits, but not more than two decimals."""
    return number(round(value, 2))


def _of(name: str, scale: float = 1.0) -> Callable[[Profile], str]:
    return lambda profile: _spread(scale * profile.of(name))


def _list(values: Array) -> str:
    return ", ".join(number(float(value)) for value in values)


def _bands(profile: Profile) -> str:
    return ", ".join(
        f"{value:.1f}".replace("-", "\N{MINUS SIGN}") for value in _middle(profile, "bands")
    )


def _middle(profile: Profile, name: str) -> Array:
    out: Array = np.median(profile.of(name), axis=0)
    return out


def _ground(profile: Profile) -> str:
    return ", ".join(f"{value:.0f}" for value in profile.of("ground").mean(axis=0))


def _ground_spread(profile: Profile) -> str:
    return _list(profile.of("ground").std(axis=0).round(1))


def _deviation(profile: Profile) -> str:
    deviations = np.sqrt([np.diag(matrix) for matrix in profile.of("covariance")])
    return _list(np.median(deviations, axis=0))


def _correlations(profile: Profile) -> str:
    return _list(np.median(correlations(profile), axis=0).round(2))


def _normal(profile: Profile) -> str:
    return _spread(np.array([answer.normal for answer in profile.responses]))


def _shear(axis: int) -> Callable[[Profile], str]:
    return lambda profile: _spread(np.array([answer.shear[axis] for answer in profile.responses]))


def _relative(profile: Profile) -> str:
    return _spread(np.array([100 * answer.relative for answer in profile.responses]))


def _curve(profile: Profile) -> str:
    curves = np.array([answer.curve for answer in profile.responses])
    return ", ".join(_middle_of(column) for column in curves.T) if len(curves) else NONE


def _middle_of(values: Array) -> str:
    known = values[np.isfinite(values)]
    return number(float(np.median(known))) if len(known) else NONE


#: Rows of the table of numbers, each with a function of the profile.
_ROWS: dict[str, Callable[[Profile], str]] = {
    "stored as": lambda profile: f"text|{', '.join(profile.stored) or 'pixels'}",
    "log10 power, .06-.12, -.2, -.3, -.5": _bands,
    "noise (grey levels)": _of("noise"),
    "contact (% of the image)": _of("area", 100),
    "contrast in contact (grey levels)": _of("contrast"),
    "detail in contact (grey levels)": _of("inside"),
    "detail outside (grey levels)": _of("outside"),
    "background, mean R, G, B": _ground,
    "its deviation over touches": _ground_spread,
    "change, deviation of R, G, B": _deviation,
    "correlation of RG, RB, GB": _correlations,
    "grey levels per N, normal": _normal,
    "grey levels per N, shear x": _shear(0),
    "grey levels per N, shear y": _shear(1),
    "shear, % of contrast per N": _relative,
    "change at 1/4, 1/2, 3/4 of the force": _curve,
}


def _distances(sensor: str, side: Side) -> Markup:
    apart, among = side.apart, side.among
    few = _few(side)
    head = (
        "",
        "unit",
        "text|simulated over real",
        *(f"text|simulated to {name}" for name in apart),
        *(f"text|{a} to {b}" for a, b in few),
    )
    rows = []
    for name, unit in DISTANCES.items():
        times = side.ratio(name)
        cells = [f"{'bad|' if times > _FAR else ''}{number(times)}"]
        cells += [number(source[name]) for source in apart.values()]
        cells += [number(among[pair][name]) for pair in few]
        rows.append((name, unit, *cells))
    note = (
        "One number for each: the Wasserstein distance between touches of the two sets, 0 for "
        "equal ones; 0.3 decades are a factor of 2. At the end real sources among themselves, at "
        "most four pairs. Simulated over real: the median of the distances to real sources over "
        "the median of those between them; 1 cannot be told from real."
    )
    return heading("Distances") + table(f"{sensor}-distances", head, rows, note)


def _few(side: Side) -> list[tuple[str, str]]:
    """At most four pairs of real sources."""
    pairs = list(side.among)
    return pairs[:: -(-len(pairs) // 4)] if pairs else []
