"""Small humanoids as URDFs, built to order: other bases, fewer parts, zero poses, flaws."""

import re
from pathlib import Path

import numpy as np

WAIST = ("yaw", "roll", "pitch")
AXES = {"yaw": "0 0 1", "roll": "1 0 0", "pitch": "0 1 0"}
LIMIT = '<limit lower="{low}" upper="{high}" velocity="4" effort="1"/>'
BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = ((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
         (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3))  # fmt: skip


def joint(name, parent, child, xyz="0 0 0", axis="0 1 0", low=-2.0, high=2.0, kind="revolute",
          rpy="0 0 0", more="") -> str:  # fmt: skip
    limit = LIMIT.format(low=low, high=high) if kind == "revolute" else ""
    turn = f'<axis xyz="{axis}"/>' if kind != "fixed" else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/>{turn}{limit}{more}</joint>\n'
    )


def link(name, shape="", xyz="0 0 0", rpy="0 0 0", tag="collision", more="") -> str:
    body = f"<geometry>{shape}</geometry>"
    body = f'<{tag} name="{name}_c"><origin xyz="{xyz}" rpy="{rpy}"/>{body}</{tag}>'
    return f'<link name="{name}">{body if shape else ""}{more}</link>\n'


def capsule(radius, length) -> str:
    return f'<capsule radius="{radius}" length="{length}"/>'


def figure(
    waist=WAIST, arms="rl", base="0 0 0", forward=False, names="{side}_{part}", legs=True,
    torso='<box size="0.14 0.22 0.3"/>', elbow=(-2.3, 0.1), elbow_kind="revolute", elbow_more="",
    wrist=True, hand_frame=True, body=capsule, extra="",
) -> str:  # fmt: skip
    """A humanoid, arms hanging at zero; its lengths are 0.32 (hip to neck), 0.28, 0.24 m.

    Args:
        waist: joints of the waist.
        arms: sides that have one.
        base: roll, pitch, yaw of the whole figure in the base's frame [rad].
        forward: at zero the arms point forward.
        names: pattern of joint names; side is left or right.
        legs: two of them.
        torso, elbow, elbow_kind, elbow_more, wrist, hand_frame, body, extra: parts to replace.
    """
    text = '<?xml version="1.0"?>\n<robot name="figure" version="1.1">\n<link name="base"/>\n'
    text += joint("base_joint", "base", "pelvis", rpy=base, kind="fixed")
    text += link("pelvis", '<box size="0.14 0.2 0.12"/>')
    before, height = "pelvis", 0.1
    for part in waist:
        text += joint(f"waist_{part}", before, f"waist_{part}_link", f"0 0 {height}", AXES[part],
                      -0.7, 0.7)  # fmt: skip
        last = part == waist[-1]
        text += link(f"waist_{part}_link", torso if last else "", "0 0 0.15")
        before, height = f"waist_{part}_link", 0.0
    if not waist:
        text += joint("torso_joint", "pelvis", "torso", "0 0 0.1", kind="fixed")
        text += link("torso", torso, "0 0 0.15")
        before = "torso"
    text += joint("head_joint", before, "head", "0 0 0.36", kind="fixed")
    text += link("head", '<sphere radius="0.08"/>', "0 0 0.06")
    for side, y in (("right", -1), ("left", 1)):
        if side[0] in arms:
            text += _arm(side, y, before, forward, names, elbow, elbow_kind, elbow_more, wrist,
                         hand_frame, body)  # fmt: skip
        if legs:
            name = names.format(side=side, part="hip_pitch")
            text += joint(name, "pelvis", f"{name}_link", f"0 {0.08 * y} -0.05")
            text += link(f"{name}_link", capsule(0.05, 0.3), "0 0 -0.25")
            text += joint(f"{name}_knee", f"{name}_link", f"{name}_shin", "0 0 -0.4")
            text += link(f"{name}_shin", capsule(0.045, 0.3), "0 0 -0.2")
    return text + extra + "</robot>\n"


def _arm(side, y, before, forward, names, elbow, elbow_kind, elbow_more, wrist, hand_frame,
         body) -> str:  # fmt: skip
    def name(part):
        return names.format(side=side, part=part)

    turn = "0 -1.5707963267948966 0" if forward else "0 0 0"
    text = joint(name("shoulder_pitch"), before, name("sp"), f"0 {0.17 * y} 0.22", rpy=turn,
                 low=-3.0, high=3.0)  # fmt: skip
    text += link(name("sp"))
    text += joint(name("shoulder_roll"), name("sp"), name("sr"), axis="1 0 0",
                  low=-3.0 if y < 0 else -0.2, high=0.2 if y < 0 else 3.0)  # fmt: skip
    text += link(name("sr"), '<sphere radius="0.05"/>')
    text += joint(name("shoulder_yaw"), name("sr"), name("upper"), axis="0 0 1", low=-1.5,
                  high=1.5)  # fmt: skip
    text += link(name("upper"), body(0.04, 0.16), "0 0 -0.14")
    text += joint(name("elbow"), name("upper"), name("fore"), "0 0 -0.28", low=elbow[0],
                  high=elbow[1], kind=elbow_kind, more=elbow_more)  # fmt: skip
    text += link(name("fore"), body(0.035, 0.14), "0 0 -0.12")
    if wrist:
        text += joint(name("wrist_yaw"), name("fore"), name("wy"), "0 0 -0.1", "0 0 1", -1.5, 1.5)
        text += link(name("wy"))
        text += joint(name("wrist_pitch"), name("wy"), name("palm"), "0 0 -0.14", low=-0.8,
                      high=0.8)  # fmt: skip
        text += link(name("palm"), '<sphere radius="0.05"/>', "0 0 -0.05")
    elif hand_frame:
        text += joint(name("hand_joint"), name("fore"), name("hand"), "0 0 -0.24", kind="fixed")
        text += link(name("hand"))
    return text


def stripped(text: str, *links: str) -> str:
    """The figure without collision shapes, of these links or of all."""
    names = "|".join(links) if links else '[^"]*'
    return re.sub(f'(<link name="(?:{names})">)<collision.*?</collision>', r"\1", text)


def drawn(text: str, name: str, shape: str, xyz: str = "0 0 0") -> str:
    """The figure with one more shape that is drawn of a link."""
    head = f'<link name="{name}">'
    assert head in text
    seen = f'<visual><origin xyz="{xyz}"/><geometry>{shape}</geometry></visual>'
    return text.replace(head, head + seen, 1)


def write(folder: Path, text: str, name: str = "figure") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.urdf").write_text(text)
    return folder / f"{name}.urdf"


def stl(corners: np.ndarray) -> bytes:
    """A binary STL of a box-like solid with eight corners (8, 3) ordered as BOX."""
    triangles = corners[np.array(FACES)].astype("<f4")
    record = np.zeros(len(triangles), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = triangles
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + record.tobytes()


def obj(corners: np.ndarray) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in corners.tolist()]
    lines += ["f " + " ".join(str(k + 1) for k in face) for face in FACES]
    return ("\n".join(lines) + "\n").encode()


def dae(corners: np.ndarray) -> bytes:
    places = " ".join(repr(v) for v in corners.ravel().tolist())
    faces = " ".join(str(k) for face in FACES for k in face)
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="24">{places}</float_array><technique_common>
<accessor source="#a" count="8" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>{faces}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>
</COLLADA>""".encode()
