"""Augmentation with consistent labels: a mirrored touch has a mirrored force.

Which clips are changed is drawn on the host, where labels and captions are changed with them; the
pixels follow on the device. Pictures of taxel arrays stay unchanged: their colours are forces,
and a mirrored force has another colour.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.contracts import ACTIONS, Batch, Column
from tactileforge.data.labels import displacement, pixels
from tactileforge.data.labels.caption_directions import (
    LANGUAGES,
    mirrored_caption,
    undeclared_words,
)
from tactileforge.data.labels.turns import (
    SLIDE_SLACK,
    flip_labels,
    frame_change,
    rotation,
    turn_columns,
    turn_labels,
)
from tactileforge.errors import ConfigError, check_names
from tactileforge.specs.published import spec

log = logging.getLogger(__name__)

#: Phrases of captions by action; "" stands for an unknown one.
PHRASES = {
    "press": "pressing",
    "leave": "leaving",
    "slide_left": "sliding left",
    "slide_right": "sliding right",
    "slide_up": "sliding up",
    "slide_down": "sliding down",
    "rotate_cw": "rotating clockwise",
    "rotate_ccw": "rotating counter-clockwise",
    "": "touching",
}
#: Largest value of each range: degrees, shares, pixels, grey levels.
_MOST = {
    "rotate": 180.0,
    "shift": 0.5,
    "scale": 1.0,
    "blur": 10.0,
    "gain": 0.9,
    "colour": 0.9,
    "noise": 50.0,
}


def fill_captions(batch: Batch) -> None:
    """Replace ``{action}`` in captions by the phrase of the clip's action, in place."""
    actions = [ACTIONS[i] if i >= 0 else "" for i in batch["action"].tolist()]
    batch["text"] = [
        text.replace("{action}", PHRASES[action])
        for text, action in zip(batch["text"], actions, strict=True)
    ]


#: Degrees from which left may become up.
_TURN = 45.0


class Augment(nn.Module):
    """Changes of whole clips: all frames and the background are treated alike.

    Forces, actions, surfaces and the columns that turn follow a mirror and a turn. A shift and a
    scale move the picture as another place or lens of the camera would: newtons, millimetres and
    poses stay. Clips of taxel arrays stay unchanged. Clips marked ``upright``, and those that
    are paired with one of these or of an array, are not mirrored, turned, shifted or scaled.
    Captions follow: see `caption_directions.mirrored_caption`.

    Args:
        horizontal: Chance of a flip left to right.
        vertical: Chance of a flip top to bottom.
        rotate: Largest turn to either side, degrees, up to 180; 0 for none, as below.
        shift: Largest shift along each side, in shares of that side.
        scale: Largest magnification less 1: with 0.25 from 1/1.25 to 1.25.
        blur: Largest deviation of a Gaussian blur, pixels of the encoder's input.
        gain: Largest relative change of brightness.
        colour: Largest relative change of red, green and blue, each by itself.
        noise: Largest deviation of the noise of frames, grey levels of 255.
        chance: Share of the clips for which each of these seven is drawn, by name; 1 where absent.
        jitter: Largest relative change of brightness, contrast and saturation; 0 for none.
        languages: Languages of captions, of `caption_directions.LANGUAGES`.
        also: Further changes by key, called with every batch, on its device, after those above:
            each returns the batch, or what it changes of it.

    Raises:
        ConfigError: A chance or range is out of bounds, or a name in ``chance`` or a language is
            unknown.
    """

    def __init__(
        self,
        horizontal: float = 0.5,
        vertical: float = 0.5,
        rotate: float = 0.0,
        shift: float = 0.0,
        scale: float = 0.0,
        blur: float = 0.0,
        gain: float = 0.0,
        colour: float = 0.0,
        noise: float = 0.0,
        chance: Mapping[str, float] | None = None,
        jitter: float = 0.0,
        languages: Sequence[str] = ("en",),
        also: Mapping[str, Callable[[Batch], Mapping[str, Any]]] | None = None,
    ) -> None:
        super().__init__()
        check_names("language of augment.languages", languages, LANGUAGES)
        self.languages = tuple(languages)
        self._is_said = False
        self.horizontal, self.vertical = horizontal, vertical
        self.rotate, self.shift, self.scale = rotate, shift, scale
        self.blur, self.gain, self.colour, self.noise = blur, gain, colour, noise
        self.chance = dict.fromkeys(_MOST, 1.0) | dict(chance or {})
        self._check(jitter)
        self._moves = bool(rotate or shift or scale)
        self._lights = bool(blur or gain or colour or noise)
        self.also = dict(also or {})
        self.of_others = nn.ModuleList(x for x in self.also.values() if isinstance(x, nn.Module))
        self.jitter: nn.Module | None = None
        if jitter:
            # imported here: kornia takes seconds, and most recipes have no jitter
            from kornia.augmentation import ColorJiggle, VideoSequential

            self.jitter = VideoSequential(
                ColorJiggle(jitter, jitter, jitter, 0.0, p=0.8),
                data_format="BTCHW",
                same_on_frame=True,
            )

    @property
    def changes(self) -> bool:
        """Whether any clip is ever changed."""
        flips = self.horizontal or self.vertical
        own = self._moves or self._lights or self.jitter is not None
        return bool(flips or own or self.also)

    @property
    def moved_sides(self) -> tuple[str, ...]:
        """Changes that exchange the sides of a clip: ``horizontal``, ``vertical``, ``turn``."""
        given = self.horizontal, self.vertical, self.rotate >= _TURN
        return tuple(
            name
            for name, is_on in zip(("horizontal", "vertical", "turn"), given, strict=True)
            if is_on
        )

    def _check(self, jitter: float) -> None:
        check_names("key of augment.chance", self.chance, _MOST)
        shares = {"horizontal": self.horizontal, "vertical": self.vertical, "jitter": jitter}
        shares |= {f"chance.{name}": value for name, value in self.chance.items()}
        bounds = {name: (value, 1.0) for name, value in shares.items()}
        bounds |= {name: (getattr(self, name), most) for name, most in _MOST.items()}
        for name, (value, most) in bounds.items():
            if not isinstance(value, int | float) or not 0 <= value <= most:
                raise ConfigError(f"augment.{name}={value}: give a number from 0 to {most:g}")

    def labels(self, batch: Batch, columns: Iterable[Column] = ()) -> Batch:
        """Draws the changes on the host, and changes the labels accordingly.

        Clips of one matching group are moved alike: a pair of one action stays one. Adds ``flip``,
        bool (B, 2): horizontal, vertical; and ``coded``, bool (B,): of taxel arrays. Where a range
        is above 0 it also adds ``warp`` and ``warp_turn`` (see `pixels.move_surface`), or
        ``relight`` (see `pixels.light_clip`).

        Args:
            batch: On the host.
            columns: Columns of the batch.
        """
        group = batch["group"]
        coded = torch.tensor([spec(name).kind == "array" for name in batch["sensor"]])
        still = coded | batch["upright"]
        fixed = still | ((group[:, None] == group) & (group >= 0) & still).any(1)
        first = (group[:, None] == group).int().argmax(dim=1)
        first = torch.where(group >= 0, first, torch.arange(len(group)))
        # drawn for all clips: so the random numbers used do not depend on the pairs
        draw = torch.rand(len(group), 2)[first]
        flip = (draw < torch.tensor([self.horizontal, self.vertical])) & ~fixed[:, None]
        flip_labels(batch, flip[:, 0], flip[:, 1])
        angle = torch.zeros(len(group))
        drawn: Batch = {"flip": flip, "coded": coded}
        if self._moves:
            angle, drawn["warp"] = self._draw_moves(first, fixed, batch["aspect"])
            drawn["warp_turn"] = rotation(angle)
            turn_labels(batch, angle)
        self._change_captions(batch, flip, angle)
        if self._lights:
            drawn["relight"] = self._draw_light(coded)
        # a mirror first, then a turn, as `forward` treats the pixels
        turn_columns(batch, columns, frame_change(flip, angle), flip, drawn.get("warp"))
        return batch | drawn

    def _change_captions(self, batch: Batch, flip: Tensor, angle: Tensor) -> None:
        """Change the captions of mirrored and turned clips in place, or leave them out."""
        texts = list(batch.get("text", ()))
        if not texts or not (self.horizontal or self.vertical or self.rotate):
            return
        turned = (angle.abs() > SLIDE_SLACK).tolist()
        for i, (text, (across, along)) in enumerate(zip(texts, flip.tolist(), strict=True)):
            if not text or not (across or along or turned[i]):
                continue
            texts[i] = mirrored_caption(text, across, along, turned[i], self.languages)
            if not self._is_said and (word := undeclared_words(text, self.languages)):
                self._is_said = True
                log.warning(
                    "captions have %s, of no language in augment.languages=[%s]: in mirrored clips "
                    "its directions stay as they are, and are wrong; add the language (%s), or "
                    "leave mirrors out: augment.horizontal=0 augment.vertical=0",
                    word,
                    ",".join(self.languages),
                    ", ".join(LANGUAGES),
                )
        batch["text"] = texts

    def _draw_moves(self, first: Tensor, fixed: Tensor, aspect: Tensor) -> tuple[Tensor, Tensor]:
        """Angles (B,), degrees, and warps (B, 2, 3); the first clip of a group draws for all."""
        is_drawn = self._is_drawn(("rotate", "shift", "scale"), len(first))[first]
        is_drawn &= ~fixed[:, None]
        draw = torch.where(is_drawn[:, [0, 1, 1, 2]], 2 * torch.rand(len(first), 4)[first] - 1, 0.0)
        angle = self.rotate * draw[:, 0]
        # even in the logarithm: as often larger as smaller by one factor
        factor = torch.exp(math.log1p(self.scale) * draw[:, 3])
        linear = rotation(angle)[:, :2, :2] * factor[:, None, None]
        # shares of width and height are not of one length where the frames are not square
        sides = torch.stack([aspect, torch.ones_like(aspect)], dim=1)
        linear = linear * sides[:, None] / sides[:, :, None]
        return angle, torch.cat([linear, self.shift * draw[:, 1:3, None]], dim=2)

    def _draw_light(self, coded: Tensor) -> Tensor:
        """Factors of the channels and deviations of blur and noise, (B, 5)."""
        names = ("gain", "colour", "blur", "noise")
        is_drawn = self._is_drawn(names, len(coded)) & ~coded[:, None]
        signed = torch.where(is_drawn[:, [0, 1, 1, 1]], 2 * torch.rand(len(coded), 4) - 1, 0.0)
        spread = torch.where(is_drawn[:, 2:], torch.rand(len(coded), 2), 0.0)
        factors = (1 + self.gain * signed[:, :1]) * (1 + self.colour * signed[:, 1:])
        return torch.cat([factors, spread * torch.tensor([self.blur, self.noise])], dim=1)

    def _is_drawn(self, names: tuple[str, ...], clips: int) -> Tensor:
        """Whether each change is drawn for each clip, bool (B, names)."""
        return torch.rand(clips, len(names)) < torch.tensor([self.chance[name] for name in names])

    @torch.no_grad()
    def forward(self, batch: Batch) -> Batch:
        """Changes the pixels on the device; frames and background stay uint8."""
        clip = torch.cat([batch["background"][:, None], batch["frames"]], dim=1)
        for axis, dim in ((0, -1), (1, -2)):
            flipped = batch["flip"][:, axis, None, None, None, None]
            clip = torch.where(flipped, clip.flip(dim), clip)
        if self._moves or self._lights:
            with torch.autocast(clip.device.type, enabled=False):  # bf16 has no 256 levels
                clip = clip.to(torch.float32, memory_format=torch.contiguous_format)
                if self._moves:
                    clip = pixels.move_clip(clip, batch["warp"])
                if self._lights:
                    clip = pixels.light_clip(clip, batch["relight"], self.blur, self.noise > 0)
                clip = pixels.as_levels(clip)
        if self.jitter is not None:
            jittered: Any = self.jitter(clip.float() / 255)
            jittered = (jittered * 255).round().clamp(0, 255).to(torch.uint8)
            clip = torch.where(batch["coded"][:, None, None, None, None], clip, jittered)
        moved: Batch = {"background": clip[:, 0], "frames": clip[:, 1:]}
        if "surface" in batch:
            surface: Tensor = batch["surface"]
            for axis in (0, 1):
                flipped = batch["flip"][:, axis, None, None, None, None]
                mirrored = displacement.mirror_displacement(surface, axis)
                surface = torch.where(flipped, mirrored, surface)
            if self._moves:
                with torch.autocast(surface.device.type, enabled=False):
                    surface = pixels.move_surface(surface, batch["warp"], batch["warp_turn"])
            moved["surface"] = surface
        batch = batch | moved
        for key, change in self.also.items():
            batch = self._changed_also(key, change, batch)
        return batch

    @staticmethod
    def _changed_also(
        key: str, change: Callable[[Batch], Mapping[str, Any]], batch: Batch
    ) -> Batch:
        made = change(dict(batch))
        if not isinstance(made, Mapping):
            raise ConfigError(
                f"augment.also.{key} returned {type(made).__name__}: return the batch, or a "
                "dictionary of what changes in it"
            )
        for name in ("frames", "background"):
            old, new = batch[name], made.get(name, batch[name])
            if new.shape != old.shape or new.dtype != torch.uint8:
                raise ConfigError(
                    f"augment.also.{key} made {name} {new.dtype} {tuple(new.shape)}: return uint8 "
                    f"{tuple(old.shape)}"
                )
        return {**batch, **made}


def build_augment(options: Mapping[str, Any] | None) -> Augment | None:
    """The augmentation of a run; None where its options change nothing.

    Args:
        options: Arguments of `Augment` by name; None for none.

    Raises:
        ConfigError: A value is out of bounds, as for `Augment`.
    """
    augment = Augment(**options) if options else None
    return augment if augment and augment.changes else None
