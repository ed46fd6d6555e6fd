from tactileforge.cli._compose import compose as compose
from tactileforge.data.shards.sample import sample_touch as sample_touch
from tactileforge.hub.creating import create as create
from tactileforge.hub.loading import list_models as list_models
from tactileforge.hub.loading import load as load
from tactileforge.plugins.registry import list_plugins as list_plugins
from tactileforge.plugins.registry import register as register
from tactileforge.verbs import Run as Run
from tactileforge.verbs import bench as bench
from tactileforge.verbs import calibrate as calibrate
from tactileforge.verbs import inspect as inspect
from tactileforge.verbs import pack as pack
from tactileforge.verbs import simulate as simulate
from tactileforge.verbs import train as train

__version__: str
