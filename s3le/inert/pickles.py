"""Pickles read as data: an interpreter that knows lists, words, numbers, arrays and tensors.

Python's own unpickler calls whatever a file names. This one imports nothing and calls nothing:
it reads the instructions one by one, keeps a stack of plain values, and knows by heart the few
names with which numpy, joblib and torch write their numbers. What of these is in another form
stays closed (CLOSED). Any other name or instruction refuses the file.
"""

import io
import pickletools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from s3le.errors import ClipError, S3leError
from s3le.inert.names import (
    JOBLIB,
    Array,
    Name,
    Refused,
    Wrapper,
    behind,
    build,
    dict_of,
    filled,
    kind_of,
    named,
    now,
    of,
    reduced,
    stored,
)  # fmt: skip


class Place(NamedTuple):
    """Where bytes of numbers lie in a pickle."""

    data: bytes | bytearray
    at: int  # [bytes] from the beginning


HIGHEST = 5  # protocol
MOST_STEPS = 400_000  # instructions of one file; a result of one frame has some hundreds
MOST_LARGE = 2_000_000  # of one that is large: PHALP writes some hundreds a frame
LARGE = 2 * 2**20  # [bytes]


def load(
    path: Path | str,
    data: bytes,
    storages: Callable[[str, int], bytes | None] | None = None,
    objects: bool = False,
    error: type[S3leError] = ClipError,
    places: dict[int, Place] | None = None,
) -> Any:
    """What a pickle holds: None, numbers, words, bytes, lists, tuples, dicts, arrays, CLOSED.

    Values may be shared, and a list may even hold itself: who walks through it counts the steps.

    Args:
        path: for messages.
        data: the pickle; arrays of joblib lie between its instructions.
        storages: gives torch's numbers, by their key and count of bytes; None: there are none.
        objects: whether arrays of objects are read, as lists.
        error: what a refusal is raised as.
        places: takes where bytes of numbers lie in data, by the id of the bytes, which it keeps.

    Raises:
        error: an instruction or a name that is not data's, damage, or more than MOST_STEPS.
    """
    now.begin(MOST_LARGE if len(data) > LARGE else MOST_STEPS, objects, _run)
    try:
        with warnings.catch_warnings():  # of odd escapes in texts of protocol 0
            warnings.simplefilter("ignore", DeprecationWarning)
            value, end = _run(data, 0, storages, places)
    except Refused as refusal:
        raise error(f"{path}: {refusal}") from None
    except (ValueError, KeyError, IndexError, TypeError, OverflowError, UnicodeError) as damage:
        words = (str(damage).splitlines() or [type(damage).__name__])[0][:160]
        raise error(f"{path}: is no sound pickle ({words})") from None
    finally:
        now.begin()
    if end != len(data):
        raise error(f"{path}: is no sound pickle ({len(data) - end} bytes after its end)")
    return value


def _run(
    data: bytes, at: int, storages: Any, places: dict[int, Place] | None = None
) -> tuple[Any, int]:
    """The value of the pickle at a byte, and the byte after its end."""
    stream = io.BytesIO(data)
    stream.seek(at)
    stack: list[Any] = []
    marks: list[int] = []
    memo: dict[int, Any] = {}
    frame_ends = at
    argument: Any
    place: Any  # an int: the stream can tell
    for code, argument, place in pickletools.genops(stream):
        now.left -= 1
        if now.left < 0:
            raise Refused(f"a pickle of more than {now.most} instructions is not read")
        name = code.name
        if place < frame_ends < stream.tell():
            raise Refused("is no sound pickle (an instruction of it is in two frames)")
        if name == "STOP":
            if len(stack) != 1 or marks:
                raise Refused(f"is no sound pickle ({len(stack)} values at its end)")
            if isinstance(stack[0], (Name, Array)):
                raise Refused(f"is no sound pickle (a {kind_of(stack[0])} at its end)")
            return stack[0], place + 1
        if name in _PUSHED:
            stack.append(argument)
            if places is not None and isinstance(argument, (bytes, bytearray)):
                places[id(argument)] = Place(argument, stream.tell() - len(argument))
        elif name in _CONSTANT:
            stack.append(_CONSTANT[name])
        elif name in _MADE:
            stack.append(_MADE[name]())
        elif name == "FRAME":
            begin, frame_ends = frame_ends, place + 9 + argument
            if place < begin or frame_ends > len(data):
                raise Refused("is no sound pickle (a frame of it is cut, or in another)")
        elif name == "PROTO":
            if argument > HIGHEST:
                raise Refused(f"is no sound pickle (protocol {argument})")
        elif name == "MARK":
            marks.append(len(stack))
        elif name in ("GLOBAL", "STACK_GLOBAL"):
            words = argument.split(" ", 1) if argument else [stack.pop(-2), stack.pop()]
            stack.append(named(*words))
        elif name in ("MEMOIZE", "PUT", "BINPUT", "LONG_BINPUT"):
            key = len(memo) if name == "MEMOIZE" else argument
            memo[key] = stack[-1]
            if isinstance(stack[-1], Array):
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
                raise Refused("is no sound pickle (values are missing)")
            stack[-count:] = [tuple(stack[-count:])]
        elif name in ("APPEND", "APPENDS"):
            more = _since(stack, marks) if name == "APPENDS" else [stack.pop()]
            of(stack[-1], list).extend(more)
        elif name in ("SETITEM", "SETITEMS"):
            more = _since(stack, marks) if name == "SETITEMS" else [stack.pop(-2), stack.pop()]
            of(stack[-1], dict).update(dict_of(more))
        elif name == "REDUCE":
            given = of(stack.pop(), tuple)
            stack.append(reduced(stack.pop(), given))
        elif name == "BUILD":
            state = stack.pop()
            what = stack[-1]
            if isinstance(what, Array):
                if isinstance(what, Wrapper):
                    if frame_ends > stream.tell():
                        raise Refused("is no sound pickle (numbers of an array in a frame)")
                    stack[-1] = behind(stream, state)
                    frame_ends = stream.tell()
                else:
                    stack[-1] = filled(state)
                memo |= {key: stack[-1] for key in what.noted if memo[key] is what}
            else:
                build(what, state)
        elif name == "NEWOBJ" and isinstance(stack[-2], Name) and stack[-2].what == JOBLIB:
            stack[-2:] = [Wrapper()]
        elif name == "BINPERSID" and storages is not None:
            stack.append(stored(stack.pop(), storages))
        else:
            raise Refused(f"refused, its instruction {name} at byte {place} is not data")
    raise Refused("is no sound pickle (it has no end)")


def _since(stack: list[Any], marks: list[int]) -> list[Any]:
    mark = marks.pop()
    taken = stack[mark:]
    del stack[mark:]
    return taken


_PUSHED = {
    "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT",
    "STRING", "BINSTRING", "SHORT_BINSTRING", "BINBYTES", "SHORT_BINBYTES", "BINBYTES8",
    "BYTEARRAY8", "UNICODE", "SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8",
}  # fmt: skip
_CONSTANT = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_MADE = {"EMPTY_LIST": list, "EMPTY_DICT": dict, "EMPTY_TUPLE": tuple}
_COLLECT: dict[str, Callable[[list], Any]] = {"LIST": list, "TUPLE": tuple, "DICT": dict_of}
_TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
