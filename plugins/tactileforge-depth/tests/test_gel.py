import math

import pytest
import torch
import torch.nn.functional as F
from tactileforge_depth.gel import Gel, compliance, kernel
from torch import Tensor

from tactileforge.errors import ConfigError


@pytest.mark.parametrize("poisson", [0.3, 0.45, 0.49])
def test_short_waves_do_not_feel_the_back(poisson: float) -> None:
    gel = Gel(poisson=poisson)
    wave = torch.tensor([5.0, 10.0], dtype=torch.float64)
    of = compliance(gel, wave)
    shear = gel.shear_modulus
    torch.testing.assert_close(of.normal, (1 - poisson) / (shear * wave), rtol=1e-5, atol=0)
    torch.testing.assert_close(of.along, (1 - poisson) / (shear * wave), rtol=1e-5, atol=0)
    torch.testing.assert_close(of.across, 1 / (shear * wave), rtol=1e-5, atol=0)
    half_space = (1 - 2 * poisson) / (2 * shear * wave)
    torch.testing.assert_close(of.coupling, half_space, rtol=1e-3, atol=0)


def test_long_waves_shear_the_layer_and_confine_it() -> None:
    gel = Gel(poisson=0.3)
    of = compliance(gel, torch.tensor([0.0, 1e-3], dtype=torch.float64))
    confined = gel.modulus * (1 - 0.3) / ((1 + 0.3) * (1 - 2 * 0.3))
    for part, wanted in (
        (of.normal, gel.thickness / confined),
        (of.along, gel.thickness / gel.shear_modulus),
        (of.across, gel.thickness / gel.shear_modulus),
    ):
        torch.testing.assert_close(part, torch.full_like(part, wanted), rtol=1e-4, atol=0)


@pytest.mark.parametrize("k", [0.2, 1.0, 3.0, 8.0])
@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_compliance_solves_the_equations_of_elasticity(k: float, poisson: float) -> None:
    """Against a plane-strain layer integrated from its bonded back to its surface."""
    gel = Gel(thickness=2.0, poisson=poisson)
    q, shear = k / gel.thickness, gel.shear_modulus
    lame = 2 * shear * poisson / (1 - 2 * poisson)
    stiff = lame + 2 * shear
    # State: i u, w, i tau, sigma (all real for one wave), with z from the back to the surface.
    a = torch.tensor(
        [
            [0, q, 1 / shear, 0],
            [-q * lame / stiff, 0, 0, 1 / stiff],
            [q * q * (stiff - lame**2 / stiff), 0, 0, q * lame / stiff],
            [0, 0, -q, 0],
        ],
        dtype=torch.float64,
    )
    from_back = torch.linalg.matrix_exp(a * gel.thickness)
    yields = from_back[:2, 2:] @ torch.linalg.inv(from_back[2:, 2:])
    of = compliance(gel, torch.tensor([q], dtype=torch.float64))
    assert float(of.normal) == pytest.approx(float(yields[1, 1]), rel=1e-8)
    assert float(of.along) == pytest.approx(float(yields[0, 0]), rel=1e-8)
    assert abs(float(of.coupling)) == pytest.approx(abs(float(yields[0, 1])), rel=1e-6, abs=1e-9)


def test_incompressible_gel_moves_away_from_a_press() -> None:
    grid = kernel(Gel(poisson=0.49), 32, 0.4)
    pressure = torch.zeros(32, 32)
    pressure[14:18, 14:18] = 0.1
    right, down = grid.spread(pressure)
    assert float(right[16, 24]) > 0 > float(right[16, 7])
    assert float(down[24, 16]) > 0 > float(down[7, 16])


def test_solver_convolves_as_padded_fourier_transforms_do() -> None:
    grid = kernel(Gel(thickness=2.0), 26, 0.2)
    # The shortest wave of the grid is neither odd nor even: there both are inexact.
    spot = torch.tensor([1.0, 2.0, 1.0]) / 4
    rough = F.pad(torch.randn(6, 1, 24, 24, generator=torch.Generator().manual_seed(0)), (2,) * 4)
    smooth = F.conv2d(rough, (spot[:, None] * spot)[None, None])
    pressure, shear = smooth[:2, 0], smooth[2:].view(2, 2, 26, 26)

    def spectrum(field: Tensor) -> Tensor:
        return torch.fft.rfft2(field, s=(52, 52))

    def back(field: Tensor) -> Tensor:
        return torch.fft.irfft2(field, s=(52, 52))[..., :26, :26]

    pressed, dragged = spectrum(pressure), spectrum(shear)
    wanted = {
        "press": (grid.press(pressure), grid.normal * pressed),
        "drag": (grid.drag(shear), grid.dragged(dragged)),
        "spread": (grid.spread(pressure), 1j * grid.coupling * pressed[:, None]),
        "lift": (grid.lift(shear), grid.lifted(dragged)),
    }
    for name, (found, there) in wanted.items():
        exact = back(there)
        torch.testing.assert_close(
            found, exact, rtol=0, atol=2e-6 * float(exact.abs().max()), msg=name
        )


def test_kernel_does_not_wrap() -> None:
    grid = kernel(Gel(thickness=1.0), 64, 0.25)
    pressure = torch.zeros(64, 64)
    pressure[:, 0] = 1
    far = grid.press(pressure)[:, -1]
    assert float(far.abs().max()) < 1e-4 * float(grid.press(pressure)[:, 0].max())


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"modulus": 0.0}, "modulus is 0.0, but must be greater than 0"),
        ({"thickness": -1.0}, "thickness is -1.0"),
        ({"thickness": math.nan}, "thickness is nan"),
        ({"poisson": 0.5}, "poisson is 0.5, but must be in 0 to below 0.5"),
        ({"friction": -0.1}, "friction is -0.1, but must not be < 0"),
        ({"dome": 0.0}, "dome is 0.0"),
    ],
)
def test_impossible_gels_are_named(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        Gel(**wrong)


def test_impossible_grid_is_named() -> None:
    with pytest.raises(ConfigError, match="1 points"):
        kernel(Gel(), 1, 0.1)
