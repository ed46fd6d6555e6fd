"""Differences between units for the same touches, with and without a reference press.

Balls of the task Grasp, pressed equally deep into the gels of twelve units of DIGIT, and features
of the frozen ``anytouch2.tiny``: of the pictures as they are, with the gain of the shipped press (a
ball, 2 N), and with that of a press by a travel of 0.6 mm. Told are the spread between units over
that between touches, and the normal force (log) and the kind of ball by ridge regression; three
units at a time are predicted by a fit without them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from common import save
from numpy.typing import NDArray
from tactileforge_bench.fit.probes.ridge_regression import feature_scale, fit_ridge
from tactileforge_policies.envs.fingers import FINGERS, Fingers
from tactileforge_policies.envs.grasp import ball_face
from tactileforge_policies.envs.grip import Body, Grip
from tactileforge_policies.envs.reference import BALL, RADIUS, reference_press
from tactileforge_policies.reference import reference_gain, with_gain
from torch import Tensor

import tactileforge

UNITS, BALLS, FOLDS, SIZE, RATE = 12, 10, 4, 64, 6.0
#: Travel of the press by a travel, mm.
TRAVEL = 0.6
#: Added to a force before its logarithm, N.
_LEAST = 0.1


def balls() -> list[dict[str, Any]]:
    """Soft, rough balls and hard, smooth ones in turns, with two depths each, mm."""
    rng = np.random.default_rng(5)
    out = []
    for number in range(BALLS):
        soft = number % 2 == 0
        ranges = ((0.2, 0.6), (0.6, 1.1)) if soft else ((0.1, 0.4), (0.4, 0.9))
        out.append(
            {
                "soft": soft,
                "radius": rng.uniform(6.6, 7.6),
                "seed": int(rng.integers(1 << 31)),
                "softness": rng.uniform(3.0, 6.0) if soft else 0.0,
                "depths": [rng.uniform(*one) for one in ranges],
                "pose": np.array([*rng.uniform(-1, 1, 2), 0.0]),
            }
        )
    return out


def by_travel(fingers: Fingers) -> dict[str, NDArray[np.uint8]]:
    """Pictures of a press by `TRAVEL`, by finger."""
    grip = Grip(Body(BALL, RADIUS, 0.0, fingers.gel.friction), fingers.gel, RATE)
    grip.place(np.zeros(3), 2 * (RADIUS - TRAVEL))
    fingers.meet(BALL, 0)
    return fingers.pictures(grip.held.moment)


def touched(unit: int) -> list[dict[str, Any]]:
    """Touches of both fingers of a unit, as one row each."""
    fingers, rows = Fingers("digit", unit, SIZE), []
    presses = {"force": reference_press(fingers, RATE), "travel": by_travel(fingers)}
    for number, one in enumerate(balls()):
        shape = ball_face(one["radius"], one["soft"], one["seed"])
        body = Body(shape, one["radius"], 0.2, fingers.gel.friction, one["softness"])
        grip = Grip(body, fingers.gel, RATE)
        fingers.meet(shape, 100 * unit + number)
        rest = fingers.pictures(grip.away().moment)
        gains = {
            kind: {name: reference_gain(rest[name], press[name], name) for name in FINGERS}
            for kind, press in presses.items()
        }
        for depth in one["depths"]:
            grip.place(one["pose"], 2 * (one["radius"] - depth))
            films = [fingers.pictures(grip.held.moment) for _ in range(2)]
            rows += [
                {
                    "unit": unit,
                    "touch": (number, depth),
                    "soft": one["soft"],
                    "force": grip.held.normal,
                    "rest": rest[name],
                    "clip": np.stack([film[name] for film in films] * 2),
                    "gain": {kind: gain[name] for kind, gain in gains.items()},
                }
                for name in FINGERS
            ]
    return rows


@torch.no_grad()
def encoded(encoder: Any, rows: list[dict[str, Any]], kind: str) -> Tensor:
    """Class token, mean and deviation of all tokens, (rows, columns)."""
    clips = [
        with_gain(row["clip"], row["rest"], row["gain"][kind]) if kind else row["clip"]
        for row in rows
    ]
    out = []
    for start in range(0, len(rows), 32):
        frames = torch.from_numpy(np.stack(clips[start : start + 32])).movedim(-1, -3)
        rest = torch.from_numpy(np.stack([row["rest"] for row in rows[start : start + 32]]))
        sensor = encoder.sensor_ids(["digit"] * len(frames))
        tokens = encoder(frames, rest.movedim(-1, -3), sensor)[0]
        out.append(torch.cat([tokens[:, 0], tokens.mean(1), tokens.std(1)], 1))
    return torch.cat(out)


def scaled(known: Tensor) -> Tensor:
    """Features with a mean of 0 and one common scale, float64 (n, columns)."""
    mean, factor = feature_scale(known)
    return ((known - mean) * factor).double()


def left_out(columns: Tensor, truth: Tensor, group: Tensor) -> Tensor:
    """Predictions of ridge regression for each group by the others, (penalties, n, targets)."""
    fit = fit_ridge(columns @ columns.T, truth)
    groups = [(group == one).nonzero().flatten() for one in sorted(set(group.tolist()))]
    return fit.left_out(fit.penalties, groups)


def scores(known: Tensor, rows: list[dict[str, Any]]) -> Mapping[str, float]:
    """Spread between units, and scores of ridge regression on units left out."""
    columns = scaled(known)
    touches = {row["touch"] for row in rows}
    alike = [torch.tensor([row["touch"] == one for row in rows]) for one in touches]
    within = np.mean([float(columns[same].var(0, correction=0).sum()) for same in alike])
    centres = torch.stack([columns[same].mean(0) for same in alike])
    force = np.log([row["force"] + _LEAST for row in rows])
    kind = [1.0 if row["soft"] else -1.0 for row in rows]
    truth = torch.tensor(np.stack([force, kind], 1))
    guesses = left_out(columns, truth, torch.tensor([row["unit"] % FOLDS for row in rows]))
    lost = ((guesses[..., 0] - truth[:, 0]) ** 2).sum(1).min()
    spread = ((truth[:, 0] - truth[:, 0].mean()) ** 2).sum()
    right = (guesses[..., 1].sign() == truth[:, 1]).double().mean(1).max()
    return {
        "between_units_over_touches": round(float(within) / float(centres.var(0).sum()), 3),
        "force_r2": round(1 - float(lost / spread), 3),
        "kind_accuracy": round(float(right), 3),
    }


def main() -> None:
    torch.set_num_threads(1)
    encoder = tactileforge.load("anytouch2.tiny").encoder.eval()
    rows = [row for unit in range(UNITS) for row in touched(unit)]
    kinds = {"as they are": "", "press by 2 N": "force", "press by 0.6 mm": "travel"}
    found: dict[str, Any] = {"units": UNITS, "touches": 2 * BALLS}
    for title, kind in kinds.items():
        found[title] = scores(encoded(encoder, rows, kind), rows)
        print(title, found[title], flush=True)
    save("manipulation_reference_press", found)


if __name__ == "__main__":
    main()
