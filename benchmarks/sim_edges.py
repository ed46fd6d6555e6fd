"""Pictures of edges against a reference: the same gel, solved on a grid four times finer.

Twelve indenters with edges are pressed 0.5 mm into a GelSight Mini. The reference is the solution
at a spacing of 0.05 mm, without refinement or smoothing, through the same optics. The scores are
PSNR in the contact and a rim around it (dB), for pictures of 64, 128 and 240 rows, and the
deviation of the surface (micrometre) at 240. Writes docs/assets/sim_edges.jpg too: ours, the
reference, and eight times their difference.

Run: python benchmarks/sim_edges.py
"""

from __future__ import annotations

from pathlib import Path

import torch
import torch.nn.functional as F
from common import save
from PIL import Image
from tactileforge_depth.gel import Gel, kernel
from tactileforge_sim.geometry.shapes import shape
from tactileforge_sim.mechanics.sensor_gels import sensor_gel
from tactileforge_sim.mechanics.surface import DETAIL, GelSurface
from tactileforge_sim.mechanics.touch import ContactState, contacts
from tactileforge_sim.optics.render import Optics
from tactileforge_sim.optics.sensor_instances import SensorInstance, draw_instance
from tactileforge_sim.scene import POINTS, SPACING
from torch import Tensor

SENSOR = "gelsight_mini"
NAMES = (
    "square_prism",
    "small_square_array",
    "one_quarter_cylindrical",
    "ring_shaped",
    "pentagram",
    "t_shaped",
    "cross_shaped",
    "hexagonal",
    "dense_circular_holes_68",
    "star_shaped_holes",
    "clover_shaped",
    "crescent_shaped",
)
SHOWN = 8
ASSET = Path(__file__).parents[1] / "docs" / "assets" / "sim_edges.jpg"


def pressed(name: str, detail: int) -> ContactState:
    """A press on the grid of scenes, or on a finer one."""
    poses = torch.zeros(1, 3, 6)
    poses[0, :, 3] = torch.tensor([-0.05, 0.25, 0.5])
    poses[..., 0], poses[..., 2] = 0.37, 0.3
    heights = torch.from_numpy(shape(name).map(POINTS * detail, SPACING / detail))[None]
    gel = sensor_gel(SENSOR).touched(0.5)
    *_, moment = contacts(heights, SPACING / detail, [gel], poses, [30.0])
    return moment


def reference(moment: ContactState, places: Tensor) -> Tensor:
    """The solver's displacement at places of the picture, mm."""
    n = moment.strain.shape[-1]
    layer = kernel(Gel(modulus=1.0), n, SPACING / DETAIL)
    pressure, shear = (
        torch.fft.rfft2(F.pad(part, (n // 2,) * 4))
        for part in (moment.strain[:, :1], moment.strain[:, 1:])
    )
    field = torch.fft.irfft2(layer.normal * pressure + layer.lifted(shear)[:, None])
    x, y = (places - moment.pose[:, None, None, :2]).unbind(-1)
    angle = moment.pose[:, 2, None, None]
    cos, sin = torch.cos(angle), torch.sin(angle)
    there = torch.stack([cos * x + sin * y, cos * y - sin * x], -1) * DETAIL / SPACING
    return F.grid_sample(field, there / n, align_corners=False)[:, 0]


def grid(unit: SensorInstance) -> Tensor:
    """Places of the pixels of a unit, mm."""
    _, height, width = unit.background.shape
    return unit.camera.places(height, width, unit.spacing)


def compared(name: str) -> tuple[dict[str, float], Tensor]:
    """Scores of an indenter, and the three pictures side by side at 240 rows."""
    fine = torch.from_numpy(shape(name).map(POINTS * DETAIL, SPACING / DETAIL))[None]
    surface = GelSurface(fine, SPACING, sensor_gel(SENSOR).gel)
    coarse, exact = pressed(name, 1), pressed(name, DETAIL)
    row = {}
    for size in (64, 128, 240):
        unit = draw_instance(SENSOR, 0, (size, size * 4 // 3), False, randomise="none")
        ours = surface.picture(surface.fields(coarse), coarse, grid(unit))
        wanted = reference(exact, grid(unit))
        seen, known = (Optics(unit).render(dent).float() for dent in (ours, wanted))
        rim = size // 24
        near = F.max_pool2d((wanted > 0.02).float(), 2 * rim + 1, 1, rim)[0] > 0
        error = (seen - known)[..., near].square().mean()
        row[f"PSNR {size}"] = round(float(10 * torch.log10(255**2 / error)), 1)
    row["um"] = round(1000 * float((ours - wanted)[:, near].square().mean().sqrt()), 1)
    apart = (128 + 8 * (seen - known)).clamp(0, 255)
    return row, torch.cat([seen[0], known[0], apart[0]], -1)


def main() -> None:
    found, rows = {}, []
    for name in NAMES:
        found[name], picture = compared(name)
        rows.append(picture)
        print(name, found[name], flush=True)
    half = SHOWN // 2
    sheet = torch.cat([torch.cat(rows[:half], -2), torch.cat(rows[half:SHOWN], -2)], -1)
    Image.fromarray(sheet.byte().permute(1, 2, 0).numpy()).save(ASSET, quality=88)
    save("sim_edges", {"what": __doc__, "sensor": SENSOR, "indenters": found})


if __name__ == "__main__":
    main()
