"""Pictures read from their file on demand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, overload

from numpy.typing import NDArray


class LazyPictures(Sequence[Any]):
    """Pictures by number, for `EncodedFrames`.

    Args:
        count: Number of pictures.
        read: Function from a number to the bytes of an image file, or to uint8 (H, W, 3).
    """

    def __init__(self, count: int, read: Callable[[int], bytes | NDArray[Any]]) -> None:
        self._length, self._read = count, read

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[Any]:
        return (self[i] for i in range(self._length))

    @overload
    def __getitem__(self, i: int) -> Any: ...
    @overload
    def __getitem__(self, i: slice) -> list[Any]: ...
    def __getitem__(self, i: int | slice) -> Any:
        if isinstance(i, slice):
            return [self._read(j) for j in range(*i.indices(self._length))]
        return self._read(range(self._length)[i])
