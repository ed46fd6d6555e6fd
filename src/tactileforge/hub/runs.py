"""The encoder and heads of a run's folder, as they are packed and loaded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn

from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.hub import files
from tactileforge.hub.aligned import ALIGN, aligned_head
from tactileforge.hub.file_checks import of_package, own_head
from tactileforge.hub.header import Header
from tactileforge.hub.positions import changed_options, rebuild_encoder
from tactileforge.plugins import local, registry
from tactileforge.plugins.recorded import check_installed
from tactileforge.runs import folder as run_folder
from tactileforge.runs.checkpoint_file import find_checkpoint, read_own
from tactileforge.runs.folder import split_best
from tactileforge.specs.published import spec
from tactileforge.util.licences import NO_LICENCE
from tactileforge.util.provenance import commit

#: Most names of classes that a header keeps, of the objects of the training data.
MOST_NAMES = 2000
#: Heads of the core that are kept whole: `Model` reads force and surface, and a run that starts
#: from the weights goes on with all of them. Of the aligned head the text side is kept, see
#: `aligned_head`.
KEPT_HEADS = ("pixel", "diff", "surface", "force", "classify")


def read_run(
    run: Path,
    *,
    name: str = "",
    licence: str = NO_LICENCE,
    encoder: Literal["trained", "slow"] | None = None,
) -> tuple[Any, dict[str, nn.Module], Header]:
    """Builds the encoder of a run, with the heads of use alone, from its last checkpoint.

    V-JEPA and DINO are published and evaluated by the EMA of the encoder, which the objective's
    head keeps (`heads.ema.EMA`), so that is the one where there is one. A head is kept beside the
    encoder that it was trained on, and not beside an EMA. The sensors are those of the training.

    Args:
        run: Folder of the run: its ``config.yaml`` and last checkpoint are read, or with
            ``@best`` behind it the best one.
        name: Name of the model.
        licence: SPDX identifier of the weights.
        encoder: ``trained``, the encoder that the optimiser changed, or ``slow``, its EMA; None
            takes the EMA where the run has one. The header says which it is.

    Returns:
        The encoder, its heads by name, and the header, as `files.open_model` gives them.

    Raises:
        DataNotFoundError: The folder is not that of a run.
        DataError: Checkpoint and configuration do not fit.
        ConfigError: No EMA of the encoder, or several.
    """
    place, (run, _) = run, split_best(run)
    config = _config(run)
    kept = run_folder.read_versions(run)
    check_installed(config, kept.get("plugins", {}), str(run), ("encoder",))
    if (known := config["encoder"].get("sensors")) and (trained := kept.get("sensors")):
        # rows of other sensors were never trained
        config["encoder"]["sensors"] = {name: known[name] for name in known if name in trained}
    # its weights are those of the checkpoint: no others are read or fetched
    config["encoder"] = registry.without_start("encoders", config["encoder"])
    # popped: the recipe in a header is not this run
    checkpoint = read_own(find_checkpoint(place), config.pop("run", None), ("global_step",))
    kind, state = _choose(checkpoint["state_dict"], encoder, run)
    with torch.random.fork_rng(devices=[]):  # the numbers drawn here are replaced
        built = registry.build("encoders", config["encoder"])
        files.fill_weights(built, state, str(run))
        heads: dict[str, nn.Module] = {}
        entries: dict[str, dict[str, Any]] = {}
        # heads were trained on the encoder itself, not on its EMA
        if kind == "trained":
            known = built.sensors or kept.get("sensors", ())
            heads, entries = _heads(config, built, checkpoint["state_dict"], run, known)
            # a header has room for so many; without names, those asked for are given by hand
            if "classify" in entries and 0 < len(met := kept.get("objects", [])) <= MOST_NAMES:
                entries["classify"]["names"] = met
    header = files.make_header(
        built,
        config["encoder"],
        licence=licence,
        spacing=config["batch"]["spacing"] if built.frames > 1 else 0.0,
        name=name,
        # of the code that trained it, where that is recorded
        commit=kept.get("commit") or commit(),
        versions=kept.get("versions", {}),
        data={"name": config["data"]["name"], "licences": kept.get("licences", [])},
        recipe=files.without_folders(config),
        source={"steps": checkpoint["global_step"], "encoder": kind},
        heads=entries,
    )
    for module in (built, *heads.values()):
        module.requires_grad_(False).eval()
    return built, heads, header


def open_run(
    run: Path, frames: int | None = None, image_size: int | tuple[int, int] | None = None
) -> tuple[Any, dict[str, nn.Module], Header]:
    """Builds the encoder and heads of a run, without writing a file.

    Args:
        run: Folder of the run.
        frames: Another number of frames, as in `files.open_model`.
        image_size: Another height and width, likewise.

    Raises:
        DataNotFoundError: The folder is not that of a run.
        DataError: Checkpoint and configuration do not fit.
        ConfigError: No EMA of the encoder, or several; or no such frames or size.
    """
    encoder, heads, header = read_run(run)
    if other := changed_options(encoder, frames, image_size):
        encoder = rebuild_encoder(header.encoder, encoder, other).requires_grad_(False).eval()
        heads = {}
    return encoder, heads, header


def _heads(
    config: Mapping[str, Any],
    encoder: Any,
    state: Mapping[str, Tensor],
    run: Path,
    sensors: Iterable[str],
) -> tuple[dict[str, nn.Module], dict[str, dict[str, Any]]]:
    """The trained heads of a run to keep, and their entries of the header, by name."""
    heads: dict[str, nn.Module] = {}
    entries: dict[str, dict[str, Any]] = {}
    for name, node in sorted(config.get("head", {}).items(), key=lambda one: _order(one[0])):
        if not node:
            continue
        if local.is_local(node["name"]) and name in config.get("objective", {}):
            if not own_head(name, node["name"]):
                files.warn_of_left(run, name, node["name"])
                continue
        elif not _is_kept(name, node["name"]):
            continue
        own = _below(f"heads.{name}.", state)
        if name == ALIGN:
            if (found := aligned_head(config, encoder, own)) is None:
                continue
            heads[name], entries[name], own = found
        else:
            heads[name] = registry.build("heads", node, encoder=encoder)
            entries[name] = {"node": {**node, "name": files.without_folders(node["name"])}}
            if name == "force":
                entries[name]["scale"] = _scales(sensors)
        files.fill_weights(heads[name], own, f"{run}, head {name}")
    return heads, entries


def _is_kept(name: str, plugin: str) -> bool:
    """Whether an installed head is kept under a name: of the core, only heads for reading."""
    if name in registry.names("heads") and plugin != name:
        return False  # another plugin under this name is not what `Model` reads
    return name in (*KEPT_HEADS, ALIGN) or of_package(plugin)


def _order(name: str) -> tuple[int, str]:
    """Place of a head in a file: first those of the package."""
    known = (*KEPT_HEADS, ALIGN)
    return (known.index(name) if name in known else len(known), name)


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
    # an EMA has the names of the encoder behind `.network.`: one of them finds its place
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


def _config(run: Path) -> dict[str, Any]:
    config = run_folder.read_config(run)
    if not {"encoder", "batch", "data"} <= config.keys():
        raise DataError(
            f"{run / run_folder.CONFIG}: not the configuration of a run; give the folder of a run"
        )
    return config
