"""Configuration of a simulated data set: its sensors, shapes, motions and scenes."""

from __future__ import annotations

import ast
import hashlib
import json
import math
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from tactileforge.data import CODECS, SHARD_VERSION
from tactileforge.errors import ConfigError, unknown
from tactileforge.specs import SIMULATED
from tactileforge_sim.geometry.shapes import INDENTERS, Shape, shape
from tactileforge_sim.geometry.textures import TEXTURES
from tactileforge_sim.mechanics.motions import MOTIONS
from tactileforge_sim.mechanics.sensor_gels import sensor_gel
from tactileforge_sim.randomise.draw import randomised_rows
from tactileforge_sim.scene import Scene, draw_scene

#: Words for several indenters.
_GROUPS = ("few", "pretrain", "bench", "textures", "all")
#: Indenters of a small data set, few enough for several touches of each.
FEW = (
    "small_sphere",
    "cylindrical",
    "square_prism",
    "regular_triangular",
    "cross_shaped",
    "ring_shaped",
    "t_shaped",
    "star_shaped_holes",
    "small_sphere_array",
    "rectangular_bar_array",
    "wavy_cylindrical",
    "crescent_shaped",
)
#: Number of the first validation scene. A range of its own keeps validation the same, however many
#: training scenes there are.
FIRST_VAL = 300_000
#: Packages with the code of pictures, and what in them changes none.
_CODE = {
    "tactileforge_sim": ("dataset.py", "sensors", "verbs"),
    "tactileforge_depth": ("reader.py",),
}
#: Motions of a group.
_MOTION_GROUPS = {
    "atomic": tuple(name for name in MOTIONS if name.startswith(("slide", "rotate"))),
    "force_trial": ("force_trial",),
    "manipulation": ("manipulation",),
    "all": tuple(MOTIONS),
}


@dataclass(frozen=True, kw_only=True)
class SimConfig:
    """Configuration of a simulated data set; equal configurations give equal bytes.

    Attributes:
        sensors: Types of sensors; every scene is simulated on all of them.
        indenters: ``pretrain``, ``few`` (twelve of them), ``bench`` (training and validation have
            indenters of their own, as in the paper), ``textures``, ``all``, or names of shapes.
        motions: ``atomic`` (slides and turns), ``force_trial``, ``manipulation``, ``all``, or
            names of motions.
        size: Shorter side of an image, pixels.
        seconds: Mean duration of one action, s.
        force: Range of the largest normal force on a nominal gel, lowest and highest, N; clipped to
            the forces of a shape down to 1.5 mm.
        markers: Whether the gels have markers; None for their types' default.
        viscosity: Relaxation time of the gels, s.
        lag: Delay of the images behind the forces, as from a real camera, s; at least 0, below 1.
        seed: Seed of all touches, 0 or more.
        codec: Codec of the images, see `data.shards.shards.CODECS`.
        randomise: Differences between units and scenes, see `randomise.draw.randomised_rows`.
    """

    sensors: tuple[str, ...]
    indenters: str | tuple[str, ...]
    motions: str | tuple[str, ...]
    size: int
    seconds: float
    force: tuple[float, float]
    markers: bool | None
    viscosity: float
    lag: float
    seed: int
    codec: str = "jpg"
    randomise: str | tuple[str, ...] = "all"

    def __post_init__(self) -> None:
        if not self.sensors:
            raise ConfigError(f"sim: sensors=[] is empty; give some of {', '.join(SIMULATED)}")
        for sensor in self.sensors:
            sensor_gel(sensor)
        if not self.shapes("train") or not self.moves(False):
            raise ConfigError("sim: indenters=[] or motions=[] is empty; give a group or names")
        randomised_rows(self.randomise)
        if self.seed < 0 or self.size < 2:
            raise ConfigError(
                f"sim: seed={self.seed} and size={self.size}; give 0 or more, and 2 or more pixels"
            )
        if not 0 < self.seconds < math.inf or not 0 <= self.viscosity < math.inf:
            raise ConfigError(
                f"sim: actions of {self.seconds} s and viscosity {self.viscosity} s; give more "
                "than 0, and 0 or more"
            )
        if len(self.force) != 2 or not 0 < self.force[0] <= self.force[1] < math.inf:
            raise ConfigError(
                f"sim: force={list(self.force)} N; give the least and the largest, above 0"
            )
        if not 0 <= self.lag < 1:
            raise ConfigError(f"sim: lag is {self.lag} s; give 0 or more, below 1")
        if self.codec not in CODECS:
            raise ConfigError(unknown("codec", self.codec, CODECS))

    def shapes(self, split: str) -> list[Shape]:
        """The shapes of a split."""
        chosen = self.indenters
        if not isinstance(chosen, str):
            return [shape(name) for name in chosen]
        known = list(INDENTERS.values())
        if chosen == "bench":
            wanted = "bench_train" if split == "train" else "bench_test"
            return [s for s in known if s.split == wanted]
        if chosen == "pretrain":
            return [s for s in known if s.split == "pretrain"]
        if chosen == "few":
            return [shape(name) for name in FEW]
        if chosen in ("textures", "all"):
            return [*(known if chosen == "all" else []), *TEXTURES.values()]
        if chosen not in {**INDENTERS, **TEXTURES}:
            raise ConfigError(unknown("indenters", chosen, {*_GROUPS, *INDENTERS, *TEXTURES}))
        return [shape(chosen)]

    def moves(self, is_round: bool) -> list[str]:
        """Names of the motions; without rotations for round shapes, on which they are invisible."""
        chosen = self.motions
        if isinstance(chosen, str):
            chosen = _MOTION_GROUPS.get(chosen, (chosen,))
        for name in chosen:
            if name not in MOTIONS:
                raise ConfigError(unknown("motion", name, {*MOTIONS, *_MOTION_GROUPS}))
        seen = [name for name in chosen if not (is_round and name.startswith("rotate"))]
        return seen or list(chosen)

    def digest(self) -> str:
        """Digest of the configuration and of the simulator's code."""
        text = json.dumps([asdict(self), SHARD_VERSION], sort_keys=True) + _code()
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def scene(self, number: int) -> Scene:
        """A scene by its number; validation starts at `FIRST_VAL`."""
        train = number < FIRST_VAL
        shapes = self.shapes("train" if train else "val")
        place = number if train else number - FIRST_VAL
        # an endless row of permutations: every shape is used before any is repeated
        turn, rest = divmod(place, len(shapes))
        order = np.random.default_rng([self.seed, turn]).permutation(len(shapes))
        chosen = shapes[int(order[rest])]
        moves = self.moves(chosen.round)
        rng = np.random.default_rng([self.seed, number])
        motion = moves[int(rng.integers(len(moves)))]
        seed = int(rng.integers(1 << 31))
        return draw_scene(
            seed,
            chosen,
            motion,
            force=self.force,
            seconds=self.seconds,
            randomise=self.randomise,
            reach="clip",
        )


@lru_cache
def _code() -> str:
    """SHA-256 of the simulator's code and ``.json`` files. Changed code makes new data."""
    digest_of_code = hashlib.sha256()
    for package, apart in _CODE.items():
        folder = Path(str(files(package)))
        for path in sorted(folder.rglob("*")):
            if path.relative_to(folder).parts[0] in apart:
                continue
            if path.suffix in (".py", ".json"):
                text = path.read_text("utf-8")
                kept = _without_words(text) if path.suffix == ".py" else text
                digest_of_code.update(kept.encode())
    return digest_of_code.hexdigest()


def _without_words(source: str) -> str:
    """Code without comments, docstrings and line breaks, as text: these change no picture."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and node.body:
            match node.body[0]:
                case ast.Expr(value=ast.Constant(value=str())):
                    del node.body[0]
    return ast.dump(tree)
