"""Small clips by hand, and a hundred ways to break a file; shared by the readers' tests."""

import csv
import gzip
import json
import random
from pathlib import Path

SHARED = Path(__file__).parents[2] / "shared" / "mocap"  # real motion, where it is at hand

# A stick figure: one file unit is 1 m, every axis frame but lradius' is the world's.
ASF = """\
# by hand
:version 1.10
:name STICK
:units
  mass 1.0
  length 0.0254
  angle deg
:documentation
   arms out, facing z
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
{bones}:hierarchy
  begin
    root lhipjoint rhipjoint thorax
    thorax lclavicle rclavicle
    lclavicle lhumerus
    lhumerus lradius
    rclavicle rhumerus
    rhumerus rradius
  end
"""
BONES = (  # name, direction, length, axis, dof
    ("lhipjoint", "1 0 0", 0.1, "0 0 0", ""),
    ("rhipjoint", "-1 0 0", 0.1, "0 0 0", ""),
    ("thorax", "0 1 0", 0.5, "0 0 0", "rx ry rz"),
    ("lclavicle", "1 0 0", 0.2, "0 0 0", "ry rz"),
    ("lhumerus", "1 0 0", 0.3, "0 0 0", "rx ry rz"),
    ("lradius", "1 0 0", 0.25, "90 0 0", "rz"),
    ("rclavicle", "-1 0 0", 0.2, "0 0 0", "ry rz"),
    ("rhumerus", "-1 0 0", 0.3, "0 0 0", "rx ry rz"),
    ("rradius", "-1 0 0", 0.25, "0 0 0", "rx"),
)
ZEROS = {
    "root": "1 2 3 0 0 0",
    "rclavicle": "0 0",
    "rhumerus": "0 0 0",
    "rradius": "0",
    "thorax": "0 0 0",
    "lclavicle": "-5.42682e-014 8.74653E-015",
    "lhumerus": "0 0 0",
    "lradius": "0",
}


def asf() -> str:
    """The stick figure's skeleton."""
    bones = ""
    for i, (name, direction, length, axis, dof) in enumerate(BONES, 1):
        bones += f"  begin\n     id {i}\n     name {name}\n     direction {direction}\n"
        bones += f"     length {length}\n     axis {axis} XYZ\n"
        if dof:
            bones += f"    dof {dof}\n    limits (-160.0 20.0)\n"
            bones += "           (-70.0 70.0)\n" * (len(dof.split()) - 1)
        bones += "  end\n"
    return ASF.format(bones=bones)


def amc(*frames: dict[str, str], first: int = 1, keyword: str = ":DEGREES") -> str:
    """A motion of the stick figure; each frame says what differs from ZEROS."""
    text = f"#!OML:ASF by hand\n:FULLY-SPECIFIED\n{keyword}\n"
    for number, frame in enumerate(frames, first):
        bones = ZEROS | frame
        text += f"{number}\n" + "".join(f"{name} {v}\n" for name, v in bones.items() if v)
    return text


def write(path: Path, content: str | bytes) -> Path:
    """A file with this content, gzipped where the name says so."""
    data = content.encode() if isinstance(content, str) else content
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(data, mtime=0) if path.suffix == ".gz" else data)
    return path


ARM_JOINTS = ("{}Shoulder", "{}Arm", "{}ForeArm", "{}Hand")


def bvh(
    rows: list[list[float]],
    order: str = "ZYX",
    prefix: str = "",
    step: str = ".0083333",
    scale: float = 1.0,
    arms: tuple[str, ...] = ARM_JOINTS,
    upright: str = "y",
) -> str:
    """A figure in metres times scale: rows of 6 root values, then 3 each for the left upper
    arm and the left forearm; every rotation in the given order of axes."""

    def place(x: float, y: float, z: float) -> str:
        xyz = (x, y, z) if upright == "y" else (x, -z, y)
        return " ".join(f"{v * scale:.6g}" for v in xyz)

    turning = " ".join(f"{axis}rotation" for axis in order)

    def arm(side: str, sign: int, channels: str) -> str:
        clavicle, upper, fore, hand = (prefix + name.format(side) for name in arms)
        return (
            f"JOINT {clavicle}\n{{\nOFFSET 0 0 0\n"
            f"JOINT {upper}\n{{\nOFFSET {place(0.2 * sign, 0, 0)}\n{channels}"
            f"JOINT {fore}\n{{\nOFFSET {place(0.3 * sign, 0, 0)}\n{channels}"
            f"JOINT {hand}\n{{\nOFFSET {place(0.25 * sign, 0, 0)}\n"
            f"End Site\n{{\nOFFSET 0 0 0\n}}\n}}\n}}\n}}\n}}\n"
        )

    head = (
        f"HIERARCHY\nROOT {prefix}Hips\n{{\nOFFSET 0 0 0\n"
        f"CHANNELS 6 Xposition Yposition Zposition {turning}\n"
        f"JOINT {prefix}LeftUpLeg\n{{\nOFFSET {place(0.1, 0, 0)}\nEnd Site\n"
        f"{{\nOFFSET 0 0 0\n}}\n}}\n"
        f"JOINT {prefix}RightUpLeg\n{{\nOFFSET {place(-0.1, 0, 0)}\nEnd Site\n"
        f"{{\nOFFSET 0 0 0\n}}\n}}\n"
        f"JOINT {prefix}Neck\n{{\nOFFSET {place(0, 0.5, 0)}\n"
        + arm("Left", 1, f"CHANNELS 3 {turning}\n")
        + arm("Right", -1, "")
        + "}\n}\n"
    )
    table = "\n".join(" ".join(f"{v:.12g}" for v in row) for row in rows)
    return f"{head}MOTION\nFrames: {len(rows)}\nFrame Time: {step}\n{table}\n"


def deepmimic(*frames: dict[int, list[float]], duration: float = 0.0333333) -> str:
    """A motion that stands still at rest; each frame says what differs, by first column."""
    rows = []
    for frame in frames:
        row = [duration, 0.0, 1.0, 0.0] + [0.0] * 40
        for first in (4, 8, 12, 16, 21, 25, 30, 35, 39):
            row[first] = 1.0
        for first, values in frame.items():
            row[first : first + len(values)] = values
        rows.append(row)
    return json.dumps({"Loop": "none", "Frames": rows}, indent=0)


def broken(data: bytes, count: int, seed: int) -> list[bytes]:
    """Copies of a file, each with a few bytes cut off, lost, doubled, swapped or flipped."""
    dice = random.Random(seed)
    copies = []
    for _ in range(count):
        copy = bytearray(data)
        for _ in range(dice.randint(1, 3)):
            at, length = dice.randrange(len(copy)), dice.randint(1, 12)
            match dice.randrange(7):
                case 0:
                    copy = copy[: max(at, 1)]
                case 1:
                    del copy[at : at + length]
                case 2:
                    copy[at:at] = copy[at : at + length]
                case 3:
                    copy[at] ^= 1 << dice.randrange(8)
                case 4:
                    copy[at] = dice.choice(b'0123456789.-+eE_ \n\r\0{}[]:"nNiI')
                case 5:
                    lines = copy.split(b"\n")
                    del lines[dice.randrange(len(lines))]
                    copy = bytearray(b"\n".join(lines))
                case 6:
                    other = dice.choice((b"nan", b"inf", b"1e999", b"-", b"9" * 30, b"1_0", b""))
                    copy[at : at + length] = other
            copy = copy or bytearray(b" ")
        copies.append(bytes(copy))
    return copies


def table(path: Path, columns: str, *rows: tuple) -> Path:
    """A CSV with these columns, comma-separated."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows([columns.split(","), *rows])
    return path
