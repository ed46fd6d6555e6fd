"""Columns and tables of a LeRobot data set."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray


def common(count: int, fps: int, number: int, start: int, task: int) -> dict[str, NDArray[Any]]:
    """Columns of the features of every data set, `folder.COMMON`."""
    rows = np.arange(count)
    return {
        "timestamp": (rows / fps).astype(np.float32),
        "frame_index": rows,
        "episode_index": np.full(count, number),
        "index": start + rows,
        "task_index": np.full(count, task),
    }


def column(arrow: Any, values: Any, feature: dict[str, Any]) -> Any:
    """Builds a column in LeRobot's layout: scalars, lists of one length, or encoded images."""
    if feature["dtype"] == "image":
        kind = arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())])
        return arrow.array(values, kind)
    flat = np.ascontiguousarray(values, dtype=feature["dtype"]).reshape(len(values), -1)
    if feature["shape"] == [1]:  # a scalar in LeRobot's tables
        return arrow.array(flat[:, 0])
    return arrow.FixedSizeListArray.from_arrays(arrow.array(flat.ravel()), flat.shape[1])


def tasks(arrow: Any, words: list[str]) -> Any:
    """Table of tasks, with the pandas index of LeRobot: the words of a task."""
    table = arrow.table(
        {"task_index": arrow.array(range(len(words)), arrow.int64()), "task": words}
    )
    index = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            _pandas("task_index", "int64", "int64"),
            _pandas("task", "unicode", "object"),
        ],
        "creator": {"library": "pyarrow", "version": arrow.__version__},
        "pandas_version": "2.0.0",
    }
    return table.replace_schema_metadata({"pandas": json.dumps(index)})


def _pandas(name: str, kind: str, numpy_kind: str) -> dict[str, Any]:
    return {
        "name": name,
        "field_name": name,
        "pandas_type": kind,
        "numpy_type": numpy_kind,
        "metadata": None,
    }
