"""Model cards of the zoo, readable without torch.

A card is ``recipe/NAME.md`` of the zoo, or of an installed package of options: YAML front matter,
then text. A model is named ``NAME.TAG``, one of the weights on the card; ``NAME`` alone means the
first of them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml

from tactileforge.errors import ConfigError, unknown
from tactileforge.plugins.distributions import conf_packages, how_to_get
from tactileforge.runs.folder import CONFIG
from tactileforge.util import strict
from tactileforge.util.licences import check_licence

# libyaml, where PyYAML was built with it: every card is read to look up a name
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


#: What models read beside vectors.
READS = ("force", "surface", "words")
#: What a probe reads: the mean of the patch tokens, ``summary`` and ``patches`` as in
#: `Model.features`, or the groups of `Model.groups`, weighed.
READINGS = ("pooled", "summary", "patches", "groups")


@dataclass(frozen=True, kw_only=True)
class Weight:
    """One file of weights. It is shipped (``file``), remote (``url``) or imported (``layout``).

    Attributes:
        tag: The model is called ``card.tag``.
        licence: SPDX identifier, or `licences.NO_LICENCE`.
        sha256: Hash of the one-file checkpoint, 64 hexadecimal digits; "" for imported weights,
            which have none before they are imported.
        bytes: Size of the one-file checkpoint.
        file: Path inside the zoo, of weights that come with the package.
        url: Address of a one-file checkpoint: ``https://``, ``file://``, or
            ``hf://OWNER/REPO/FILE@REVISION``.
        layout: Published layout that the importer has to find in the user's own download.
        encoder: Options that the imported encoder must have, e.g. ``{size: base}``.
        frames: Frames of a clip; 0 for the card's.
        spacing: Seconds between them, where ``frames`` is given.
        source: Place of the published file, for the user to fetch it.
        published: Place of the published file on the model hub, ``OWNER/REPO/FILE@REVISION``, with
            ``datasets/`` before it for a repository of data; a folder ends in ``/``. "" where it is
            elsewhere.
        reads: What it reads beside vectors; see `READS`.
        gated: Whether its authors ask for terms to be accepted first.
        sensors: Types of sensors that these weights saw, where they are not the card's.
        data: Data that they were trained on, likewise.
        demonstration: Whether it only shows how things work: it may then be shipped without
            passing the release gate, and says so wherever it is listed.
        purpose: Purpose of the weights, in a few words; "" takes the first sentence of the card.
        text_encoder: CLIP on the model hub whose text tower they are aligned with; "" for none.
        template: Sentence of a word in the captions of their training, with ``{}`` for the word.
        reading: Features recommended for a probe, by which the release gate judges them; see
            `READINGS`.
        gate: Outcome of the release gate in words, written by `zoo gate` of tactileforge-bench.
    """

    tag: str
    licence: str
    sha256: str = ""
    bytes: int = 0
    file: str = ""
    url: str = ""
    layout: str = ""
    encoder: dict[str, Any] = field(default_factory=dict)
    frames: int = 0
    spacing: float = 0.0
    source: str = ""
    published: str = ""
    reads: list[str] = field(default_factory=list)
    gated: bool = False
    sensors: list[str] = field(default_factory=list)
    data: list[str] = field(default_factory=list)
    demonstration: bool = False
    purpose: str = ""
    text_encoder: str = ""
    template: str = "{}"
    reading: str = "summary"
    gate: str = ""

    @property
    def kind(self) -> str:
        """``shipped``, ``remote`` or ``import``."""
        return "shipped" if self.file else "remote" if self.url else "import"

    @property
    def what_it_reads(self) -> list[str]:
        """What it reads beside vectors; see `READS`."""
        return [*self.reads, *["words"] * bool(self.text_encoder)]


@dataclass(frozen=True, kw_only=True)
class CardResult:
    """One published or measured number.

    Attributes:
        task: Benchmark, task and sensor.
        metric: Name of the metric.
        value: The number.
        unit: Unit of the number; "" for a plain one.
        model: Tag of the weights.
        source: Reference for the number; a page of ``docs/`` for our own measurements.
    """

    task: str
    metric: str
    value: float
    unit: str
    model: str
    source: str

    @property
    def is_ours(self) -> bool:
        """Whether this project measured it."""
        return self.source.startswith("docs/")


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A number of ours for some weights, with its leads.

    Attributes:
        model: Tag of the weights.
        suite: Suite of tasks.
        task: Name of the task in print.
        tokens: Features for the probe; one of `READINGS`.
        metric: Name of the metric, accuracies as shares; ``mean`` for all counted tasks together.
        value: The number.
        chance: Value of a probe without features.
        above: Lead over each thing that it is compared with, by its name in print: the lead, and
            the lower and the upper end of its 95 % interval.
        counted: Whether the mean of all tasks has it.
    """

    model: str
    suite: str
    task: str
    tokens: str
    metric: str
    value: float
    chance: float
    above: dict[str, list[float]]
    counted: bool = True


@dataclass(frozen=True, kw_only=True)
class Card:
    """A model of the zoo.

    Attributes:
        name: The word users type.
        title: Name in print.
        licence: SPDX identifier of what its authors published, or `licences.NO_LICENCE`.
        paper: Title, venue and arXiv number.
        code: Address of its authors' code; "" if none.
        sensors: Types of sensors it was trained on.
        data: Data sets it was trained on.
        frames: Frames of a clip.
        spacing: Seconds between them; 0 for one frame.
        weights: Files of weights, the default first.
        results: Numbers of the paper, or measured.
        measured: Numbers of ours, task by task; `zoo gate` of tactileforge-bench writes them.
        text: The page below the front matter.
        recipe: Whether the zoo has a recipe that trains it.
    """

    name: str
    title: str
    licence: str
    paper: str
    code: str
    sensors: list[str]
    data: list[str]
    frames: int
    spacing: float
    weights: list[Weight]
    results: list[CardResult]
    text: str
    recipe: bool
    measured: list[Measurement] = field(default_factory=list)

    def measurements(self, weight: Weight) -> list[Measurement]:
        """Numbers of ours for some weights."""
        return [row for row in self.measured if row.model == weight.tag]

    def weight(self, tag: str = "") -> Weight:
        """The weights with a tag, or the first.

        Raises:
            ConfigError: No weights at all, or none with that tag.
        """
        if not self.weights:
            train = f"train them: tactileforge train recipe={self.name}" if self.recipe else ""
            raise ConfigError(
                f"model {self.name!r} has no weights; {train or 'choose another model'}"
            )
        for weight in self.weights:
            if tag in ("", weight.tag):
                return weight
        raise ConfigError(unknown(f"weights of {self.name}", tag, (w.tag for w in self.weights)))

    def purpose(self, weight: Weight | None) -> str:
        """Purpose of a file of weights; without one, the first sentence of the card."""
        if weight and weight.purpose:
            return weight.purpose
        paragraph = " ".join(self.text.partition("\n")[2].strip().partition("\n\n")[0].split())
        # a full stop after a capital, as in a name, ends no sentence
        return re.split(r"(?<=[a-z0-9)])\. ", paragraph)[0].rstrip(".")

    def trained_on(self, weight: Weight | None) -> tuple[list[str], list[str]]:
        """Sensors and data seen in training by a file of weights; without its own, the card's."""
        own = weight and weight.sensors, weight and weight.data
        return own[0] or self.sensors, own[1] or self.data

    def clip(self, weight: Weight | None) -> tuple[int, float]:
        """Frames of a clip, and seconds between them, of some weights."""
        source = weight if weight and weight.frames else self
        return source.frames, source.spacing


def zoo_folder() -> Traversable:
    """The zoo's folder."""
    return files("tactileforge.zoo")


def _recipe_folders() -> Iterator[Traversable]:
    """Folders of recipes and cards: the zoo's, and those of installed packages."""
    # first: `read_card` takes the first of two cards with one name
    yield zoo_folder() / "recipe"
    for name in conf_packages():
        # metadata may outlive a package that was removed by hand
        with suppress(ModuleNotFoundError):
            if (folder := files(name) / "recipe").is_dir():
                yield folder


@cache
def card_names() -> tuple[str, ...]:
    """Names of all cards, sorted."""
    found = (item.name for folder in _recipe_folders() for item in folder.iterdir())
    return tuple(sorted({name[:-3] for name in found if name.endswith(".md")}))


@cache
def read_card(name: str) -> Card:
    """The card called ``name``; of two, the zoo's own.

    Raises:
        ConfigError: There is no such card, or it is incomplete.
    """
    if name not in card_names():
        if fix := how_to_get("recipe", name):
            raise ConfigError(f"{name} {fix}")
        raise ConfigError(unknown("model", name, card_names(), "See them: tactileforge zoo list"))
    folder = next(one for one in _recipe_folders() if (one / f"{name}.md").is_file())
    text = (folder / f"{name}.md").read_text("utf-8")
    return parse_card(name, text, (folder / f"{name}.yaml").is_file())


def find_card(model: str) -> tuple[Card, Weight]:
    """Card and weights of a name: ``NAME.TAG``, or ``NAME`` for the default weights.

    Raises:
        ConfigError: Unknown name or tag, or a card without weights.
    """
    name, _, tag = model.partition(".")
    # the name of a card wins over a file that is called so
    if name not in card_names() and (
        "/" in model or model.endswith((".safetensors", ".ckpt", ".pth"))
    ):
        path = Path(model)
        if path.is_dir():
            raise ConfigError(say_folder(path))
        raise ConfigError(f"{model!r} looks like a file; say so: file:{model}")
    card = read_card(name)
    return card, card.weight(tag)


def say_folder(folder: Path) -> str:
    """Error text for a folder in place of a model's name."""
    if (folder / CONFIG).is_file():
        return f"{folder} is the folder of a run; say so: run:{folder}"
    return f"{folder} is a folder: give file:PATH, or run:FOLDER for the folder of a run"


def list_cards(pattern: str = "*") -> list[tuple[str, Card, Weight | None]]:
    """The models with matching names: full name, card and weights.

    A card without weights is listed under its own name.
    """
    rows: list[tuple[str, Card, Weight | None]] = []
    for card in map(read_card, card_names()):
        rows += [(f"{card.name}.{weight.tag}", card, weight) for weight in card.weights]
        rows += [] if card.weights else [(card.name, card, None)]
    return [row for row in rows if fnmatchcase(row[0], pattern)]


def parse_card(name: str, text: str, recipe: bool) -> Card:
    """Reads a card from its text.

    Args:
        name: Name of the card, for errors.
        text: Front matter between two lines of ``---``, then Markdown.
        recipe: Whether the zoo has a recipe of that name.

    Raises:
        ConfigError: A field is missing, unknown or of the wrong type; names it.
    """
    where = f"card {name}"
    match = re.match(r"---\n(.*?)\n---\n(.*)", text, re.S)
    if not match:
        raise ConfigError(f"{where}: does not start with front matter between two lines of ---")
    try:
        front = yaml.load(match[1], _Loader)
    except yaml.YAMLError as error:
        raise ConfigError(f"{where}: {error}") from error
    front = strict.mapping(where, front)
    # few cards have them; the other lists are written even where they are empty
    front.setdefault("measured", [])
    kinds = {"weights": Weight, "results": CardResult, "measured": Measurement}
    for key, kind in kinds.items():
        rows = front.get(key)
        if not isinstance(rows, list):
            raise ConfigError(f"{where}: {key} must be a list")
        front[key] = [strict.build(kind, f"{where}, {key}[{i}]", row) for i, row in enumerate(rows)]
    card = strict.build(
        Card, where, front | {"name": name, "text": match[2].strip(), "recipe": recipe}
    )
    _check(card)
    return card


def _check(card: Card) -> None:
    """Validates the rules beyond the types."""
    where = f"card {card.name}"
    check_licence(f"{where}: licence", card.licence)
    tags = [weight.tag for weight in card.weights]
    for weight in card.weights:
        place = f"{where}, weights {weight.tag!r}"
        check_licence(f"{place}: licence", weight.licence)
        # tags stand in names of files, and on the command line
        if not re.fullmatch(r"[a-z0-9][a-z0-9_-]*", weight.tag) or tags.count(weight.tag) > 1:
            raise ConfigError(f"{place}: tags are lower-case words, each used once")
        if bool(weight.file) + bool(weight.url) + bool(weight.layout) != 1:
            raise ConfigError(f"{place}: give one of file, url and layout")
        if weight.reading not in READINGS:
            raise ConfigError(f"{place}: " + unknown("reading", weight.reading, READINGS))
        if weight.layout and not weight.source:
            raise ConfigError(f"{place}: state in source where the published file is available")
        if strange := [word for word in weight.reads if word not in READS]:
            raise ConfigError(f"{place}: " + unknown("reads", strange[0], READS))
        verified = re.fullmatch(r"[0-9a-f]{64}", weight.sha256) and weight.bytes > 0
        if not weight.layout and not verified:
            raise ConfigError(f"{place}: sha256 (64 hexadecimal digits) and bytes are needed")
    for row in card.measured:
        whole = all(len(lead) == 3 for lead in row.above.values())
        if row.model not in tags or row.tokens not in READINGS or not whole:
            raise ConfigError(
                f"{where}, measured: {row.model} with {row.tokens}: no such weights, tokens that "
                f"are not {' or '.join(READINGS)}, or a lead without the ends of its interval; "
                "write them with tactileforge zoo gate"
            )
    # None: the clip of the card itself
    for weighed in [None, *card.weights]:
        frames, spacing = card.clip(weighed)
        spaced = 0 < spacing < math.inf if frames > 1 else spacing == 0
        if frames < 1 or not spaced:
            raise ConfigError(
                f"{where}: frames={frames} and spacing={spacing}: one frame has spacing 0, several "
                "have seconds between them"
            )
