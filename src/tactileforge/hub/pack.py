"""Packs runs and published files into one-file checkpoints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Literal

from torch import Tensor, nn

from tactileforge import registry, run_folder
from tactileforge.checkpoint_file import read_own
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, unknown
from tactileforge.files import new_part, sha256, writing
from tactileforge.hub import cards, files, store
from tactileforge.provenance import commit
from tactileforge.sensors.specs import spec

#: Heads that are kept: `Model` reads force and surface, and a run that starts from the file goes on
#: with all of them.
KEPT_HEADS = ("pixel", "diff", "surface", "force", "classify")


def pack_run(
    run: str | Path,
    out: str | Path | None = None,
    *,
    dtype: Literal["float32", "float16"] = "float32",
    name: str = "",
    licence: str = cards.NO_LICENCE,
    encoder: Literal["trained", "slow"] | None = None,
) -> Path:
    """Makes a one-file checkpoint of a run's encoder, with the heads of use alone.

    V-JEPA and DINO are published and evaluated by the slow copy of the encoder, which the
    objective's head keeps (`heads.ema.EMA`), so that is what is packed where there is one.
    A head is kept beside the encoder that it was trained on, and not beside a slow copy. The
    sensors are those that the run was trained on.

    Args:
        run: Folder of the run: its ``config.yaml`` and last checkpoint are read.
        out: The file; None for ``model.safetensors`` in the run.
        dtype: Type in which numbers are kept.
        name: Name of the model.
        licence: SPDX identifier of the weights.
        encoder: ``trained``, the encoder that the optimiser changed, or ``slow``, its slow copy;
            None takes the slow copy where the run has one. The header says which it is.

    Returns:
        The file.

    Raises:
        DataNotFoundError: The folder is not that of a run.
        DataError: Checkpoint and configuration do not fit.
        ConfigError: See `files.save`; or no slow copy, or several.
    """
    run = Path(run)
    path = Path(out) if out is not None else run / "model.safetensors"
    config = _config(run)
    kept = run_folder.read_versions(run)
    if (known := config["encoder"].get("sensors")) and (trained := kept.get("sensors")):
        # rows of other sensors were never trained
        config["encoder"]["sensors"] = {name: known[name] for name in known if name in trained}
    checkpoint = read_own(run, config.pop("run", None), ("global_step",))
    kind, state = _choose(checkpoint["state_dict"], encoder, run)
    built = registry.build("encoders", config["encoder"])
    files.fill_weights(built, state, str(run))
    heads = _heads(config, built, checkpoint["state_dict"], run) if kind == "trained" else {}
    header = files.make_header(
        built,
        config["encoder"],
        licence=licence,
        spacing=config["batch"]["spacing"] if built.frames > 1 else 0.0,
        name=name,
        commit=kept.get("commit") or commit(),
        versions=kept.get("versions", {}),
        data={"name": config["data"]["name"], "licences": kept.get("licences", [])},
        recipe=_without_folders(config),
        source={"steps": checkpoint["global_step"], "encoder": kind},
        heads={
            name: _entry(name, config["head"][name], built.sensors or kept.get("sensors", ()))
            for name in heads
        },
    )
    files.save_checkpoint(path, built, header, dtype, heads)
    return path


def _entry(name: str, node: Mapping[str, Any], sensors: Iterable[str]) -> dict[str, Any]:
    entry: dict[str, Any] = {"node": node}
    return entry | {"scale": _scales(sensors)} if name == "force" else entry


def _heads(
    config: Mapping[str, Any], encoder: Any, state: Mapping[str, Tensor], run: Path
) -> dict[str, nn.Module]:
    """The trained heads of a run to keep, by name."""
    heads: dict[str, nn.Module] = {}
    for name in KEPT_HEADS:
        node = config.get("head", {}).get(name)
        if node and node["name"] == name:
            heads[name] = registry.build("heads", node, encoder=encoder)
            files.fill_weights(heads[name], _below(f"heads.{name}.", state), f"{run}, head {name}")
    return heads


def _scales(sensors: Iterable[str]) -> dict[str, list[float]]:
    """Force scale of each sensor, the newtons per unit; skips sensors without installed plugin."""
    scales = {}
    for name in sensors:
        with suppress(ConfigError):
            scales[name] = list(spec(name).force_scale)
    return scales


def _choose(
    state: Mapping[str, Tensor], wanted: str | None, run: Path
) -> tuple[str, dict[str, Tensor]]:
    """Chooses the encoder of a run to pack, ``trained`` or ``slow``, and its state."""
    if wanted not in ("trained", "slow", None):
        raise ConfigError(unknown("encoder", wanted, ("trained", "slow")))
    trained = _below("encoder.", state)
    first = next(iter(trained), "")
    places = [key.removesuffix(first) for key in state if key.endswith(f".network.{first}")]
    slow = [place for place in places if _below(place, state).keys() == trained.keys()]
    if wanted == "trained" or (wanted is None and not slow):
        return "trained", trained
    if len(slow) == 1:
        return "slow", _below(slow[0], state)
    copies = ", ".join(place.removesuffix(".network.") for place in slow) or "none"
    raise ConfigError(
        f"{run}: expected one slow copy of the encoder, found {copies}; give encoder=trained"
    )


def _below(prefix: str, state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Subset of a state under a prefix, with the prefix removed."""
    return {key.removeprefix(prefix): x for key, x in state.items() if key.startswith(prefix)}


def import_published(model: str, source: str | Path, sensor: str = "") -> Path:
    """Imports a published file of the user's own into the cache, as a model of the zoo.

    Args:
        model: ``NAME.TAG``, or ``NAME``.
        source: The file as its authors publish it; its heads are imported with the encoder.
        sensor: Sensor of its force head's training, where the name of the file does not say.

    Returns:
        The one-file checkpoint; `tactileforge.load` finds it by its name from now on.

    Raises:
        ConfigError: The model is not one that is imported, or the sensor of its forces is not
            known.
        DataError: The file is not what the model's authors publish; says what it is.
        DataNotFoundError: There is no such file.
    """
    card, weight = cards.find_card(model)
    full = f"{card.name}.{weight.tag}"
    if not weight.layout:
        raise ConfigError(f"{full} is {weight.kind}, not imported: tactileforge.load({full!r})")
    source = Path(source)
    if not source.exists():
        raise DataNotFoundError(f"{source}: no such file; download it from {weight.source}")
    from tactileforge.encoders import published
    from tactileforge.hub.published_heads import published_heads

    try:
        converted = published.convert(published.read_tensors(source))
    except ConfigError as error:
        raise DataError(f"{source}: {error}") from error
    node = dict(converted.encoder_config)
    # before the encoder is built: that of another variant would be built in vain
    _check_variant(card, weight, converted.name, node, source)
    encoder = registry.build("encoders", node)
    files.fill_weights(encoder, converted.state, str(source))
    heads, entries = published_heads(converted, encoder, source, sensor)
    digest = sha256(source) if source.is_file() else ""
    header = files.make_header(
        encoder,
        node,
        licence=weight.licence,
        spacing=encoder.spacing,
        name=full,
        commit=commit(),
        versions={"tactileforge": version("tactileforge")},
        data={"name": ", ".join(card.data), "licences": []},
        source={"file": source.name, "sha256": digest, "layout": converted.name},
        heads=entries,
    )
    target = store.weights_folder() / f"{full}.safetensors"
    with writing(target), new_part(target) as part:
        files.save_checkpoint(part, encoder, header, heads=heads)
        return store.keep_import(card, weight, part, source.name, digest)


def _check_variant(
    card: cards.Card, weight: cards.Weight, layout: str, node: Mapping[str, Any], source: Path
) -> None:
    """Raises a DataError if the file belongs to another model or variant."""
    wanted = _variant(card, weight)
    variant = {"layout": layout, **{key: node.get(key) for key in wanted if key != "layout"}}
    if variant == wanted:
        return
    other = {**node, "layout": layout}
    fits = [
        name
        for name, of, row in cards.list_cards()
        if row and all(other.get(key) == value for key, value in _variant(of, row).items())
    ]
    hint = f"; it fits {' or '.join(fits)}" if fits else ""
    raise DataError(f"{source} is {variant}, but {card.name}.{weight.tag} is {wanted}{hint}")


def _variant(card: cards.Card, weight: cards.Weight) -> dict[str, Any]:
    """Configuration of these weights, for an importer to detect."""
    return {"layout": weight.layout, "frames": card.clip(weight)[0], **weight.encoder}


def _without_folders(value: Any) -> Any:
    """Strips folders from absolute paths: they are private and meaningless elsewhere."""
    if isinstance(value, Mapping):
        return {str(key): _without_folders(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_folders(item) for item in value]
    if isinstance(value, str):
        for kind in (PurePosixPath, PureWindowsPath):
            if kind(value).is_absolute() or value.startswith("~"):
                return kind(value).name
    return value


def _config(run: Path) -> dict[str, Any]:
    config = run_folder.read_config(run)
    if not {"encoder", "batch", "data"} <= config.keys():
        raise DataError(
            f"{run / run_folder.CONFIG}: not the configuration of a run; give the folder of a run"
        )
    return config
