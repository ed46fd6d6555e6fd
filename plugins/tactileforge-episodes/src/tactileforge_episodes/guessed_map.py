"""A map guessed from the keys, shapes and names of a container."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import Any

import numpy as np

from tactileforge.data import NEWTONS, UNITS, EncodedFrames, named_unit
from tactileforge.errors import DataError, unknown
from tactileforge.plugins import load_json
from tactileforge.reading import (
    ASSUMED_FPS,
    COMMANDS,
    DERIVED,
    FINGERS,
    ROBOT,
    VIEWS,
    Container,
    Values,
    guess_sensor,
    is_turned,
    says_touch,
    words_of,
)
from tactileforge_episodes.groups import find_ends, find_groups, find_splits
from tactileforge_episodes.looks import (
    STILL,
    Look,
    picture_keys,
    taxel_keys,
    time_unit,
)

_TIMES = {"time", "times", "timestamp", "timestamps", "stamp", "stamps", "t", "clock", "secs"}
_NO_TIMES = {"delta", "dt", "duration", "exposure", "remaining", "step", "steps"}
_FORCES = {
    *("force", "forces", "ft", "fts", "wrench", "wrenches", "loadcell", "forcetorque", "netft"),
    *("fx", "fy", "fz", "fxyz"),
}
#: Words of forces that are none on the gel as they were measured.
_ELSEWHERE = ROBOT | COMMANDS
_ACTIONS = {"action", "actions"}
_STATES = {"state", "states", "qpos", "proprio", "proprioception"}
_BODY = ROBOT | {"hand", "pose", "robot0"}
_NO_STATES = {"vel", "velocity", "qvel", "effort", "acc", "object", "sim", "next"} | _ACTIONS
#: Words of what a planner or generator of demonstrations aims at.
_NO_STATES |= {"datagen", "target", "goal", "desired", "planned"}
#: Words of arrays of texts, and attributes of groups, by what they say of an episode.
_WORDS = (
    (
        "text",
        {"instruction", "instructions", "language", "lang", "text", "caption", "prompt"},
        ("language_instruction", "instruction", "caption", "prompt", "text"),
    ),
    (
        "object",
        {"object", "class", "label", "material", "item"},
        ("object", "object_name", "label", "class", "material", "item", "object_id", "obj_id"),
    ),
)
#: Words of a finger, and their short forms.
_SIDES = {"l": "left", "r": "right", "lf": "left", "rf": "right"} | {
    word: word for word in ("left", "right", "thumb", "index", "middle", "ring", "pinky", "little")
}
#: Words of the view of a scene that is taken before others.
_FIRST_VIEWS = ("front", "agentview", "scene", "external", "top", "high", "main", "third", "head")
_RATES = (
    *("fps", "frame_rate", "framerate", "rate", "rate_hz", "hz", "frequency", "freq"),
    *("control_freq", "control_frequency", "sampling_rate", "sample_rate"),
)
#: Attributes that say the order of channels.
_ORDERS = (
    *("color_order", "colour_order", "channel_order", "channels", "color_space", "colorspace"),
    *("color_format", "pixel_format", "image_format", "encoding"),
)
#: Rates of formats whose files have none: robomimic, LIBERO and MimicGen; ALOHA.
_USUAL = (("obs/", 20), ("observations/", 50))
#: Most numbers of a row of a track, and rows of which the range of taxels is taken.
_WIDEST, _SPAN_ROWS = 4096, 2000
#: Most arrays that an error names.
_NAMED = 20


class MapGuess:
    """A map guessed from a container, and its lines to be checked.

    Args:
        file: The container.
        name: Its path, for messages and words of the sensor.
        root: Folder of the data, for messages.
        touch: Keys of touch; () for those whose names say it.

    Attributes:
        doubts: Lines to be checked.
        keys: The map, plain data.

    Raises:
        DataError: No array is touch by its name, or the container is damaged.
    """

    def __init__(self, file: Container, name: str, root: object, touch: Sequence[str] = ()) -> None:
        self.file, self.name, self.root = file, name, root
        self.doubts: list[str] = []
        every = file.keys()
        self.within, self._group = find_groups(every)
        self._top = f"{self._group}/" if self._group else ""
        self.looks = {
            key: look
            for key in (one.removeprefix(self._top) for one in every if one.startswith(self._top))
            if (look := self._look(key)) is not None
        }
        self._used: set[str] = set()
        self.pictures = {
            key: found
            for key, look in self.looks.items()
            if (found := self._picture(look)) is not None
        }
        entries = self._touch(touch)
        self.rows = self.looks[next(iter(entries))].facts.rows
        self.keys = self._map(entries, every)

    def add(self, other: MapGuess) -> None:
        """Adds touch and tracks of another file alone."""
        known = {one["array"] for one in self.keys["touch"]}
        fingers = {one["finger"] for one in self.keys["touch"]}
        for one in other.keys["touch"]:
            if one["array"] not in known and one["finger"] not in fingers:
                self.keys["touch"].append(one)

    def array(self, key: str) -> Values:
        """An array of the chosen episode."""
        return self.file.array(self._top + key)

    def _look(self, key: str) -> Look | None:
        try:
            return Look(key, self.array(key).facts, words_of(key))
        except DataError as error:
            self.doubts.append(f"left out: {error}")
            return None

    def _picture(self, look: Look) -> dict[str, Any] | None:
        try:
            return picture_keys(self, look)
        except DataError as error:
            self.doubts.append(f"left out: {error}")
            return None

    def _attribute(self, key: str, name: str) -> Any:
        read = getattr(self.file, "attribute", None)
        found = None if read is None else read(key, name)
        if isinstance(found, np.ndarray | np.generic) and found.size == 1:
            found = found.item()
        return found.decode("utf-8", "replace") if isinstance(found, bytes) else found

    def _map(self, entries: dict[str, dict[str, Any]], every: Sequence[str]) -> dict[str, Any]:
        keys: dict[str, Any] = {"about": f"{self.name}, guessed", "touch": [*entries.values()]}
        if self.within:
            keys["within"] = self.within
            if splits := find_splits(every):
                keys["splits"] = splits
                self.doubts.append(f"splits: as {' and '.join(splits.values())} of the file say")
        else:
            keys |= find_ends(self, [*self.looks.values()], self.rows)
            self._used |= {keys["ends"]} if "ends" in keys else set()
        keys |= self._time(entries, str(keys.get("ends", "")))
        self._forces(entries, keys)
        keys |= self._camera() | self._numbers() | self._text()
        if any("taxels" not in one and "reference" not in one for one in entries.values()):
            keys["background"] = "first"
            self.doubts.append("background: nothing may touch in the first frame of an episode")
        top = self._group.split("/")[0]
        if str(self._attribute(top, "macros_image_convention")).lower() == "opengl":
            self.doubts.append(
                "mirror: the file says that its simulator draws pictures from below "
                "(macros_image_convention: opengl): if they are upside down, give mirror: y"
            )
        self._left_out()
        return keys | {"doubts": self.doubts}

    def _touch(self, given: Sequence[str]) -> dict[str, dict[str, Any]]:
        """Entries of touch by key."""
        chosen = [self._given(key) for key in given]
        if not given:
            named = [key for key, look in self.looks.items() if says_touch(look.words)]
            shown = [key for key in named if key in self.pictures]
            fingers = [key for key in self.pictures if self.looks[key].has(FINGERS)]
            chosen = self._whole(shown) or self._whole(fingers) or self._only(named)
            chosen = chosen or self._taxels(named)
        if not chosen:
            why = "no array is called touch" if self.pictures else "no array of pictures or touch"
            raise self.unclear(why)
        rows = Counter(self.looks[key].facts.rows for key in chosen).most_common(1)[0][0]
        entries = {}
        for key, short in _short(chosen).items():
            look = self.looks[key]
            if look.facts.rows != rows:
                self.doubts.append(f"left out: {look}, where other touch has {rows} rows")
                self._used.add(key)
                continue
            shape = self.pictures.get(key) or {}
            if key not in self.pictures:
                shape = self._drawn(look)
            entries[key] = {"array": key, "finger": short, "sensor": self._sensor(look), **shape}
            entries[key] |= self._still(look)
            self._used.add(key)
            if "taxels" not in entries[key] and (said := self._said_channels(key)):
                entries[key]["channels"] = said
                self.doubts.append(f"channels: {said}, as an attribute of {key} says")
        if any(not {"taxels", "channels"} & one.keys() for one in entries.values()):
            self.doubts.append("channels: red is taken to be the first (data.channels)")
        return entries

    def _said_channels(self, key: str) -> str:
        """Order of channels by an attribute of an array, or of its group; "" for none."""
        for place in (self._top + key, self._group, ""):
            for name in _ORDERS:
                said = str(self._attribute(place, name)).lower().removesuffix("8")
                if said in ("rgb", "bgr"):
                    return said
        return ""

    def _given(self, key: str) -> str:
        found = key.removeprefix(self._top)
        if found not in self.looks:
            raise DataError(f"{self.name}: {unknown('key of data.touch', key, self.looks)}")
        if found not in self.pictures and taxel_keys(self.looks[found]) is None:
            raise DataError(
                f"{self.name}: data.touch: {self.looks[found]} holds no pictures and no taxels"
            )
        return found

    def _whole(self, keys: Sequence[str]) -> list[str]:
        """Pictures of sensors: the raw ones, or else computed ones."""
        plain = [key for key in keys if not self.looks[key].has(DERIVED | STILL)]
        return plain or [key for key in keys if not self.looks[key].has(STILL | {"next"})]

    def _only(self, named: Sequence[str]) -> list[str]:
        """The only array of pictures, unless named as a view of the scene."""
        if named or len(self.pictures) != 1:
            return []
        (key,) = self.pictures
        if self.looks[key].has({*_FIRST_VIEWS, "wrist", "camera", "cam", "cameras", "view"}):
            return []
        self.doubts.append(f"touch: {key} is the only array of pictures, so it is taken for touch")
        return [key]

    def _taxels(self, keys: Sequence[str]) -> list[str]:
        beside = _TIMES | _FORCES | DERIVED | STILL | _ACTIONS
        return [
            key
            for key in keys
            if not self.looks[key].has(beside) and taxel_keys(self.looks[key]) is not None
        ]

    def _drawn(self, look: Look) -> dict[str, Any]:
        """Keys of drawn numbers: the change from the first row, up to its largest."""
        found = dict(taxel_keys(look) or {})
        values = self.array(look.key).rows(range(min(look.facts.rows, _SPAN_ROWS)))
        change = np.abs(values.astype(np.float64) - values[0].astype(np.float64))
        most = float(np.nanmax(change)) if np.isfinite(change).any() else 0.0
        span = float(f"{most:.3g}") or 1.0
        found["taxels"] = {**found["taxels"], "span": span, "baseline": "first"}
        self.doubts.append(
            f"span: {look.key} is drawn as its change from the first row; {span:g} is full colour"
        )
        return found

    def _sensor(self, look: Look) -> str:
        if look.key not in self.pictures:
            return "serial_array"
        keys = self.pictures[look.key]
        sizes = look.width[1:] if keys.get("pads") else look.width
        shape = sizes[1:] if keys.get("axes") == "chw" else sizes[:2]
        if len(sizes) < 2:  # encoded images
            raw = bytes(self.array(look.key).rows([0])[0])
            shape = EncodedFrames(f"{self.name}: {look.key}", [raw]).shape
        for words in (look.key, "/".join([*self.name.split("/")[-2:], look.key])):
            doubts: list[str] = []
            found = guess_sensor(words, lambda: (shape[0], shape[1]), doubts)
            if not doubts:
                break
        self.doubts += [f"{line} ({look.key})" for line in doubts]
        return str(found["sensor"])

    def _still(self, look: Look) -> dict[str, Any]:
        """Key of the picture without contact with the words of a touch."""
        own = {*look.words} - VIEWS
        for key, other in self.looks.items():
            shape = other.facts.shape
            fits = shape in (look.width, (1, *look.width)) and len(look.width) == 3
            if fits and other.has(STILL) and {*other.words} - VIEWS - STILL <= own:
                self._used.add(key)
                self.doubts.append(f"reference: {key} is {look.key} without contact")
                return {"reference": key}
        return {}

    def _time(self, entries: dict[str, dict[str, Any]], ends: str) -> dict[str, Any]:
        """Keys of the times of each touch, or of all, else the rate."""
        found = [
            look
            for look in self.looks.values()
            if look.has(_TIMES) and not look.has(_NO_TIMES) and look.is_numbers
            if look.facts.shape in ((self.rows,), (self.rows, 1)) and look.key not in self._used
        ]
        elsewhere = _ELSEWHERE | VIEWS
        found.sort(key=lambda one: (not says_touch(one.words), one.has(elsewhere), len(one.words)))
        shared: dict[str, Any] = {}
        for look in found:
            touch = self._whose(look, entries)
            if len(touch) == 1 < len(entries):
                entry = entries[touch[0]]
                entry |= {} if "times" in entry else self._read_time(look, ends)
            elif not shared:
                shared = self._read_time(look, ends)
        return {} if all("times" in entry for entry in entries.values()) else shared or self._rate()

    def _read_time(self, look: Look, ends: str) -> dict[str, Any]:
        """Key of times; {} for an array without them."""
        values = self.array(look.key).rows(range(self._first(ends))).reshape(-1)
        try:
            unit, why = time_unit(look.words, values)
        except ValueError as error:
            raise DataError(
                f"{self.name}: {look}: {error}; correct the name, or say the unit in a map: "
                f"times: {{array: {look.key}, unit: s}}"
            ) from error
        if unit == "frames":
            return {}
        if not unit:
            self.doubts.append(f"times: {look.key} is left out, as {why}")
            return {}
        self._used.add(look.key)
        self.doubts.append(f"times: {look.key} in {unit}, {why}")
        return {"times": {"array": look.key, "unit": unit}}

    def _whose(self, look: Look, entries: Mapping[str, Any]) -> list[str]:
        """Touch of an array, by its telling words; all for none."""
        words = {key: {_SIDES.get(word, word) for word in self.looks[key].words} for key in entries}
        apart = set.union(*words.values())
        apart -= {word for word in apart if all(word in own for own in words.values())}
        own = {_SIDES.get(word, word) for word in look.words}
        if len(entries) == 1:
            apart = {*_SIDES.values()}
        return [key for key in entries if own & apart <= words[key]]

    def _first(self, ends: str) -> int:
        """Rows of the first episode."""
        if not ends:
            return self.rows
        values = self.array(ends).rows(range(self.looks[ends].facts.rows)).reshape(-1)
        values = values.astype(np.int64)
        if len(values) == self.rows:
            return int(np.argmax(values != values[0])) or self.rows
        return int(next((one for one in values if one > 0), self.rows))

    def _rate(self) -> dict[str, Any]:
        tops = ["", *("/".join(self._group.split("/")[:1]) for _ in [0] if "/" in self._group)]
        for key in (self._group, *tops, "meta", "data"):
            for name in _RATES:
                if _is_rate(self._attribute(key, name)):
                    place = "" if key == self._group else f"/{key}"
                    return {"fps": {"array": place, "attr": name}}
            try:
                about = load_json(str(self._attribute(key, "env_args") or "{}"))
            except ValueError:
                continue
            inner = about.get("env_kwargs") if isinstance(about, Mapping) else None
            if isinstance(inner, Mapping) and _is_rate(inner.get("control_freq")):
                json = "env_kwargs.control_freq"
                return {"fps": {"array": f"/{key}", "attr": "env_args", "json": json}}
        for key, look in self.looks.items():
            if look.has({*_RATES, "rate"}) and look.facts.shape in ((), (1,)) and look.is_numbers:
                self._used.add(key)
                return {"fps": {"array": key, "whole": True}}
        usual = (rate for start, rate in _USUAL if any(key.startswith(start) for key in self.looks))
        rate = next(usual, ASSUMED_FPS)
        self.doubts.append(f"fps: {rate} is assumed, as nothing tells the rate (data.fps)")
        return {"fps": rate}

    def _forces(self, entries: dict[str, dict[str, Any]], keys: Mapping[str, Any]) -> None:
        """Gives each touch its force: of its own words, or the only one of the only touch."""
        found = [
            look
            for look in self.looks.values()
            if (look.has(_FORCES) or look.words[-1:] == ("f",)) and look.is_numbers
            if look.key not in self._used and not (look.has(_TIMES) and look.width in ((), (1,)))
            if look.width[-1:] in ((), (1,), (3,), (6,)) and look.facts.shape
        ]
        clocks = {look.key: self._clock_of(look, entries, keys) for look in found}
        found = [one for one in found if one.facts.rows == self.rows or clocks[one.key]]
        axes = _axes_of([look.key for look in found if look.width in ((), (1,))])
        given: set[str] = set()
        for key, entry in entries.items():
            robot = _ELSEWHERE - {*self.looks[key].words}
            fits = {
                axes.get(look.key, look.key): look
                for look in found
                if self._whose(look, entries) == [key] and not look.has(robot)
                if look.width[:-1] == (self.looks[key].width[:1] if entry.get("pads") else ())
            }
            if len(fits) > 1:
                names = " or ".join(fits)
                self.doubts.append(f"force: of {key} it may be {names}, so they are tracks alone")
            if len(fits) != 1:
                continue
            ((name, look),) = fits.items()
            unit = named_unit(name.rpartition("/")[2].replace("{axis}", "z")) or "N"
            if unit not in NEWTONS:
                self.doubts.append(f"force: {name} is in {unit} by its name, so it is a track")
                continue
            whole = look.width[-1:] in ((3,), (6,)) or "{axis}" in name
            entry["force"] = {
                "array": f"{name}?",
                "columns": [0, 1, 2] if whole else [None, None, 0],
            }
            entry["force"] |= {} if unit == "N" else {"unit": unit}
            if clock := clocks[look.key]:
                entry["force"]["times"] = clock
                self._used |= {clock["array"], look.key}
                self.doubts.append(
                    f"force: {name} has a clock of its own, {clock['array']} in {clock['unit']}, "
                    "and is interpolated to the frames"
                )
            if whole and look.width in ((3,), (6,)) and self._pulls(look):
                entry["force"]["sign"] = [1, 1, -1]
                self.doubts.append(f"force: z of {name} is negative where large, so it is turned")
            given |= {one.key for one in found if axes.get(one.key, one.key) == name}
            self.doubts.append(
                f"force: {name} is taken for that on {key}, in {unit}, x right, y down, z into the "
                "gel, pressing positive"
            )
        for look in found:
            if look.key not in given and look.facts.rows == self.rows:
                self.doubts.append(f"force: {look.key} is a track, as it is not of one touch alone")
        # torques are a track
        self._used |= {key for key in given if self.looks[key].width[-1:] != (6,)}

    def _pulls(self, look: Look) -> bool:
        values = self.array(look.key).rows(range(min(look.facts.rows, _SPAN_ROWS)))
        return is_turned(values[:, 2].astype(np.float64))

    def _clock_of(
        self, force: Look, entries: Mapping[str, Mapping[str, Any]], keys: Mapping[str, Any]
    ) -> dict[str, str] | None:
        """Key of a force's own times, of its group or name; None for those of the frames."""
        of_frames = [one.get("times") or keys.get("times") for one in entries.values()]
        if "ends" in keys or None in of_frames:
            return None
        taken = {one["array"] for one in of_frames if one}
        group, rest = force.key.rpartition("/")[0], {*force.words}
        for look in self.looks.values():
            is_near = look.key.rpartition("/")[0] == group != "" and group not in {
                key.rpartition("/")[0] for key in entries
            }
            named = {*look.words} - _TIMES - {"s", "ms", "us", "ns"}
            if (
                look.key in taken
                or look.facts.shape not in ((force.facts.rows,), (force.facts.rows, 1))
                or not (look.is_numbers and look.has(_TIMES) and not look.has(_NO_TIMES))
                or not (is_near or (named and named <= rest))
            ):
                continue
            values = self.array(look.key).rows(range(force.facts.rows)).reshape(-1)
            try:
                unit, _ = time_unit(look.words, values)
            except ValueError:
                continue
            if unit in UNITS:
                return {"array": look.key, "unit": unit}
        return None

    def _camera(self) -> dict[str, Any]:
        views = [
            key
            for key in self.pictures
            if key not in self._used and self.looks[key].facts.rows == self.rows
            if not self.looks[key].has(DERIVED | STILL) and not says_touch(self.looks[key].words)
            if not self.pictures[key].get("pads")
        ]
        if not views:
            return {}
        first = (k for word in _FIRST_VIEWS for k in views if word in self.looks[k].words)
        best = next(first, views[0])
        self._used.add(best)
        self.doubts.append(f"camera: {best} is the view of the scene")
        return {"camera": {"array": f"{best}?", **self.pictures[best]}}

    def _numbers(self) -> dict[str, Any]:
        """State, action and tracks."""
        free = [
            look
            for key, look in self.looks.items()
            if key not in self._used and key not in self.pictures and look.is_numbers
            if look.facts.shape and look.facts.rows == self.rows
            if math.prod(look.width) <= _WIDEST and "next" not in look.words
        ]
        actions = sorted((one for one in free if one.has(_ACTIONS)), key=lambda one: len(one.words))
        states = [one for one in free if one.has(_STATES) and not one.has(_NO_STATES)]
        states = sorted(states, key=lambda one: len(one.words))[:1]
        if not states or states[0].words[-1:] == ("states",):  # of a simulator, where others are
            body = [one for one in free if one.has(_BODY) and not one.has(_NO_STATES | _FORCES)]
            states = [one for one in body if not says_touch(one.words)] or states
        found: dict[str, Any] = {}
        if actions:
            found["command"] = [f"{actions[0].key}?"]
        if states:
            found["state"] = [f"{one.key}?" for one in states]
        taken = {one.key for one in (*actions[:1], *states)}
        rest = [one.key for one in free if one.key not in taken]
        if rest:
            found["tracks"] = {name: f"{key}?" for key, name in _short(rest).items()}
        self._used |= {*taken, *rest}
        return found

    def _text(self) -> dict[str, Any]:
        """Keys of the caption and of the object."""
        found = {}
        for what, words, attributes in _WORDS:
            if read := self._said(words, attributes):
                found[what] = read
        if "object" in found:
            self.doubts.append(f"object: {found['object'].get('attr') or found['object']['array']}")
        return found if "text" in found else found | self._problem()

    def _said(self, words: AbstractSet[str], attributes: Sequence[str]) -> dict[str, Any]:
        """Where a text of an episode is read: an array of texts, or an attribute; {} for none."""
        for key, look in self.looks.items():
            is_text = look.facts.dtype.kind in "SUO" and key not in self.pictures
            if is_text and look.has(words) and look.facts.shape in ((), (1,), (self.rows,)):
                self._used.add(key)
                return {"array": f"{key}?"}
        for key in self._groups():
            for name in attributes:
                said = self._attribute(key, name)
                if isinstance(said, str) or (name.endswith("_id") and isinstance(said, int)):
                    return {"array": "" if key == self._group else f"/{key}", "attr": name}
        return {}

    def _groups(self) -> Iterable[str]:
        """Groups with possible attributes of an episode or of all."""
        return dict.fromkeys((self._group, self._group.split("/")[0], "", "data"))

    def _problem(self) -> dict[str, Any]:
        """Keys of the caption in the JSON of a simulator's problem; {} for none."""
        for key in self._groups():
            try:
                about = load_json(str(self._attribute(key, "problem_info") or "{}"))
            except ValueError:
                continue
            if isinstance(about, Mapping) and isinstance(about.get("language_instruction"), str):
                json = "language_instruction"
                return {"text": {"array": f"/{key}", "attr": "problem_info", "json": json}}
        return {}

    def _left_out(self) -> None:
        left = [look for key, look in self.looks.items() if key not in self._used]
        if left:
            self.doubts.append(f"left out: {listed(left)}")

    def unclear(self, why: str) -> DataError:
        """Error with a list of the arrays, and the words to type."""
        shown = next(iter(self.pictures), "KEY")
        within = f"within: {self.within!r}, " if self.within else ""
        filled = f"{{about: mine, {within}touch: [{{array: {shown!r}, sensor: digit}}], fps: 30}}"
        return DataError(
            f"{self.name}: {why}. It has {listed(self.looks.values(), self.within)}. Say which is "
            f"touch: data=episodes data.root={self.root} 'data.touch=[{shown}]'; or fill in a map: "
            f'"data.map={filled}" (docs/data.md)'
        )


def listed(looks: Iterable[Look], within: str = "") -> str:
    """Arrays with their types and shapes, a phrase.

    Args:
        looks: The arrays.
        within: Template of the groups that all have them; "" for none.
    """
    found = [*looks]
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    where = f" in each {within}" if within else ""
    return (", ".join(map(str, found[:_NAMED])) or "no arrays") + more + where


def _axes_of(keys: Sequence[str]) -> dict[str, str]:
    """Keys of forces along x, y and z, from an array of each, with one for all.

    Example:
        >>> sorted(_axes_of(["data/fx", "data/fy", "data/fz"]).items())[0]
        ('data/fx', 'data/f{axis}')
    """
    found: dict[str, dict[str, str]] = {}
    for key in keys:
        if fits := re.fullmatch(r"(.*(?:[Ff]|[Ff]orces?_?|ft_|[Ww]rench_))([xyz])((?:_\w+)?)", key):
            found.setdefault(f"{fits[1]}{{axis}}{fits[3]}", {})[fits[2]] = key
    return {key: name for name, axes in found.items() if len(axes) == 3 for key in axes.values()}


def _is_rate(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= 1e5


def _short(keys: Sequence[str]) -> dict[str, str]:
    """Shortest distinct names of keys: the last parts, or the differing ones."""
    parts = {key: key.split("/") for key in keys}
    if len({one[-1] for one in parts.values()}) < len(keys):
        if len({len(one) for one in parts.values()}) == 1:
            varied = [len({*column}) > 1 for column in zip(*parts.values(), strict=True)]
            parts = {
                key: [part for part, own in zip(one, varied, strict=True) if own]
                for key, one in parts.items()
            }
    else:
        parts = {key: one[-1:] for key, one in parts.items()}
    return {key: re.sub(r"\W+", "_", "_".join(one)) for key, one in parts.items()}
