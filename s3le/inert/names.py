"""What the names in pickles make: numbers of numpy, joblib and torch, by constructors of our own.

A name is never looked up, only recognised (KNOWN). Each constructor checks what it is given, down
to the count of bytes; what is in a form that is not read stays closed (CLOSED).
"""

import io
import reprlib
from collections import OrderedDict
from collections.abc import Callable
from math import prod
from typing import Any, Literal, NamedTuple

import numpy as np

_Order = Literal["C", "F"]  # of an array: the last index runs fastest, or the first

MOST = 2**63  # of keys and lengths
MOST_NUMBERS = 20_000_000  # of one tensor, which may repeat those of its storage
_DTYPE = {"b1", *(f"{kind}{size}" for kind in "iu" for size in (1, 2, 4, 8)), "f2", "f4", "f8"}


class _Closed:
    """What is there but is not read."""

    def __repr__(self) -> str:
        return "closed"


CLOSED = _Closed()


class _Reading:
    """What all pickles of the file that is being read have in common."""

    def __init__(self) -> None:
        self.begin()

    def begin(self, most: int = 0, objects: bool = False, run: Callable[..., Any] = dict) -> None:
        """Of a new file.

        Args:
            most: instructions that are read.
            objects: whether arrays may hold objects, as those of .npy do.
            run: the interpreter, for pickles in pickles.
        """
        self.most = self.left = most
        self.objects, self.run = objects, run
        self.made_of: dict[int, tuple[str, bytes]] = {}  # texts that were made bytes
        # Bytes that were read as torch's numbers.
        self.storages: dict[int, tuple[bytes | bytearray, Any]] = {}


now = _Reading()


class Name(NamedTuple):
    """A name that a file wants to call: never looked up, only recognised."""

    what: str


class Array:
    """An array of which the numbers are still to come; and where it is noted meanwhile."""

    def __init__(self) -> None:  # noqa: D107
        self.noted: list[int] = []


class Wrapper(Array):
    """An array of joblib's, the numbers of which follow the instruction that fills it."""


class _Storage:
    """Torch's numbers of an older form, which follow the pickles that name them."""

    def __init__(self, what: str, key: str, count: int) -> None:
        self.what, self.key, self.count = what, key, count


class _Type:
    """A numpy dtype of which the byte order is still to come."""

    def __init__(self, code: str) -> None:
        self.dtype = np.dtype(code)


class Refused(Exception):  # noqa: N818
    """Why the file is refused."""


def of(value: Any, kind: type | tuple[type, ...]) -> Any:
    """The value, which must be of this kind."""
    if not isinstance(value, kind):
        wanted = getattr(kind, "__name__", "list")
        raise Refused(f"is no sound pickle (a {wanted} wanted, {kind_of(value)} found)")
    return value


def kind_of(value: Any) -> str:
    """What a value is, for people."""
    return type(value).__name__.lstrip("_").lower()


def dict_of(flat: list[Any]) -> dict[Any, Any]:
    """A dict of keys and values in turn."""
    if len(flat) % 2 or not all(
        isinstance(key, str) or (isinstance(key, int) and -MOST < key < MOST) for key in flat[::2]
    ):  # a larger number takes long to hash, each time
        raise Refused("refused, a dict of it has keys that are neither words nor whole numbers")
    return dict(zip(flat[::2], flat[1::2], strict=True))


def named(module: Any, name: Any) -> Name:
    """A name that is known."""
    known = f"{of(module, str)}.{of(name, str)}".replace("numpy._core.", "numpy.core.")
    if known not in KNOWN:
        raise Refused(
            f"refused, it wants to call {known[:100]!r}; only plain data and numpy's arrays are "
            "read from pickles, and nothing is ever called"
        )
    return Name(known)


def _reconstruct(kind: Any, shape: Any, _: Any) -> Array:
    if kind != Name("numpy.ndarray") or shape != (0,):
        raise Refused("refused, an array of it is no plain numpy array")
    return Array()


def _dtype(code: Any, _align: Any = False, _copy: Any = True) -> _Type:
    if isinstance(code, str) and (code in _DTYPE or (code == "O8" and now.objects)):
        return _Type(code)
    raise Refused(f"refused, an array of it holds {_short(code)}, which is not numbers")


def _scalar(kind: Any, data: Any) -> float | int | bool:
    return _numbers(kind, (), _bytes(data)).item()


def _frombuffer(data: Any, kind: Any, shape: Any, order: Any) -> np.ndarray:
    if order not in ("C", "F"):
        raise Refused("is no sound pickle (an array without an order)")
    return _numbers(kind, shape, _bytes(data), order)


def _encode(text: Any, encoding: Any = "latin1") -> bytes:
    if encoding not in ("latin1", "latin-1"):
        raise Refused(f"refused, words of it are in {_short(encoding)}")
    return _latin(of(text, str))


def _no_bytes() -> bytes:
    return b""


def _ordered(*given: Any) -> dict[Any, Any]:
    pairs = [of(pair, (list, tuple)) for pair in given[0]] if given else []
    return OrderedDict(dict_of([value for pair in pairs for value in pair]))


def _latin(text: str) -> bytes:
    """The bytes of a text, made once: a file that asks a thousand times gets the same ones."""
    if (known := now.made_of.get(id(text))) is None:
        known = now.made_of[id(text)] = (text, text.encode("latin-1"))
    return known[1]


def _short(value: Any) -> str:
    """A value in a few words, whatever it holds."""
    return reprlib.repr(value)[:60]


def _bytes(data: Any) -> bytes | bytearray:
    if isinstance(data, str):  # of Python 2
        return _latin(data)
    if not isinstance(data, (bytes, bytearray)):
        raise Refused(f"refused, the numbers of an array of it are {kind_of(data)}, not bytes")
    return data


def _numbers(kind: Any, shape: Any, data: bytes | bytearray, order: _Order = "C") -> np.ndarray:
    dtype = of(kind, _Type).dtype
    whole = isinstance(shape, tuple) and all(type(n) is int and 0 <= n < MOST for n in shape)
    if not whole:
        raise Refused(f"is no sound pickle (an array of shape {_short(shape)})")
    if len(shape) > 8 or prod(shape) * dtype.itemsize != len(data):
        raise Refused(
            f"is no sound pickle (an array of shape {_short(shape)} in {len(data)} bytes)"
        )
    flat = np.frombuffer(data, dtype) if data else np.zeros(0, dtype)
    return flat.reshape(shape, order=order)


def reduced(name: Any, given: tuple) -> Any:
    """What a known constructor makes."""
    made = KNOWN[name.what] if isinstance(name, Name) else None
    if made is None:
        raise Refused(f"refused, it wants to call {kind_of(name)}")
    return made(*given)


def filled(state: Any) -> Any:
    """The array that numpy's own words for it make; of one with objects, these."""
    version, shape, kind, fortran, data = of(state, tuple)
    if now.objects and isinstance(kind, _Type) and kind.dtype.hasobject:
        if not isinstance(data, list) or shape not in ((), (len(data),)) or not data:
            raise Refused("refused, its objects are not in one row")
        return data if shape else data[0]
    if version != 1 or not isinstance(kind, _Type) or isinstance(data, list):
        raise Refused("refused, an array of it holds objects, not numbers")
    return _numbers(kind, shape, _bytes(data), "F" if fortran else "C")


def behind(stream: io.BytesIO, state: Any) -> np.ndarray:
    """The array of joblib's whose numbers come next."""
    state = of(state, dict)
    if state.get("subclass") != Name("numpy.ndarray") or state.get("order") not in ("C", "F"):
        raise Refused("refused, an array of it is no plain numpy array")
    if state.get("numpy_array_alignment_bytes") is not None:
        stream.seek(ord(stream.read(1) or b"\0"), io.SEEK_CUR)
    kind, shape = of(state.get("dtype"), _Type), of(state.get("shape"), tuple)
    if not all(type(n) is int and 0 <= n < MOST for n in shape):
        raise Refused(f"is no sound pickle (an array of shape {_short(shape)})")
    size = prod(shape) * kind.dtype.itemsize
    data = b"" if size > len(stream.getbuffer()) else stream.read(size)
    return _numbers(kind, shape, data, state["order"])


def stored(named: Any, storages: Callable[[str, int], bytes | None]) -> Any:
    """Torch's numbers, as the pickle names them."""
    word, what, key, _, count, *_ = of(named, tuple)
    if word != "storage" or not isinstance(what, Name) or what.what not in _STORED:
        raise Refused(f"refused, it wants to load {kind_of(named)}")
    if type(count) is not int or not 0 <= count < MOST:
        raise Refused(f"is no sound pickle (a storage of {_short(count)} numbers)")
    code = _STORED[what.what]
    if code is None:
        return CLOSED
    size = count * np.dtype(code).itemsize
    data = storages(of(key, str), size)
    if data is None:
        return _Storage(code, key, count)
    if len(data) != size:
        raise Refused(f"is no sound pickle (a storage of {size} bytes in {len(data)})")
    return np.frombuffer(data, code) if data else np.zeros(0, code)


def _from_bytes(data: Any) -> Any:
    """The numbers of a tensor that lies in another pickle, in torch's older form; or CLOSED.

    That form is a magic number, the protocol, the system, the storage, and the list of keys, each
    a pickle; then for each key a count in eight bytes and the numbers.
    """
    if not isinstance(data, (bytes, bytearray)):
        return CLOSED
    if (known := now.storages.get(id(data))) is None:
        now.storages[id(data)] = (data, CLOSED)  # so that it cannot hold itself
        known = now.storages[id(data)] = (data, _older(bytes(data)))
    return known[1]


def _older(data: bytes) -> Any:
    at, parts = 0, []
    try:
        for _ in range(5):
            part, at = now.run(data, at, lambda key, size: None)
            parts.append(part)
    except (ValueError, KeyError, IndexError, TypeError):
        return CLOSED  # cut short, as pictures of people are
    magic, _, system, storage, keys = parts
    if magic != _MAGIC or not isinstance(storage, _Storage) or keys != [storage.key]:
        return CLOSED
    if not isinstance(system, dict) or system.get("little_endian") is not True:
        return CLOSED
    count, begin = int.from_bytes(data[at : at + 8], "little"), at + 8
    body = data[begin : begin + storage.count * np.dtype(storage.what).itemsize]
    if count != storage.count or len(body) != count * np.dtype(storage.what).itemsize or not count:
        return CLOSED
    return np.frombuffer(body, storage.what)


def _tensor(storage: Any, offset: Any, size: Any, stride: Any, *_: Any) -> Any:
    """A tensor of torch's: numbers of a storage, each axis by its own stride."""
    if not isinstance(storage, np.ndarray) or storage.ndim != 1:
        return CLOSED
    whole = [offset, *of(size, tuple), *of(stride, tuple)]
    if len(size) != len(stride) or len(size) > 8:
        raise Refused("is no sound pickle (a tensor without sizes or strides)")
    if not all(type(n) is int and 0 <= n < MOST for n in whole) or prod(size) > MOST_NUMBERS:
        raise Refused(f"refused, a tensor of size {_short(size)}")
    if not prod(size):
        return np.zeros(size, storage.dtype)
    last = offset + sum((n - 1) * step for n, step in zip(size, stride, strict=True))
    if last >= len(storage):
        raise Refused(f"is no sound pickle (a tensor of size {_short(size)} in {len(storage)})")
    step = storage.itemsize
    return np.lib.stride_tricks.as_strided(
        storage[offset:], size, [step * n for n in stride], writeable=False
    )


def _size(axes: Any) -> tuple:
    return tuple(of(axes, (tuple, list)))


def _closed(*_: Any) -> Any:
    return CLOSED


def _parameter(tensor: Any, *_: Any) -> Any:
    return tensor if isinstance(tensor, np.ndarray) else CLOSED


def build(what: Any, state: Any) -> None:
    """Give a dtype its byte order."""
    if isinstance(what, _Type):
        version, order, *rest = of(state, tuple)
        more = any(part is not None for part in rest[:3])  # fields, as of records
        if version != 3 or order not in ("<", ">", "|", "=") or more:
            raise Refused("refused, an array of it holds something else than numbers")
        if order in "<>":
            what.dtype = what.dtype.newbyteorder(order)
    elif what is not CLOSED:
        raise Refused(f"refused, it wants to set up {kind_of(what)}")


JOBLIB = "joblib.numpy_pickle.NumpyArrayWrapper"
_MAGIC = 0x1950A86A20F9469CFC6C  # of torch's older form
_STORED = {  # torch's numbers: numpy's; None: it has no such
    "torch.FloatStorage": "<f4", "torch.DoubleStorage": "<f8", "torch.HalfStorage": "<f2",
    "torch.LongStorage": "<i8", "torch.IntStorage": "<i4", "torch.ShortStorage": "<i2",
    "torch.CharStorage": "i1", "torch.ByteStorage": "u1", "torch.BoolStorage": "b1",
    "torch.BFloat16Storage": None, "torch.ComplexFloatStorage": None,
}  # fmt: skip
KNOWN: dict[str, Callable[..., Any] | None] = {
    "numpy.ndarray": None,
    "numpy.dtype": _dtype,
    "numpy.core.multiarray._reconstruct": _reconstruct,
    "numpy.core.multiarray.scalar": _scalar,
    "numpy.core.numeric._frombuffer": _frombuffer,
    "collections.OrderedDict": _ordered,
    "_codecs.encode": _encode,
    "__builtin__.bytes": _no_bytes,  # how protocol 2 writes none
    "builtins.bytes": _no_bytes,
    "torch._utils._rebuild_tensor_v2": _tensor,
    "torch._utils._rebuild_parameter": _parameter,
    "torch.storage._load_from_bytes": _from_bytes,
    "torch.Size": _size,
    "torch.device": _closed,
    JOBLIB: None,
    **dict.fromkeys(_STORED),
}
