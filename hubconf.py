"""Models for ``torch.hub.load(REPOSITORY, NAME)``; the package itself is to be installed."""

from typing import Any

dependencies = ["torch", "safetensors", "yaml"]


def load(name: str = "touch.tiny", **options: Any) -> Any:
    """A model of the zoo, a file, a run, or of the model hub; see `tactileforge.load`."""
    import tactileforge

    return tactileforge.load(name, **options)


def create(name: str = "tactile_vit", **options: Any) -> Any:
    """A model with random weights, with a head for classes if asked; see `tactileforge.create`."""
    from tactileforge.hub.creating import create as build

    return build(name, **options)


def touch_tiny(pretrained: bool = True, **options: Any) -> Any:
    """The encoder ``touch.tiny``."""
    return create("touch.tiny", pretrained=pretrained, **options)


def anytouch2_tiny(pretrained: bool = True, **options: Any) -> Any:
    """The encoder ``anytouch2.tiny``, with heads for force and the surface of the gel."""
    return create("anytouch2.tiny", pretrained=pretrained, **options)
