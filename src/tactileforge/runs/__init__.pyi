from tactileforge.runs.checkpoint_file import read_checkpoint as read_checkpoint
from tactileforge.runs.folder import BEST as BEST
from tactileforge.runs.folder import LAST as LAST
from tactileforge.runs.folder import read_config as read_config
from tactileforge.runs.folder import split_best as split_best
