"""Keeps the bytecode for the processes after this one, if it is imported first.

Where PYTHONDONTWRITEBYTECODE is set, as in many containers, each process that a test starts would
compile torch anew: two thirds of the CPU time of its start.
"""

import os
import shutil
import sys
import tempfile
from pathlib import Path

if sys.dont_write_bytecode:
    sys.dont_write_bytecode = False
    sys.pycache_prefix = str(Path(__file__).parents[2] / ".pytest_cache" / "bytecode")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # or `python -B` says so
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
    # packages that an earlier session has installed into folders that are gone
    temporary = Path(tempfile.gettempdir()).resolve().relative_to(Path(sys.prefix).anchor)
    shutil.rmtree(Path(sys.pycache_prefix, temporary), ignore_errors=True)
