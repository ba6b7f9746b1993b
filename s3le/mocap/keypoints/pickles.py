"""Pickles read as data: an interpreter that knows lists, words, numbers and numpy's arrays.

Python's own unpickler calls whatever a file names. This one imports nothing and calls nothing:
it reads the instructions one by one, keeps a stack of plain values, and knows by heart the few
names with which numpy writes its arrays. A tensor of torch stays closed (CLOSED). Any other name
or instruction refuses the file.
"""

import pickletools
import reprlib
from collections import OrderedDict
from collections.abc import Callable
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from s3le.errors import ClipError

HIGHEST = 5  # protocol
MOST = 2**63  # of keys and lengths
MOST_STEPS = 400_000  # instructions of one file; a result of one frame has some hundreds
_DTYPE = {"b1", *(f"{kind}{size}" for kind in "iu" for size in (1, 2, 4, 8)), "f2", "f4", "f8"}


class _Closed:
    """What is there but is not read."""

    def __repr__(self) -> str:
        return "closed"


CLOSED = _Closed()
_made_of: dict[int, tuple[str, bytes]] = {}  # texts that were made bytes in this reading


class _Name(NamedTuple):
    """A name that a file wants to call: never looked up, only recognised."""

    what: str


class _Array:
    """An array of which the numbers are still to come; and where it is noted meanwhile."""

    def __init__(self) -> None:
        self.noted: list[int] = []


class _Type:
    """A numpy dtype of which the byte order is still to come."""

    def __init__(self, code: str) -> None:
        self.dtype = np.dtype(code)


class _Refused(Exception):  # noqa: N818
    """Why the file is refused."""


def load(path: Path | str, data: bytes) -> Any:
    """What a pickle holds: None, numbers, words, bytes, lists, tuples, dicts, arrays, CLOSED.

    Values may be shared, and a list may even hold itself: who walks through it counts the steps.

    Args:
        path: for messages.
        data: the file.

    Raises:
        ClipError: an instruction or a name that is not data's, damage, or more than MOST_STEPS.
    """
    _made_of.clear()
    try:
        value, end = _run(data)
    except _Refused as refusal:
        raise ClipError(f"{path}: {refusal}") from None
    except (ValueError, KeyError, IndexError, TypeError, OverflowError, UnicodeError) as damage:
        words = (str(damage).splitlines() or [type(damage).__name__])[0][:160]
        raise ClipError(f"{path}: is no sound pickle ({words})") from None
    finally:
        _made_of.clear()
    if end != len(data):
        raise ClipError(f"{path}: is no sound pickle ({len(data) - end} bytes after its end)")
    return value


def _run(data: bytes) -> tuple[Any, int]:
    stack: list[Any] = []
    marks: list[int] = []
    memo: dict[int, Any] = {}
    frame_ends = 0
    for step, (code, argument, place) in enumerate(pickletools.genops(data)):
        if step > MOST_STEPS:
            raise _Refused(f"a pickle of more than {MOST_STEPS} instructions is not read")
        name = code.name
        if name == "STOP":
            if len(stack) != 1 or marks:
                raise _Refused(f"is no sound pickle ({len(stack)} values at its end)")
            return stack[0], place + 1
        if name in _PUSHED:
            stack.append(argument)
        elif name in _CONSTANT:
            stack.append(_CONSTANT[name])
        elif name in _MADE:
            stack.append(_MADE[name]())
        elif name == "FRAME":
            begin, frame_ends = frame_ends, place + 9 + argument
            if place < begin or frame_ends > len(data):
                raise _Refused("is no sound pickle (a frame of it is cut, or in another)")
        elif name == "PROTO":
            if argument > HIGHEST:
                raise _Refused(f"is no sound pickle (protocol {argument})")
        elif name == "MARK":
            marks.append(len(stack))
        elif name in ("GLOBAL", "STACK_GLOBAL"):
            words = argument.split(" ", 1) if argument else [stack.pop(-2), stack.pop()]
            stack.append(_named(*words))
        elif name in ("MEMOIZE", "PUT", "BINPUT", "LONG_BINPUT"):
            key = len(memo) if name == "MEMOIZE" else argument
            memo[key] = stack[-1]
            if isinstance(stack[-1], _Array):
                stack[-1].noted.append(key)
        elif name in ("GET", "BINGET", "LONG_BINGET"):
            stack.append(memo[argument])
        elif name == "DUP":
            stack.append(stack[-1])
        elif name == "POP" and not (marks and marks[-1] == len(stack)):
            stack.pop()
        elif name in ("POP", "POP_MARK"):
            _since(stack, marks)
        elif name in _COLLECT:
            stack.append(_COLLECT[name](_since(stack, marks)))
        elif name in _TUPLES:
            count = _TUPLES[name]
            if len(stack) < count:
                raise _Refused("is no sound pickle (values are missing)")
            stack[-count:] = [tuple(stack[-count:])]
        elif name in ("APPEND", "APPENDS"):
            more = _since(stack, marks) if name == "APPENDS" else [stack.pop()]
            _of(stack[-1], list).extend(more)
        elif name in ("SETITEM", "SETITEMS"):
            more = _since(stack, marks) if name == "SETITEMS" else [stack.pop(-2), stack.pop()]
            _of(stack[-1], dict).update(_pairs(more))
        elif name == "REDUCE":
            given = _of(stack.pop(), tuple)
            stack.append(_reduced(stack.pop(), given))
        elif name == "BUILD":
            state = stack.pop()
            what = stack[-1]
            if isinstance(what, _Array):
                stack[-1] = _filled(state)
                memo |= {key: stack[-1] for key in what.noted if memo[key] is what}
            else:
                _build(what, state)
        else:
            raise _Refused(f"refused, its instruction {name} at byte {place} is not data")
    raise _Refused("is no sound pickle (it has no end)")


def _since(stack: list[Any], marks: list[int]) -> list[Any]:
    mark = marks.pop()
    taken = stack[mark:]
    del stack[mark:]
    return taken


def _of(value: Any, kind: type) -> Any:
    if not isinstance(value, kind):
        raise _Refused(f"is no sound pickle (a {kind.__name__} wanted, {_kind(value)} found)")
    return value


def _kind(value: Any) -> str:
    return type(value).__name__.lstrip("_").lower()


def _pairs(flat: list[Any]) -> dict[Any, Any]:
    if len(flat) % 2 or not all(
        isinstance(key, str) or (isinstance(key, int) and -MOST < key < MOST) for key in flat[::2]
    ):  # a larger number takes long to hash, each time
        raise _Refused("refused, a dict of it has keys that are neither words nor whole numbers")
    return dict(zip(flat[::2], flat[1::2], strict=True))


# --- the names that numpy writes


def _named(module: Any, name: Any) -> _Name:
    known = f"{_of(module, str)}.{_of(name, str)}".replace("numpy._core.", "numpy.core.")
    if known not in _KNOWN:
        raise _Refused(
            f"refused, it wants to call {known[:100]!r}; only plain data and numpy's arrays are "
            "read from pickles, and nothing is ever called"
        )
    return _Name(known)


def _reconstruct(kind: Any, shape: Any, _: Any) -> _Array:
    if kind != _Name("numpy.ndarray") or shape != (0,):
        raise _Refused("refused, an array of it is no plain numpy array")
    return _Array()


def _dtype(code: Any, _align: Any = False, _copy: Any = True) -> _Type:
    if isinstance(code, str) and code in _DTYPE:
        return _Type(code)
    raise _Refused(f"refused, an array of it holds {_short(code)}, which is not numbers")


def _scalar(kind: Any, data: Any) -> float | int | bool:
    return _numbers(kind, (), _bytes(data)).item()


def _frombuffer(data: Any, kind: Any, shape: Any, order: Any) -> np.ndarray:
    if order not in ("C", "F"):
        raise _Refused("is no sound pickle (an array without an order)")
    return _numbers(kind, shape, _bytes(data), order)


def _encode(text: Any, encoding: Any = "latin1") -> bytes:
    if encoding not in ("latin1", "latin-1"):
        raise _Refused(f"refused, words of it are in {_short(encoding)}")
    return _latin(_of(text, str))


def _no_bytes() -> bytes:
    return b""


def _ordered(*given: Any) -> dict[Any, Any]:
    pairs = [_of(pair, (list, tuple)) for pair in given[0]] if given else []
    return OrderedDict(_pairs([value for pair in pairs for value in pair]))


def _latin(text: str) -> bytes:
    """The bytes of a text, made once: a file that asks a thousand times gets the same ones."""
    if (known := _made_of.get(id(text))) is None:
        known = _made_of[id(text)] = (text, text.encode("latin-1"))
    return known[1]


def _short(value: Any) -> str:
    """A value in a few words, whatever it holds."""
    return reprlib.repr(value)[:60]


def _bytes(data: Any) -> bytes | bytearray:
    if isinstance(data, str):  # of Python 2
        return _latin(data)
    if not isinstance(data, (bytes, bytearray)):
        raise _Refused(f"refused, the numbers of an array of it are {_kind(data)}, not bytes")
    return data


def _numbers(kind: Any, shape: Any, data: bytes, order: str = "C") -> np.ndarray:
    dtype = _of(kind, _Type).dtype
    whole = isinstance(shape, tuple) and all(type(n) is int and 0 <= n < MOST for n in shape)
    if not whole:
        raise _Refused(f"is no sound pickle (an array of shape {_short(shape)})")
    if len(shape) > 8 or prod(shape) * dtype.itemsize != len(data):
        raise _Refused(
            f"is no sound pickle (an array of shape {_short(shape)} in {len(data)} bytes)"
        )
    flat = np.frombuffer(data, dtype) if data else np.zeros(0, dtype)
    return flat.reshape(shape, order=order)


def _reduced(name: Any, given: tuple) -> Any:
    if not isinstance(name, _Name) or _KNOWN[name.what] is None:
        raise _Refused(f"refused, it wants to call {_kind(name)}")
    return _KNOWN[name.what](*given)


def _filled(state: Any) -> np.ndarray:
    """The array that numpy's own words for it make."""
    version, shape, kind, fortran, data = _of(state, tuple)
    if version != 1 or not isinstance(kind, _Type) or isinstance(data, list):
        raise _Refused("refused, an array of it holds objects, not numbers")
    return _numbers(kind, shape, _bytes(data), "F" if fortran else "C")


def _build(what: Any, state: Any) -> None:
    """Give a dtype its byte order."""
    if isinstance(what, _Type):
        version, order, *rest = _of(state, tuple)
        more = any(part is not None for part in rest[:3])  # fields, as of records
        if version != 3 or order not in ("<", ">", "|", "=") or more:
            raise _Refused("refused, an array of it holds something else than numbers")
        if order in "<>":
            what.dtype = what.dtype.newbyteorder(order)
    elif what is not CLOSED:
        raise _Refused(f"refused, it wants to set up {_kind(what)}")


def _closed(*_: Any) -> Any:
    return CLOSED


_KNOWN: dict[str, Callable[..., Any] | None] = {
    "numpy.ndarray": None,
    "numpy.dtype": _dtype,
    "numpy.core.multiarray._reconstruct": _reconstruct,
    "numpy.core.multiarray.scalar": _scalar,
    "numpy.core.numeric._frombuffer": _frombuffer,
    "collections.OrderedDict": _ordered,
    "_codecs.encode": _encode,
    "__builtin__.bytes": _no_bytes,  # how protocol 2 writes none
    "builtins.bytes": _no_bytes,
    "torch._utils._rebuild_tensor_v2": _closed,
    "torch.storage._load_from_bytes": _closed,
}
_PUSHED = {
    "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT",
    "STRING", "BINSTRING", "SHORT_BINSTRING", "BINBYTES", "SHORT_BINBYTES", "BINBYTES8",
    "BYTEARRAY8", "UNICODE", "SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8",
}  # fmt: skip
_CONSTANT = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_MADE = {"EMPTY_LIST": list, "EMPTY_DICT": dict, "EMPTY_TUPLE": tuple}
_COLLECT = {"LIST": list, "TUPLE": tuple, "DICT": _pairs}
_TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
