"""Thousands of ways to break a file, each repeatable from its number.

A mutant is a good file with one to three things wrong with it: bytes flipped, lines or words
lost, numbers that are none, counts that lie, sections that come twice, another encoding, half of
another file. Nothing here knows what a reader should make of it.
"""

import random
import re
from collections.abc import Callable, Sequence

NUMBER = re.compile(rb"(?<![\w.])[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?(?![\w.])")
WHOLE = re.compile(rb"(?<![\w.+-])\d+(?![\w.])")
WORD = re.compile(rb"[^\s,;:\[\]{}()<>=\"']+")
NO_NUMBERS = (
    b"nan", b"NaN", b".nan", b"inf", b"-Infinity", b".inf", b"1e308", b"-1e308", b"1e999",
    b"-0", b"-0.0", b"1e-320", b"9" * 30, b"-" + b"9" * 400, b"9" * 5000, b"", b"1_0", b"0x10",
    b"1.2.3", b"1,5", b"--1", b"1e", b"+", b".", b"1#QNAN", b"null", b"true", b"[]", b"{}",
    "\u0661\u0662".encode(), "\uff11\uff12".encode(), b"'1'", b'"1"', b"1 1", b"$1", b"2021-01-01",
)  # fmt: skip
LIES = (b"0", b"1", b"2", b"3", b"255", b"65536", b"2147483648", b"1000000000", b"9" * 18,
        b"9" * 19, b"-1", b"1e9", b"1000000000000000000000")  # fmt: skip
NESTED = (
    (b"[", b"]"), (b'{"a":', b"}"), (b"- ", b""), (b"{a: ", b"}"), (b"<a>", b"</a>"),
    (b"<link name='a'>", b"</link>"), (b"JOINT a\n{\nOFFSET 0 0 0\n", b"}\n"),
    (b"begin\n", b"end\n"), (b"(", b")"), (b'"', b'"'), (b"<!--", b"-->"), (b"&a [*a,*a,", b"]"),
)  # fmt: skip
JUNK = b"0123456789.-+eE_ \n\r\t\0{}[]<>:,\"'#&*!|%@`/\\=\x1a\x7f\x80\xc3\xff\xfe"
LONGEST = 1_000_000  # [bytes] of a line that is put in
DEEPEST = 30_000  # levels that are put in

Kind = Callable[[random.Random, bytes, bytes], bytes]


def cut(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """Only the beginning."""
    return data[: dice.randrange(len(data))]


def cut_the_end(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """All but the last few bytes."""
    return data[: -dice.randint(1, 40)]


def behead(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """Only the end."""
    return data[dice.randrange(len(data)) :]


def flip(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A few bits flipped."""
    copy = bytearray(data)
    for _ in range(dice.choice((1, 1, 1, 2, 8, 64))):
        copy[dice.randrange(len(copy))] ^= 1 << dice.randrange(8)
    return bytes(copy)


def junk(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A few bytes replaced by ones that formats give a meaning to."""
    copy = bytearray(data)
    for _ in range(dice.choice((1, 1, 2, 5))):
        copy[dice.randrange(len(copy))] = dice.choice(JUNK)
    return bytes(copy)


def move_bytes(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A run of bytes lost, doubled, or put elsewhere."""
    at, to, length = dice.randrange(len(data)), dice.randrange(len(data)), dice.randint(1, 40)
    run = data[at : at + length]
    match dice.randrange(3):
        case 0:
            return data[:at] + data[at + length :]
        case 1:
            return data[:at] + run + data[at:]
        case _:
            return data[:to] + run + data[to:]


def _pieces(data: bytes, pattern: re.Pattern | None) -> list[bytes]:
    """Lines with their ends, or alternately gaps and words; joined they are the data."""
    if pattern is None:
        return data.splitlines(keepends=True)
    pieces, at = [], 0
    for found in pattern.finditer(data):
        pieces += [data[at : found.start()], found[0]]
        at = found.end()
    return [*pieces, data[at:]]


def move_pieces(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A line or a word lost, doubled, or exchanged with another."""
    lines = dice.random() < 0.5
    pieces = _pieces(data, None if lines else WORD)
    places = range(0 if lines else 1, len(pieces), 1 if lines else 2)
    if not places:
        return data
    a, b = dice.choice(places), dice.choice(places)
    match dice.randrange(4):
        case 0:
            pieces[a] = b""
        case 1:
            pieces[a] += (b"" if lines else b" ") + pieces[a]
        case 2:
            pieces[a], pieces[b] = pieces[b], pieces[a]
        case _:
            pieces[a] = pieces[b]
    return b"".join(pieces)


def _put_for(dice: random.Random, data: bytes, what: re.Pattern, by: Sequence[bytes]) -> bytes:
    found = list(what.finditer(data))
    if not found:
        return data
    at = dice.choice(found)
    return data[: at.start()] + dice.choice(by) + data[at.end() :]


def no_number(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A number replaced by what is none, or by one that is out of any range."""
    return _put_for(dice, data, NUMBER, NO_NUMBERS)


def scale(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A number made larger or smaller by powers of ten, or its sign turned."""
    by = (b"e%d" % dice.randint(-12, 12), b"e300", b"0", b"00000")
    found = list(NUMBER.finditer(data))
    if not found:
        return data
    at = dice.choice(found)
    if dice.random() < 0.2:
        return data[: at.start()] + b"-" + data[at.start() :]
    return data[: at.end()] + dice.choice(by) + data[at.end() :]


def lie(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A whole number replaced by another, which may be enormous."""
    return _put_for(dice, data, WHOLE, LIES)


def binary_lie(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """Four or eight bytes replaced by a length that cannot be."""
    size = dice.choice((4, 8))
    at = dice.choice((0, len(data) - 8, len(data) - 12, dice.randrange(len(data))))
    at = max(0, min(at, len(data) - size))
    value = dice.choice((0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1, len(data)))
    value &= 256**size - 1
    return data[:at] + value.to_bytes(size, "little") + data[at + size :]


def word(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A word replaced by an odd one: empty, very long, of another case, of another script."""
    found = list(WORD.finditer(data))
    if not found:
        return data
    at = dice.choice(found)
    own = at[0]
    odd = (
        b"", own.swapcase(), own[::-1], own + b"_", own[:-1], own * 500, b"../" * 30 + own,
        "\u202e\u2028\u00a0".encode() + own, b"\0" + own, own + b"\n" + own, b"~", b"*" + own,
        b"!!python/object:os.system " + own, b"&x; " + own, b"%s" * 5, own.replace(b"a", b"\xe4"),
    )  # fmt: skip
    return data[: at.start()] + dice.choice(odd) + data[at.end() :]


def rename(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A word replaced by another one of the file or an odd one, wherever it stands."""
    words = WORD.findall(data)
    if not words:
        return data
    own, other = dice.choice(words), dice.choice(words)[:200]
    return data.replace(own, dice.choice((other, other, own.swapcase(), own + b"_", b"x")))


def recode(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """The text in another encoding, or bytes that are no text in it."""
    text = data.decode("latin-1")
    at = dice.randrange(len(data))
    return dice.choice((
        text.encode("utf-16"), text.encode("utf-32"), b"\xef\xbb\xbf" + data, b"\xff\xfe" + data,
        data[:at] + b"\xc3\x28\xff" + data[at:], data[:at] + b"\xed\xa0\x80" + data[at:],
        text.encode("utf-7"), data[:at] + "\u00e9\u4e2d\U0001f600".encode() + data[at:],
    ))  # fmt: skip


def nul(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """Zero bytes, one or a block of them, in the middle or at the end."""
    at = dice.choice((dice.randrange(len(data)), len(data)))
    return data[:at] + b"\0" * dice.choice((1, 1, 4, 512)) + data[at + dice.randint(0, 4) :]


def long_line(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A very long run without a line end."""
    at = dice.randrange(len(data))
    unit = dice.choice((b" ", b"a", b"0", b"1 ", b"1,", b"\t", b"-", b"(", b'"a",', b"\\", b"a: "))
    length = dice.choice((300, 5_000, 200_000, LONGEST))
    return data[:at] + unit * (length // len(unit)) + data[at:]


def many_lines(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """One line, or an empty one, very often."""
    lines = data.splitlines(keepends=True)
    at = dice.randrange(len(lines))
    line = dice.choice((lines[at], b"\n", b"\r", b"# \n"))
    length = dice.choice((300, 5_000, 200_000))
    return b"".join(lines[:at]) + line * (length // len(line)) + b"".join(lines[at:])


def nest(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """Brackets of one kind within each other, closed again or not."""
    at = dice.randrange(len(data))
    opening, closing = dice.choice(NESTED)
    levels = dice.choice((3, 200, 3_000, DEEPEST))
    inside = opening * levels + dice.choice((b"", b"1")) + closing * dice.choice((levels, 0))
    return data[:at] + inside + data[at:]


def repeat(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """A block of lines, or all of them, a second time."""
    lines = data.splitlines(keepends=True)
    a, b = sorted((dice.randrange(len(lines)), dice.randint(1, len(lines))))
    a, b = dice.choice(((a, b), (0, len(lines))))
    at = dice.choice((b, len(lines)))
    return b"".join(lines[:at] + lines[a:b] + lines[at:])


def line_ends(dice: random.Random, data: bytes, _: bytes) -> bytes:
    """Other line ends, in all of the text or somewhere."""
    other = dice.choice((b"\r\n", b"\r", b"\n\n", b"\n\r", b"\x0c", b"\x85"))
    if dice.random() < 0.7:
        return data.replace(b"\n", other)
    at = dice.randrange(len(data))
    return data[:at] + other + data[at:]


def splice(dice: random.Random, data: bytes, other: bytes) -> bytes:
    """The beginning of one file with the end of another."""
    a, b = dice.randrange(len(data)), dice.randrange(len(other))
    if dice.random() < 0.5:  # at line ends
        a, b = data.rfind(b"\n", 0, a) + 1, other.rfind(b"\n", 0, b) + 1
    return data[:a] + other[b:]


def exchange(dice: random.Random, data: bytes, other: bytes) -> bytes:
    """Another file under this name."""
    foreign = (b"", b"\n", b"\0" * 4096, b"\x1f\x8b\x08\0" + data, b"PK\3\4")
    return dice.choice((other,) * 5 + foreign)


KINDS: tuple[Kind, ...] = (
    cut, cut_the_end, behead, flip, flip, junk, move_bytes, move_pieces, move_pieces, no_number,
    no_number, scale, lie, binary_lie, word, rename, recode, nul, long_line, many_lines, nest,
    repeat, line_ends, splice, exchange,
)  # fmt: skip


def mutant(data: bytes, others: Sequence[bytes], seed: str) -> tuple[bytes, str]:
    """One broken copy of a file.

    Args:
        data: the good file.
        others: files that may be mixed in.
        seed: the same words give the same copy, on any machine.

    Returns:
        Pair (copy, what was done to it).
    """
    dice = random.Random(seed)
    done = []
    copy = data
    for _ in range(dice.choices((1, 2, 3), (8, 2, 1))[0]):
        kind = dice.choice(KINDS)
        copy = kind(dice, copy or b" ", dice.choice(others) or b" ")
        done.append(kind.__name__)
    return copy, ", ".join(done)
