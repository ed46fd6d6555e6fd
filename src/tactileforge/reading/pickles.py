"""Reader of untrusted pickles; executes nothing in them.

Python's own unpickler calls any function named in the file. This one is a small machine for plain
containers, numbers, text, bytes and numpy arrays only: anything else is an error before it happens.
Long byte strings are not loaded, but located: see `Blob`.
"""

from __future__ import annotations

import pickletools
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from tokenize import TokenError
from typing import Any, BinaryIO

import numpy as np

from tactileforge.data.frames.encoded import Blob
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.util.pointers import check_pointer
from tactileforge.util.regular import check_regular

#: Most values of a pickle, counted as often as it repeats them.
_MOST_VALUES = 10_000_000


def load_pickle(path: str | Path) -> Any:
    """Content of a pickle (protocol 2 to 5), with byte strings of 256 bytes or more as `Blob`.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is damaged, or holds more than plain data; names the file.
    """
    return _run(path, lambda file: None)


def load_pickled_array(path: str | Path) -> Any:
    """Content of a ``.npy`` file of objects, as from `load_pickle`; an array of them is a list.

    Args:
        path: File written by ``numpy.save`` for an object, such as a dict, or an array of them.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is damaged, holds numbers alone, or more than plain data; names the
            file.

    Example:
        >>> import numpy as np
        >>> np.save("pose.npy", np.array({"pose": [1.0, 2.0]}, dtype=object))
        >>> load_pickled_array("pose.npy")
        {'pose': [1.0, 2.0]}
    """
    content = _run(path, _skip_header)
    # an array without axes holds one object
    return content[0] if isinstance(content, list) and len(content) == 1 else content


def _skip_header(file: BinaryIO) -> None:
    """Reads the header of a ``.npy`` file up to its pickle."""
    version = np.lib.format.read_magic(file)
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read is None:
        raise ValueError(f"a .npy file of version {version}")
    if read(file)[2].kind != "O":
        raise ValueError("a .npy file of numbers, where one of objects belongs")


def _run(path: str | Path, start: Callable[[BinaryIO], None]) -> Any:
    """Content of the pickle in a file, after ``start`` has read the bytes before it."""
    machine = _Machine(str(path))
    try:
        check_regular(path)
        with open(path, "rb") as file:
            start(file)
            for opcode, argument, position in pickletools.genops(file):
                machine.run(opcode.name, argument, position or 0)
        return machine.result()
    except FileNotFoundError:
        raise DataNotFoundError(f"{path}: no such file; correct the path") from None
    except _Refused as refused:
        raise DataError(
            f"{path}: not read: {refused}. Only plain containers, numbers, text, bytes and numpy "
            "arrays are; nothing in the file was executed. Download it again from its publisher"
        ) from None
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        MemoryError,
        OSError,
        RecursionError,
        SyntaxError,
        TokenError,  # numpy reads the header of an array as a literal of Python
        TypeError,
        ValueError,
    ) as error:
        check_pointer(path)
        raise DataError(
            f"{path}: not a pickle, or damaged ({type(error).__name__}: {error}); download it again"
        ) from error


def _count(value: Any, known: dict[int, int]) -> int:
    """Values of a container, each as often as the container repeats it.

    Raises:
        ValueError: It holds itself.
        RecursionError: It is nested too deep.
    """
    if not isinstance(value, list | tuple | dict):
        return 1
    if id(value) not in known:
        known[id(value)] = -1
        parts = value.values() if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_count(one, known) for one in parts)
    if known[id(value)] < 0:
        raise ValueError("a container that holds itself")
    return known[id(value)]


class _Refused(Exception):
    """Refused content of a pickle: anything but plain data."""


@dataclass(frozen=True)
class _Known:
    """An allowed global name of a pickle, and the function for its arguments."""

    name: str
    make: Callable[..., Any] | None


@dataclass
class _Unfinished:
    """An array or a dtype without its state yet, and its memo keys."""

    finish: Callable[[Any], Any]
    keys: list[int] = field(default_factory=list)


def _bytes(raw: Any) -> bytes:
    content = raw.read() if isinstance(raw, Blob) else raw
    if not isinstance(content, bytes):
        raise ValueError("an array without bytes")
    return content


def _dtype(name: str, *_: Any) -> _Unfinished:
    if not isinstance(name, str):
        raise _Refused("an array of no type")
    dtype = np.dtype(name)
    # no dates and no records ("mMV"): the state of these dtypes holds more than a byte order
    if dtype.kind not in "biufcSUO":
        raise _Refused(f"an array of {name!r}")
    # second in the state of a dtype: "<", ">" or "|", the order of its bytes
    return _Unfinished(lambda state: dtype.newbyteorder(state[1]))


def _array(*_: Any) -> _Unfinished:
    def finish(state: Any) -> Any:
        _, shape, dtype, is_fortran, raw = state
        return _filled(raw, dtype, shape, "F" if is_fortran else "C")

    return _Unfinished(finish)


def _filled(raw: Any, dtype: Any, shape: Any, order: str = "C") -> Any:
    if dtype.kind == "O":
        return list(raw)
    return np.frombuffer(_bytes(raw), dtype).reshape(shape, order=order)  # type: ignore[call-overload]


def _latin1(text: str, encoding: str) -> bytes:
    # protocol 2 has no bytes: Python 3 writes them as text, encoded in latin1 (pickle.py)
    if encoding not in ("latin1", "latin-1"):
        raise _Refused(f"text in {encoding!r}")
    return text.encode("latin1")


#: Everything that a pickle may name, and what stands in for it: no name is ever imported. numpy has
#: moved its functions from ``numpy.core`` to ``numpy._core`` in version 2, and files name either.
_NAMES: dict[str, Callable[..., Any] | None] = {
    "numpy ndarray": None,
    "numpy dtype": _dtype,
    "_codecs encode": _latin1,
    "collections OrderedDict": lambda *items: dict(*items),
    **{f"{module} set": lambda *items: set(*items) for module in ("builtins", "__builtin__")},
    **{f"{module} bytes": lambda: b"" for module in ("builtins", "__builtin__")},
    **{
        f"numpy.{core}.{name}": make
        for core in ("core", "_core")
        for name, make in (
            ("multiarray _reconstruct", _array),
            ("multiarray scalar", lambda dtype, raw: np.frombuffer(_bytes(raw), dtype)[0]),
            ("numeric _frombuffer", _filled),
        )
    },
}

_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_VALUES = frozenset(
    {
        *("BININT", "BININT1", "BININT2", "LONG1", "LONG4", "BINFLOAT", "SHORT_BINBYTES"),
        *("SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8"),
    }
)
#: Bytes between the opcode and the string itself.
_BLOBS = {"BINBYTES": 5, "BINBYTES8": 9, "BYTEARRAY8": 9}
_EMPTY: dict[str, Callable[[], Any]] = {
    "EMPTY_LIST": list,
    "EMPTY_DICT": dict,
    "EMPTY_TUPLE": tuple,
    "EMPTY_SET": set,
}
#: Deepest nesting of tuples and frozen sets, far from Python's limit of 1000 calls.
_DEEPEST = 100
_TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}


class _Machine:
    def __init__(self, path: str) -> None:
        self.path = path
        self.stack: list[Any] = []
        self.marks: list[int] = []
        self.memo: dict[int, Any] = {}
        self.depths: dict[int, int] = {}  # of tuples and frozen sets, by identity

    def result(self) -> Any:
        (value,) = self.stack
        if _count(value, {}) > _MOST_VALUES:
            raise ValueError(f"more than {_MOST_VALUES} values, with those that it repeats")
        return value

    def run(self, name: str, argument: Any, position: int) -> None:
        """Executes one instruction."""
        if name in ("PROTO", "FRAME", "STOP"):
            return
        if name in _CONSTANTS:
            self.stack.append(_CONSTANTS[name])
        elif name in _VALUES:
            self.stack.append(argument)
        elif name in _BLOBS:
            self.stack.append(Blob(self.path, position + _BLOBS[name], len(argument)))
        elif name in _EMPTY:
            self.stack.append(_EMPTY[name]())
        elif name in _TUPLES:
            if len(self.stack) < _TUPLES[name]:
                raise ValueError("a tuple of nothing")
            items = self.stack[-_TUPLES[name] :]
            del self.stack[-_TUPLES[name] :]
            self._push(tuple(items))
        elif name in ("MEMOIZE", "BINPUT", "LONG_BINPUT"):
            key = len(self.memo) if name == "MEMOIZE" else argument
            self.memo[key] = self.stack[-1]
            if isinstance(self.stack[-1], _Unfinished):
                self.stack[-1].keys.append(key)
        elif name in ("BINGET", "LONG_BINGET"):
            self.stack.append(self.memo[argument])
        else:
            step = _STEPS.get(name)
            if step is None:
                raise _Refused(f"the instruction {name}")
            step(self, argument)

    def _push(self, value: tuple[Any, ...] | frozenset[Any]) -> None:
        """Pushes a tuple or frozen set; limits its depth, as hashing overruns Python's stack."""
        inner = (self.depths.get(id(x), 0) for x in value if isinstance(x, tuple | frozenset))
        depth = 1 + max(inner, default=0)
        if depth > _DEEPEST:
            raise _Refused("values nested too deep")
        self.depths[id(value)] = depth
        self.stack.append(value)

    def mark(self, _: Any) -> None:
        self.marks.append(len(self.stack))

    def _since_mark(self) -> list[Any]:
        start = self.marks.pop()
        items = self.stack[start:]
        del self.stack[start:]
        return items

    def tuple(self, _: Any) -> None:
        self._push(tuple(self._since_mark()))

    def frozenset(self, _: Any) -> None:
        self._push(frozenset(self._since_mark()))

    def append(self, _: Any) -> None:
        item = self.stack.pop()
        self._top(list).append(item)

    def appends(self, _: Any) -> None:
        items = self._since_mark()
        self._top(list).extend(items)

    def additems(self, _: Any) -> None:
        items = self._since_mark()
        self._top(set).update(items)

    def setitem(self, _: Any) -> None:
        value, key = self.stack.pop(), self.stack.pop()
        self._top(dict)[key] = value

    def setitems(self, _: Any) -> None:
        items = self._since_mark()
        self._top(dict).update(zip(items[::2], items[1::2], strict=True))

    def _top(self, kind: type) -> Any:
        if type(self.stack[-1]) is not kind:
            raise ValueError(f"a {kind.__name__} was expected")
        return self.stack[-1]

    def name(self, argument: Any) -> None:
        if argument is None:
            name, module = self.stack.pop(), self.stack.pop()
            argument = f"{module} {name}"
        if argument not in _NAMES:
            raise _Refused(f"it asks for {argument.replace(' ', '.')}")
        self.stack.append(_Known(argument, _NAMES[argument]))

    def reduce(self, _: Any) -> None:
        arguments, known = self.stack.pop(), self.stack.pop()
        if not isinstance(known, _Known) or known.make is None:
            raise _Refused("it calls something")
        self.stack.append(known.make(*arguments))

    def build(self, _: Any) -> None:
        state, unfinished = self.stack.pop(), self.stack.pop()
        if not isinstance(unfinished, _Unfinished):
            raise _Refused("it sets the state of an object")
        value = unfinished.finish(state)
        # the memo too: later opcodes take the finished value by the key of the unfinished one
        for key in unfinished.keys:
            self.memo[key] = value
        self.stack.append(value)


_STEPS: dict[str, Callable[[_Machine, Any], None]] = {
    "MARK": _Machine.mark,
    "TUPLE": _Machine.tuple,
    "FROZENSET": _Machine.frozenset,
    "APPEND": _Machine.append,
    "APPENDS": _Machine.appends,
    "ADDITEMS": _Machine.additems,
    "SETITEM": _Machine.setitem,
    "SETITEMS": _Machine.setitems,
    "GLOBAL": _Machine.name,
    "STACK_GLOBAL": _Machine.name,
    "REDUCE": _Machine.reduce,
    "BUILD": _Machine.build,
}
