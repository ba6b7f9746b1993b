"""Files of torch and joblib: what lies around their pickles, which s3le.inert reads as data.

Torch itself is not asked: it is not there after a plain installation, takes seconds to begin, and
its own loader for weights has run programs of strangers before 2.6 (CVE-2025-32434).
"""

import bz2
import io
import lzma
import zipfile
import zlib
from pathlib import Path
from typing import Any

from s3le.human.text import MAX_BYTES, read_bytes, refusal
from s3le.inert import pickles

MOST_ENTRIES = 10_000
_AGAIN = 'torch.save(torch.load("{name}", weights_only=True), "{stem}_new.pt")'
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError, ValueError
)  # fmt: skip


def load_torch(path: Path | str) -> Any:
    """What a file of torch.save holds, its tensors as arrays.

    Raises:
        ClipError: another form than torch's since 1.6, damage, or something else than data.
    """
    path = Path(path)
    data = read_bytes(path, MAX_BYTES)
    if not data.startswith(b"PK"):
        again = _AGAIN.replace("{name}", path.name[:60]).replace("{stem}", path.stem[:60])
        raise refusal(path, None, f"is no file of torch.save since 1.6; with torch: {again}")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
            if len(sizes) > MOST_ENTRIES or sum(sizes.values()) > MAX_BYTES:
                raise refusal(path, None, "unpacks to more than is read")
            pickled = [name for name in sizes if Path(name).name == "data.pkl"]
            if len(pickled) != 1:
                raise refusal(path, None, f"has {len(pickled)} data.pkl in it, wanted one")
            root = pickled[0].removesuffix("data.pkl")
            if f"{root}byteorder" in sizes and archive.read(f"{root}byteorder") != b"little":
                raise refusal(path, None, "holds numbers of a big-endian machine")
            read: dict[str, bytes] = {}

            def storage(key: str, size: int) -> bytes:
                name = f"{root}data/{key}"
                if sizes.get(name) != size:
                    raise ValueError(f"a storage of {sizes.get(name)} bytes, wanted {size}")
                if key not in read:
                    read[key] = archive.read(name)
                return read[key]

            return pickles.load(path, archive.read(pickled[0]), storage)
    except _DAMAGE as damage:
        words = (str(damage).splitlines() or [type(damage).__name__])[0][:160]
        raise refusal(path, None, f"is no sound file of torch.save ({words})") from None


def unpacked(path: Path | str, data: bytes) -> bytes:
    """A pickle as it is, out of the compression that joblib writes it with.

    Raises:
        ClipError: longer than MAX_BYTES, or damage.
    """
    if data[:1] == b"x" and len(data) > 1 and int.from_bytes(data[:2], "big") % 31 == 0:
        one: Any = zlib.decompressobj()
    elif data[:2] == b"\x1f\x8b":
        one = zlib.decompressobj(31)
    elif data[:3] == b"BZh":
        one = bz2.BZ2Decompressor()
    elif data[:6] == b"\xfd7zXZ\0" or data[:3] == b"]\0\0":
        one = lzma.LZMADecompressor(memlimit=256 * 2**20)
    else:
        return data
    try:
        whole = one.decompress(data, MAX_BYTES + 1)
    except (zlib.error, lzma.LZMAError, OSError, ValueError, EOFError) as error:
        raise refusal(path, None, f"is no sound compressed pickle ({error})") from None
    if len(whole) > MAX_BYTES:
        raise refusal(path, None, f"unpacks to more than {MAX_BYTES >> 20} MiB")
    if not one.eof or one.unused_data:
        raise refusal(path, None, "is no sound compressed pickle (its end is missing)")
    return whole
