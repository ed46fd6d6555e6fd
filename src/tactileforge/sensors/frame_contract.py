"""Contract of live frames, checked before they are recorded, shown or handed on."""

from __future__ import annotations

import numpy as np

from tactileforge.contracts import Frame, SensorSpec
from tactileforge.errors import SensorError
from tactileforge.specs.published import SPECS

#: Largest possible values: of a wrench, N and N m; of taxels and robots in their own units. No
#: sensor of touch comes near; misread bytes do.
MOST_WRENCH, MOST_VALUE = np.repeat([1e4, 1e3], 3), 1e12
#: Explanations of bad values, by the reason of their counter.
BAD_VALUES = {
    "no_number": "its values are not numbers",
    "implausible": "its values are larger than any that can be true",
}


def check_frame(frame: Frame, spec: SensorSpec) -> None:
    """Check type, channels, size and orientation of a frame, and the shape of its values.

    It looks at no pixel, so it costs nothing.

    Args:
        frame: Frame of the driver.
        spec: Spec of the open sensor.

    Raises:
        SensorError: The frame differs from the spec; the message names the fix.
    """
    if spec.kind in ("image", "array"):
        _check_picture(frame.array, spec)
        check_orientation(spec)
    if spec.kind == "image" or frame.raw is None:
        return
    got = np.shape(frame.raw)
    if spec.kind == "wrench":
        good, want = got == (6,), "(6,), in N and N m"
    elif spec.kind == "robot":
        count = spec.states + spec.actions
        good, want = got == (count,), f"({count},), states and actions"
    else:
        good, want = len(got) == 2, "(taxels, values of each)"
    if not good:
        raise SensorError(f"values of the shape {got}, and those of a {spec.kind} are {want}")


def check_orientation(spec: SensorSpec) -> None:
    """Check the frames of a published sensor for standing upright.

    Args:
        spec: Spec of the open sensor, with the height and width of its frames.

    Raises:
        SensorError: The frames lie on their side.

    Example:
        >>> from dataclasses import replace
        >>> check_orientation(SPECS["digit"])
        >>> check_orientation(replace(SPECS["digit"], height=240, width=320))
        Traceback (most recent call last):
        ...
        tactileforge.errors.SensorError: its frames of 240 rows and 320 columns lie on their side: \
those of a digit are upright, 320 x 240; turn them by 90 degrees, with rotation=90 or rotation=270 \
of the camera
    """
    known = SPECS.get(spec.name)
    if known is None or spec.kind != "image":
        return
    # by the longer side alone: sizes differ from driver to driver, and square crops say nothing
    if (known.height - known.width) * (spec.height - spec.width) < 0:
        raise SensorError(
            f"its frames of {spec.height} rows and {spec.width} columns lie on their side: those "
            f"of a {spec.name} are {'upright' if known.height > known.width else 'wide'}, "
            f"{known.height} x {known.width}; turn them by 90 degrees, with rotation=90 or "
            "rotation=270 of the camera"
        )


def bad_values(frame: Frame, spec: SensorSpec) -> str:
    """Reason to drop the values of a frame, a key of `BAD_VALUES`; "" for good values.

    Args:
        frame: Frame checked by `check_frame`.
        spec: Spec of the open sensor.
    """
    if spec.kind == "image":
        return ""
    if frame.raw is None:
        return "no_number"
    most = MOST_WRENCH if spec.kind == "wrench" else MOST_VALUE
    if (np.abs(frame.raw) <= most).all():  # false for NaN; a thousand times a second
        return ""
    return "implausible" if np.isfinite(frame.raw).all() else "no_number"


def _check_picture(array: object, spec: SensorSpec) -> None:
    if not isinstance(array, np.ndarray):
        raise SensorError(f"a frame is a {type(array).__name__}: its driver must give uint8 RGB")
    if array.shape[:2] != (spec.height, spec.width):
        got, want = array.shape[:2], (spec.height, spec.width)
        raise SensorError(f"a frame of {got} pixels, and its spec says {want}")
    if array.ndim != 3 or array.shape[2] != 3:
        channels = 1 if array.ndim == 2 else array.shape[2]
        raise SensorError(
            f"a frame of {channels} channel{'s' * (channels != 1)}, and frames are RGB: its driver "
            f"must {_RGB.get(channels, 'give three')}"
        )
    if array.dtype != np.uint8:
        raise SensorError(
            f"a frame of {array.dtype}, and frames are uint8, 0 to 255: its driver must "
            f"{'scale' if array.dtype.kind == 'f' else 'convert'} them"
        )


#: Fixes for frames of other numbers of channels.
_RGB = {
    1: "read the camera in colour; grey is not what models of this sensor are trained on",
    4: "leave out the fourth",
}
