"""Rendering of the camera's image of a gel's surface.

The change of each channel from the background is a weighted sum of features of the dent (see
`features`), and the weights are polynomials of the place in the image (see `lighting`). The
camera then blurs and shrinks the drawn image, and adds its tone and noise (see `camera`).
"""

from __future__ import annotations

import numpy as np
import torch
from tactileforge_depth.features import Coarse, fine, normals, places
from tactileforge_depth.lighting import DEGREE
from torch import Tensor
from torch.nn import functional as F

from tactileforge.errors import ConfigError
from tactileforge_sim.optics.camera import FULL, Lens
from tactileforge_sim.optics.sensor_instances import SensorInstance

#: Frames, and pixels of each, per step: as many as fit a processor's cache.
_FRAMES = 8
_TILE = 1 << 13
#: Margin of the bank of noise, pixels: each frame takes a part of it at a random shift.
_MARGIN = 64
#: Depth at which the coating is pressed flat, mm.
_PRESSED = 0.3


class Optics:
    """Images of one unit of a sensor.

    Example:
        >>> import torch
        >>> from tactileforge_sim.optics.sensor_instances import draw_instance
        >>> optics = Optics(draw_instance("digit", seed=3, size=(64, 48)))
        >>> optics.render(torch.zeros(2, 64, 48)).shape
        torch.Size([2, 3, 64, 48])
    """

    def __init__(
        self, unit: SensorInstance, device: str | torch.device = "cpu", shrink: int = 1
    ) -> None:
        """Prepares maps of the weights.

        Args:
            unit: The unit of a sensor, drawn with ``shrink`` times the size of its images.
            device: Device of the dents and the images.
            shrink: Pixels of a dent per pixel of the image, along rows and columns.
        """
        self.unit = unit
        self.size = height, width = unit.background.shape[1], unit.background.shape[2]
        self.shrink = shrink
        self.lens = Lens(unit.camera.blur * min(self.size) / FULL, shrink, device)
        how = unit.calibration
        self._coarse = Coarse(self.size, unit.spacing, how.lights, device)
        ground = places(height, width, DEGREE)
        weights = torch.einsum("kpc,phw->kchw", how.fine, ground)
        self._fine = weights.flatten(2).to(device)
        ground = places(*self._coarse.size, DEGREE)
        self._smooth = torch.einsum("kpc,phw->kchw", how.coarse, ground).to(device)
        self._limits = how.limits[:, None, None].to(device)
        self._background = unit.background.to(device)
        # The lens is linear: it blurs what never changes once, and then only changes.
        self._still = self.lens(self._background[None])
        self._seen = None if unit.seen is None else unit.seen.to(device)
        self._specks = None
        if unit.specks is not None:
            self._specks = F.avg_pool2d(unit.specks, shrink).to(device)
        seed = torch.Generator().manual_seed(unit.seed)
        height, width = self.shown = height // shrink, width // shrink
        bank = torch.randn(3, height + _MARGIN, width + _MARGIN, generator=seed)
        self._noise = (unit.noise * bank).to(device)
        self.markers = unit.markers and unit.markers.to(device)

    def render(
        self,
        dent: Tensor,
        motion: Tensor | None = None,
        first: int | None = None,
        drift: Tensor | None = None,
    ) -> Tensor:
        """Renders images of dents.

        Args:
            dent: float32 (B, H, W), the gel's surface in mm into the gel, 0 at rest.
            motion: Lateral displacement of the surface in mm, right and down: at the markers
                (B, M, 2), or at the pixels (B, H, W, 2). Units without markers ignore it.
            first: Number of the first frame, the seed of its noise; None for no noise.
            drift: float32 (B, 3), change of the light, grey levels; None for none.

        Returns:
            uint8 (B, 3, H, W), RGB; rows and columns are fewer by ``shrink``.

        Raises:
            ConfigError: The size of the dent differs from that of the unit's image.
        """
        if dent.shape[1:] != self.size:
            raise ConfigError(
                f"dents are {tuple(dent.shape[1:])} pixels, but the unit's images are {self.size};"
                " draw the unit with that size"
            )
        pictures = torch.empty(len(dent), 3, *self.shown, dtype=torch.uint8, device=dent.device)
        for start in range(0, len(dent), _FRAMES):
            part = slice(start, start + _FRAMES)
            number = None if first is None else first + start
            moved = None if motion is None else motion[part]
            light = self._light(dent[part], moved)
            if self._specks is not None:
                light += self._specks
            if drift is not None:
                light += drift[part, :, None, None]
            film = self._film(light, number)
            if film.device.type == "cpu" and not film.requires_grad:  # a quarter of the time
                np.copyto(pictures[part].numpy(), film.numpy(), casting="unsafe")
            else:
                pictures[part] = film
        return pictures

    def _light(self, dent: Tensor, motion: Tensor | None) -> Tensor:
        """The light behind the lens, grey levels (B, 3, H, W)."""
        dented = dent.flatten(1).any(1).nonzero().flatten()
        whole = len(dented) == len(dent)
        change = self._change(dent if whole else dent[dented]) if len(dented) else None
        if self.markers is not None:
            out = self._background.repeat(len(dent), 1, 1, 1)
            if change is not None:
                out.index_add_(0, dented, change)
            self.markers.paint(out, motion, self.unit.spacing)
            return self.lens(out)
        if change is not None and whole:
            return self.lens(change).add_(self._still)
        out = self._still.repeat(len(dent), 1, 1, 1)
        return out if change is None else out.index_add_(0, dented, self.lens(change))

    def _change(self, dent: Tensor) -> Tensor:
        """Change of the light by dents, grey levels (B, 3, H, W)."""
        depth = dent
        if self.unit.slope != 1:
            dent = dent / self.unit.slope
        coarse = self._coarse(dent).clamp(-self._limits, self._limits)
        smooth = coarse[:, :1] * self._smooth[0]
        for number, weight in enumerate(self._smooth[1:], 1):
            smooth.addcmul_(coarse[:, number, None], weight)
        out = self._coarse.enlarge(smooth)
        x, y = (
            n.flatten(1) for n in normals(dent, self.unit.spacing, self.unit.calibration.steepest)
        )
        flat = out.flatten(2)
        for start in range(0, x.shape[1], _TILE):
            part = slice(start, start + _TILE)
            for feature, weight in zip(fine(x[:, part], y[:, part]), self._fine, strict=True):
                flat[..., part].addcmul_(feature[:, None], weight[:, part])
        if any(self.unit.face):
            # Flat against an object, the coating shows it: fully from a few tenths of a mm on.
            pressed = (depth / _PRESSED).clamp_(0, 1)
            for channel, change in enumerate(self.unit.face):
                out[:, channel].add_(pressed, alpha=change)
        if self._seen is not None:
            out *= self._seen
        return out

    def _film(self, light: Tensor, first: int | None) -> Tensor:
        """The camera's image of the light behind its lens, float32 (B, 3, H, W)."""
        out = self.unit.camera.tone(light).add_(0.5)
        if first is not None:
            height, width = self.shown
            for number, picture in enumerate(out, first):
                # A part of the bank at a random place: drawing normal numbers costs far more.
                rng = np.random.default_rng([self.unit.seed, number])
                down, right = (int(n) for n in rng.integers(0, _MARGIN, 2))
                picture += self._noise[:, down : down + height, right : right + width]
        # The conversion to uint8 truncates; with the half added above, it rounds.
        return out.clamp_(0, 255)
