from tactileforge.api import train as train
from tactileforge.cli.compose import compose as compose
from tactileforge.hub.loading import list_models as list_models
from tactileforge.hub.loading import load as load
from tactileforge.plugins.registry import list_plugins as list_plugins

__version__: str
