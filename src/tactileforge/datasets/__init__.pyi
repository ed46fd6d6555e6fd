from tactileforge.datasets.mixture import Mixture as Mixture
from tactileforge.datasets.recognition import recognise as recognise
from tactileforge.datasets.recordings import LAYOUT_FILE as LAYOUT_FILE
from tactileforge.datasets.recordings import Recordings as Recordings
from tactileforge.datasets.shards import Shards as Shards
