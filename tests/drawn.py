"""Pictures that are drawn twice, their sizes, and rows of results for them."""

import struct
from pathlib import Path

from s3le.show import style

METHODS = list(style.METHODS)


def size_of(path: Path) -> tuple[int, int]:
    """Width and height of a PNG [pixels], its signature checked."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert b"Software" not in data and b"tIME" not in data and b"tEXt" not in data
    return struct.unpack(">II", data[16:24])


def twice(folder: Path, draw) -> tuple[int, int]:
    """Draw the same picture two times; its size once the bytes are known to agree."""
    first, second = folder / "deep" / "first.png", folder / "second.png"
    draw(first)
    draw(second)
    assert first.read_bytes() == second.read_bytes()
    assert not list(folder.rglob("*.part"))
    return size_of(first)


def rows_of(split: str, n: int, methods=METHODS) -> list[dict]:
    return [
        {
            "split": split,
            "clip": f"motion_{i:02d}",
            "method": key,
            "to_truth": 0.02 * (1 + k) + 0.001 * i,
            "to_human": 0.1,
            "frames": 30,
        }
        for i in range(n)
        for k, (key, _) in enumerate(methods)
    ]
