"""``tactileforge.create``: a model by name, with random weights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tactileforge.errors import ConfigError, unknown
from tactileforge.hub.loading import load
from tactileforge.hub.store import is_available
from tactileforge.plugins import local
from tactileforge.util.licences import NO_LICENCE

if TYPE_CHECKING:
    from torch import nn

    from tactileforge.hub.model import Model


def create(
    name: str | type[nn.Module],
    *,
    pretrained: bool = False,
    num_classes: int | None = None,
    **options: Any,
) -> Model:
    """Builds a model by name: its architecture with random weights, or the pre-trained ones.

    Args:
        name: ``NAME.TAG`` or ``NAME`` of the zoo, an encoder's plugin, such as ``tactile_vit``, or
            an encoder of your own: the class, or ``my_module:Tiny``.
        pretrained: Whether weights are loaded; see `load`. An encoder with an option of this name,
            such as ``timm``, fetches its own.
        num_classes: Outputs of a new linear head, ``model.heads["classify"]``, on the projected
            vector; `Model.read_head` gives its logits, and training it is the user's.
        **options: Options of `load` with ``pretrained``; else constructor arguments of the
            encoder, in place of the model's own.

    Raises:
        ConfigError: Unknown name or option, or no classes.
        TactileForgeError: With ``pretrained``: see `load`.

    Example:
        >>> model = create("tactile_vit", size="tiny", num_classes=7)
        >>> model.heads["classify"].linear.out_features
        7
    """
    # a bool is an int
    if num_classes is not None and (type(num_classes) is not int or num_classes < 1):
        raise ConfigError(f"num_classes={num_classes!r}: give a whole number, 1 or more")
    name = name if isinstance(name, str) else local.name_of(name)
    if pretrained and _fetches(name):
        model = _untrained(name, {**options, "pretrained": True})
    else:
        model = load(name, **options) if pretrained else _untrained(name, options)
    if num_classes is not None:
        if "classify" in model.heads:  # of the pre-trained model, for other classes
            del model.heads["classify"]
        model.add_head("classify", classes=num_classes)
    return model.requires_grad_(True)


def _fetches(name: str) -> bool:
    """Whether an encoder takes ``pretrained`` itself."""
    from tactileforge.plugins import registry

    if local.is_local(name):
        return "pretrained" in registry.parameters(registry.adopt("encoders", name))
    return name in registry.names("encoders") and "pretrained" in registry.options("encoders", name)


def _untrained(name: str, options: dict[str, Any]) -> Model:
    """The architecture of a name, with random weights."""
    from tactileforge.hub.files import make_header, without_folders
    from tactileforge.hub.model import Model
    from tactileforge.plugins import registry

    node, spacing, title = _architecture(name)
    node |= options
    encoder = registry.build("encoders", node)
    frames = encoder.frames
    header = make_header(
        encoder,
        node,
        licence=NO_LICENCE,
        spacing=(spacing or 1 / 30) if frames > 1 else 0.0,
        name=title,
        # not imported: its vector is the summary, as of a model trained here
        recipe={"encoder": without_folders(node)},
        source={"weights": "pretrained" if options.get("pretrained") else "random"},
    )
    return Model(encoder, header)


def _architecture(name: str) -> tuple[dict[str, Any], float, str]:
    """Plugin and arguments of an encoder, seconds between its frames, and a title."""
    from tactileforge.hub import cards, published, store
    from tactileforge.hub.header import read_header
    from tactileforge.plugins import registry

    word = published.name_of(name)
    if word.partition(".")[0] in cards.card_names():
        card, weight = cards.find_card(word)
        if is_available(card, weight):
            header = read_header(store.fetch_weights(card, weight))
            return dict(header.encoder), header.spacing, ""
        raise ConfigError(
            f"{word}: its architecture is in its file, which is not here yet: "
            f'tactileforge.load("{word}", accept="{weight.licence}"), then create it'
        )
    if local.is_local(word):
        registry.adopt("encoders", word)
    elif word not in registry.names("encoders"):
        known = {*cards.card_names(), *registry.names("encoders")}
        raise ConfigError(unknown("model or encoder", word, known))
    return {"name": word}, 0.0, ""
