"""Episode files as recordings."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames, FrameSubset, Recording
from tactileforge.data import is_deep, resample
from tactileforge.errors import ConfigError, DataError
from tactileforge.specs import spec
from tactileforge_episodes.clock import episodes_of, rate_of, times_beside, times_of
from tactileforge_episodes.forces import read_force
from tactileforge_episodes.frames import Reference, open_pictures
from tactileforge_episodes.map_keys import EpisodeMap, ForceKeys, Keys, PictureKeys, TimeKeys
from tactileforge_episodes.names import fill, placeholders
from tactileforge_episodes.places import open_place
from tactileforge_episodes.refs import ArrayRef, Readable, Track, Tracks
from tactileforge_episodes.statements import Statements
from tactileforge_episodes.taxels import TaxelFrames, Taxels, TaxelTrack
from tactileforge_episodes.touches import Touch, find_touches
from tactileforge_episodes.values import EpisodeArrays, labels_of


class EpisodeFile:
    """One file or group, and its episodes.

    Args:
        arrays: Its arrays.
        name: Its name in the data set.
        keys: The map.
        values: Values of the placeholders of its path.
        reading: What the user says.
        split: The split that its file states, "" for none; None where it states no splits.
    """

    def __init__(
        self,
        arrays: EpisodeArrays,
        name: str,
        keys: EpisodeMap,
        values: Mapping[str, str],
        reading: Statements,
        split: str | None = None,
    ) -> None:
        self.arrays, self.name, self.keys, self.split = arrays, name, keys, split
        self.values, self.reading = dict(values), reading
        arrays.count_optional(reading.optional, self.values)
        self._note: Callable[[str], object] = lambda _: None
        self._gaps: dict[ArrayRef, tuple[list[int], bool]] = {}

    @cached_property
    def touches(self) -> list[Touch]:
        """Its sensors; see `find_touches`."""
        return find_touches(self.arrays, self.keys, self.values, self.reading.draw)

    @cached_property
    def rows(self) -> int:
        """Number of rows of all arrays with a time axis.

        Raises:
            DataError: Arrays of touch differ in their rows.
        """
        first = self.touches[0].ref
        for touch in self.touches:
            self._same_rows(touch.ref, first.facts.rows)
        return first.facts.rows

    @cached_property
    def episodes(self) -> list[tuple[int, int]]:
        """Rows of each episode; see `episodes_of`."""
        return episodes_of(self.arrays, self.keys, self.rows)

    @cached_property
    def rate(self) -> float | None:
        """Rows per second; None for unknown."""
        return rate_of(self.arrays, self.keys, self.values, self.reading.fps)

    def key(self, number: int) -> str:
        """Name of an episode in the data set."""
        return f"{self.name}/{number:06d}" if self.keys.ends else self.name

    def recordings(
        self,
        number: int,
        bad: Callable[[DataError], object],
        note: Callable[[str], object] = lambda _: None,
    ) -> Iterator[Recording]:
        """Yields the recordings of an episode, one per sensor.

        Args:
            number: Index of the episode.
            bad: Is told of sensors that cannot be read.
            note: Is told of values that are not there.

        Raises:
            DataError: A file is damaged, lacks a key, or contradicts itself.
            ConfigError: An option is missing.
        """
        self._note = note
        for line in self.arrays.left:
            note(f"left out: {line}")
        start, stop = self.episodes[number]
        if start == stop:
            raise DataError(f"{self.arrays.place}: episode {number} has no frames")
        span = (start, stop)
        if not all(touch.keys.times for touch in self.touches):
            ref = self.touches[0].ref
            stamped = None if self.keys.times else open_place(ref.place).times(ref.key)
            times = times_of(self.arrays, self.keys.times, self.values, self.rate, span, stamped)
        shared = self._shared(number, start, stop)
        for touch in self.touches:
            try:
                if touch.keys.times:
                    own = times_of(self.arrays, touch.keys.times, touch.values, self.rate, span)
                else:
                    own = times
                yield self._recording(touch, number, own, range(start, stop), shared)
            except DataError as error:
                bad(error)

    def _shared(self, number: int, start: int, stop: int) -> dict[str, Any]:
        """Common fields of the recordings of an episode."""
        keys, rows = self.keys, range(start, stop)
        camera = None
        if keys.camera is not None:
            found = self.arrays.find(keys.camera.array, self.values)
            if found is not None:
                self._same_rows(found, self.rows)
                view = self._coloured(keys.camera)
                camera = view.upright(open_pictures(found, rows, view), False)
        tracks: dict[str, Readable] = {}
        for name, key in keys.tracks.items():
            tracks |= self._tracks(name, key, self.values, rows, None)
        if state := self._side_by_side(keys.state, rows):
            tracks["state"] = state
        if action := self._side_by_side(keys.command, rows):
            tracks["robot_action"] = action
        elif state and "next_state" in keys.command:
            tracks["robot_action"] = replace(state, ahead=1)
        return {
            "image": camera,
            "tracks": tracks,
            "object": self.arrays.text(keys.object, self.values, start),
            "text": self.arrays.text(keys.text, self.values, start),
        }

    def _recording(
        self,
        touch: Touch,
        number: int,
        times: NDArray[np.float64],
        rows: range,
        shared: Mapping[str, Any],
    ) -> Recording:
        keys, entry = self.keys, touch.keys
        self._lost(touch.ref, rows, "")  # that none is there; some are an error of the frames
        frames, tracks = self._frames(touch, rows), dict(shared["tracks"])
        force, wrench = self._force(touch, rows, times)
        if wrench is not None:
            tracks["wrench"] = wrench
        large = {name: key for name, key in keys.large.items() if name in self.reading.large}
        for name, key in (*entry.tracks.items(), *large.items()):
            tracks |= self._tracks(name, key, touch.values, rows, touch.pad)
        if isinstance(frames, TaxelFrames):
            tracks["taxels"] = TaxelTrack(frames.taxels, rows.start, rows.stop)
        labels: dict[str, str | float] = {
            "episode": self.key(number).replace("/", "_"),
            "finger": touch.finger,
            **labels_of(
                (name, self._label(value, touch, rows.start))
                for name, value in (*keys.labels.items(), *entry.labels.items())
            ),
        }
        return Recording(
            key=f"{self.key(number)}/{touch.finger}",
            sensor=self._sensor(touch, rows.start),
            frames=frames,
            times=times,
            no_contact=self._still(touch, frames),
            force=force,
            object=shared["object"],
            text=shared["text"],
            image=shared["image"],
            image_times=None if shared["image"] is None else times,
            labels=labels,
            tracks=Tracks(tracks),
            source=keys.source or f"episodes {self.name}",
            tier=1 if force is not None else keys.tier,
            licence=self.reading.licence or keys.licence,
        )

    def _frames(self, touch: Touch, rows: range) -> Frames:
        if touch.taxels is None:
            keys = self._coloured(touch.keys)
            return keys.upright(open_pictures(touch.ref, rows, keys, touch.pad, touch.part), False)
        about = touch.taxels
        taxels = Taxels(touch.ref, about.form, about.size, touch.pad, touch.part, self.keys.limit)
        width = taxels.sizes[-1]
        columns = about.columns or ((0, 1, 2) if width == 3 else (0,))
        if max(columns) >= width:
            raise DataError(f"{touch.ref}: {width} values a taxel, but columns {list(columns)}")
        span = about.span if self.reading.span is None else self.reading.span
        if span is None:
            seen = np.abs(taxels.read([rows.start, rows[len(rows) // 2], rows[-1]]))
            raise ConfigError(
                f"{touch.ref}: drawn as a picture, and its unit is not known; give the value of "
                f"full colour: data.span=... (it has values up to {np.nanmax(seen):.4g}), or leave "
                "numbers out with data.draw=none"
            )
        first = about.baseline == "first"
        return TaxelFrames(taxels, rows.start, rows.stop, columns, span, first)

    def _coloured(self, keys: PictureKeys) -> PictureKeys:
        """Keys of pictures with the channels given by the user, if any."""
        channels = self.reading.channels
        return keys if channels is None else replace(keys, channels=channels, encoded=channels)

    def _still(self, touch: Touch, frames: Frames) -> Frames | None:
        if touch.taxels is not None:
            return None  # what does not change is grey already
        if touch.keys.reference:
            ref = self.arrays.find(touch.keys.reference, touch.values)
            if ref is not None:
                keys = self._coloured(touch.keys)
                white = (keys.white if is_deep(ref.facts.dtype) else None) or 255.0
                still = keys.upright(Reference(ref, touch.pad, keys.is_bgr, white), False)
                if still.shape != frames.shape:
                    raise DataError(
                        f"{ref}: {still.shape[0]} x {still.shape[1]} pixels, where touch has "
                        f"{frames.shape[0]} x {frames.shape[1]}"
                    )
                return still
        background = self.reading.background or self.keys.background
        return FrameSubset(frames, [0]) if background == "first" else None

    def _sensor(self, touch: Touch, row: int) -> str:
        about, given = touch.keys.sensor, self.reading.sensors
        name = str(about if isinstance(about, str) else self._label(about, touch, row))
        known = name if touch.taxels is None else touch.taxels.sensor
        sensor = given.get(name, given.get("any", known))
        try:
            return spec(sensor).name
        except ConfigError as error:
            raise DataError(
                f"{touch.finger}: its sensor {name!r} is not a known type; say which it is: "
                f"'data.sensors={{{name}: NAME}}', or any: NAME for all ({error})"
            ) from error

    def _label(self, value: Any, touch: Touch, row: int) -> Any:
        if isinstance(value, str):
            return fill(value, touch.values)
        return self.arrays.value(value, touch.values, row, -1 if touch.pad is None else touch.pad)

    def _force(
        self, touch: Touch, rows: range, times: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32] | None, Track | None]:
        """Force as a label, or, of another frame than the gel's, as a track."""
        about = touch.keys.force
        if about is not None and "axis" in placeholders(str(about.array)):
            return self._by_axis(about, touch, rows), None
        ref = None if about is None else self.arrays.find(about.array, touch.values)
        if about is None or ref is None or ref == touch.ref:
            return None, None
        if about.times is not None:
            return self._on_its_clock(about, about.times, ref, touch, times), None
        shape = self._same_rows(ref, self.rows)
        if touch.pad is not None and len(shape) == 3 and shape[1] != touch.ref.facts.shape[1]:
            return None, None  # of other pads
        if about.at != "gel":
            return None, self._track_of(ref, rows, touch.pad)
        force = read_force(ref, about, rows, touch.pad, self.keys.limit)
        if lost := self._lost(ref, rows, "so no force is known there"):
            force[np.asarray(lost) - rows.start] = np.nan
        if about.sign[2] == "mean":
            force[:, 2] *= self.reading.signs.get(touch.entry, 1.0)
        return force, None

    def _on_its_clock(
        self,
        about: ForceKeys,
        own: TimeKeys,
        ref: ArrayRef,
        touch: Touch,
        times: NDArray[np.float64],
    ) -> NDArray[np.float32]:
        """Force with times of its own, at those of the frames; NaN for no measurement."""
        if self.keys.ends:
            raise DataError(f"{ref}: times of a force, and ends of episodes; give one of the two")
        clock = times_beside(self.arrays, own, touch.keys.times or self.keys.times, touch.values)
        rows = range(ref.facts.rows)
        if len(clock) != len(rows):
            raise DataError(f"{ref}: {len(rows)} rows and {len(clock)} times of them")
        force = read_force(ref, about, rows, touch.pad, self.keys.limit)
        if lost := self._lost(ref, rows, "so no force is known there"):
            force[lost] = np.nan
        felt = resample(times, clock, force).astype(np.float32)
        if np.isfinite(force).any() and not np.isfinite(felt).any():
            raise DataError(
                f"{ref}: its times, {clock[0]:.6g} to {clock[-1]:.6g} s after the first frame, do "
                f"not overlap those of the frames, 0 to {times[-1]:.6g} s; correct the unit of "
                "force.times in the map, or leave the force out"
            )
        return felt

    def _by_axis(self, about: ForceKeys, touch: Touch, rows: range) -> NDArray[np.float32] | None:
        """Force with an array for each axis."""
        found = [self.arrays.find(about.array, {**touch.values, "axis": axis}) for axis in "xyz"]
        if not any(found):
            return None
        force = np.full((len(rows), 3), np.nan, np.float32)
        for axis, ref in enumerate(found):
            if ref is not None:
                self._same_rows(ref, self.rows)
                x, y, z = (0 if one == axis else None for one in range(3))
                only = replace(about, columns=(x, y, z))
                force[:, axis] = read_force(ref, only, rows, touch.pad, self.keys.limit)[:, axis]
                if lost := self._lost(ref, rows, "so no force is known there"):
                    force[np.asarray(lost) - rows.start, axis] = np.nan
        return force

    def _tracks(
        self, name: str, key: Keys, values: Mapping[str, str], rows: range, pad: int | None
    ) -> dict[str, Readable]:
        """Tracks of a key: one, or one for each array of a placeholder."""
        found = self.arrays.match(key, values)
        if not found:
            self.arrays.find(key, values)
        refs = {fill(name, its): self.arrays.ref(one) for one, its in found}
        several = any(word not in values for word in placeholders(str(key)))
        taken = self._taken if several else set()
        wanted = {one: ref for one, ref in refs.items() if ref not in taken}
        return {one: self._track_of(ref, rows, pad) for one, ref in wanted.items()}

    @cached_property
    def _taken(self) -> set[ArrayRef]:
        """Arrays of touch and force, as opposed to tracks of a placeholder."""
        forces = [(one.keys.force, one.values) for one in self.touches if one.keys.force]
        found = {self.arrays.find(about.array, values) for about, values in forces}
        return {one.ref for one in self.touches} | {ref for ref in found if ref is not None}

    def _lost(self, ref: ArrayRef, rows: range, then: str) -> list[int]:
        """Rows of values without a stored chunk; notes them."""
        if ref not in self._gaps:  # of all episodes at once: each has few of the array's rows
            self._gaps[ref] = ref.lost(0, ref.facts.rows), ref.is_void
        gaps, is_void = self._gaps[ref]
        lost = gaps[bisect_left(gaps, rows.start) : bisect_left(gaps, rows.stop)]
        if lost:
            self._note(
                f"{ref}: {len(lost)} of {len(rows)} rows, from row {lost[0]} on, lie in a missing "
                f"chunk, {then}; download it again, or write it with write_empty_chunks=True"
            )
        elif is_void:
            self._note(
                f"{ref}: none of its chunks is there, so all values are the fill value; download "
                "it again if they should not be"
            )
        return lost

    def _track_of(self, ref: ArrayRef, rows: range, pad: int | None) -> Track:
        shape = self._same_rows(ref, self.rows)
        self._lost(ref, rows, "and hold the fill value there")
        pads = {touch.ref.facts.shape[1] for touch in self.touches if touch.keys.pads}
        inner = pad is not None and len(shape) > 1 and shape[1] in pads
        return Track((ref,), rows.start, rows.stop, pad if inner else None, 0, self.keys.limit)

    def _side_by_side(self, keys: Sequence[str], rows: range) -> Track | None:
        names = [key for key in keys if key != "next_state"]
        found = [self.arrays.find(key, self.values) for key in names]
        refs = tuple(ref for ref in found if ref is not None)
        for ref in refs:
            self._same_rows(ref, self.rows)
            self._lost(ref, rows, "and hold the fill value there")
        return Track(refs, rows.start, rows.stop, None, 0, self.keys.limit) if refs else None

    def _same_rows(self, ref: ArrayRef, rows: int) -> tuple[int, ...]:
        shape = ref.facts.shape
        if ref.facts.rows != rows or not shape:
            raise DataError(f"{ref}: {shape}, where touch has {rows} rows; correct the file")
        return shape
