"""Predictions of probes on the test set, as stored by the benchmark."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError


@dataclass(frozen=True)
class Predictions:
    """True and predicted values or classes.

    Attributes:
        truth: float (N, K), or int64 (N, K) classes.
        predicted: Predictions, of the same shape and type.
        columns: Names of the K values; of the K classifiers.
        names: Names of the classes; empty for values.
        unit: Unit of the values; "" where the file does not say.
        clips: Recording and last frame of each; empty for values.
        probability: Probabilities of classes, float32 (N, classes); None for probes without.
        wrong: int64 (M,), places of wrong clips with a picture, the most certain first.
        pictures: uint8 (M, H, W, 3), their pictures.
    """

    truth: NDArray[Any]
    predicted: NDArray[Any]
    columns: tuple[str, ...]
    names: tuple[str, ...]
    unit: str
    clips: tuple[str, ...] = ()
    probability: NDArray[Any] | None = None
    wrong: tuple[int, ...] = ()
    pictures: NDArray[Any] | None = None


def most_certain_wrong(
    truth: NDArray[Any], predicted: NDArray[Any], probability: NDArray[Any] | None
) -> NDArray[np.intp]:
    """Places of the wrong clips, the most certain ones first; in order without probabilities.

    Args:
        truth: int64 (N,), classes.
        predicted: int64 (N,), predicted classes.
        probability: float32 (N, classes); None for probes without.
    """
    wrong = np.flatnonzero(truth != predicted)
    if probability is None:
        return wrong
    return wrong[np.argsort(-probability[wrong, predicted[wrong]], kind="stable")]


def read_predictions(path: Path) -> Predictions:
    """Reads a file of predictions: ``truth``, ``predicted``, ``axes`` or ``names``, ``unit``.

    Raises:
        DataError: The file is absent or damaged, or its arrays do not fit each other.
    """
    try:
        # a pickle in it would be executed
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise DataError(f"{path}: not readable ({error}); run the bench again") from error
    for key in ("truth", "predicted"):
        if key not in arrays:
            raise DataError(f"{path}: array {key!r} is missing; run the bench again")
    truth, predicted = arrays["truth"], arrays["predicted"]
    names = tuple(arrays["names"].tolist()) if "names" in arrays else ()
    if truth.shape != predicted.shape or truth.ndim not in (1, 2) or not truth.size:
        shapes = f"{truth.shape} and {predicted.shape}"
        raise DataError(f"{path}: truth and predicted are {shapes}, not both (N,) or (N, K)")
    # one column of classes is stored without its axis
    truth, predicted = (part.reshape(len(truth), -1) for part in (truth, predicted))
    both = np.stack([truth, predicted])
    if names and (both.dtype.kind != "i" or both.min() < 0 or both.max() >= len(names)):
        raise DataError(f"{path}: classes are not whole numbers from 0 to {len(names) - 1}")
    width = truth.shape[1]
    columns = tuple(arrays["axes"].tolist()) if "axes" in arrays else tuple("xyz"[:width])
    if len(columns) != width:
        raise DataError(f"{path}: 'axes' names {len(columns)} columns of {width}")
    unit = str(arrays["unit"]) if "unit" in arrays else ""
    clips = tuple(arrays["clips"].tolist()) if "clips" in arrays else ()
    wrong = tuple(arrays["wrong"].tolist()) if "wrong" in arrays else ()
    probability, pictures = (arrays.get(key) for key in ("probability", "pictures"))
    sizes = {len(clips) or len(truth), len(truth) if probability is None else len(probability)}
    shown = 0 if pictures is None else len(pictures)
    if sizes != {len(truth)} or shown != len(wrong) or not {*wrong} <= {*range(len(truth))}:
        raise DataError(f"{path}: its arrays are not of the same clips; run the bench again")
    return Predictions(truth, predicted, columns, names, unit, clips, probability, wrong, pictures)
