"""People by hand, in every list of joints that is read; shared by the tests of keypoints."""

import numpy as np

from s3le.human.keypoints import smpl
from s3le.skeleton import POINTS

# Our x forward, y left, z up in the axes of files.
INTO = {
    "camera": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
    "y-up": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "z-up": np.eye(3),
}
_BODY = {  # SMPL's joint for each that the lists have: right and left
    "hip": (0, 0), "neck": (12, 12), "shoulder": (17, 16), "elbow": (19, 18), "hand": (21, 20),
    "pelvis": (2, 1), "knee": (5, 4), "ankle": (8, 7), "toe": (11, 10), "head": (15, 15),
}  # fmt: skip
_LISTS = {  # place in the list: part and side
    "h36m17": {0: "hip", 1: "pelvis r", 2: "knee r", 3: "ankle r", 4: "pelvis l", 5: "knee l",
               6: "ankle l", 8: "neck", 9: "nose", 10: "head", 11: "shoulder l", 12: "elbow l",
               13: "hand l", 14: "shoulder r", 15: "elbow r", 16: "hand r"},
    "coco17": {0: "nose", 3: "ear", 4: "ear", 5: "shoulder l", 6: "shoulder r", 7: "elbow l",
               8: "elbow r", 9: "hand l", 10: "hand r", 11: "pelvis l", 12: "pelvis r",
               13: "knee l", 14: "knee r", 15: "ankle l", 16: "ankle r"},
    "mediapipe": {0: "nose", 7: "ear", 8: "ear", 11: "shoulder l", 12: "shoulder r",
                  13: "elbow l", 14: "elbow r", 15: "hand l", 16: "hand r", 23: "pelvis l",
                  24: "pelvis r", 25: "knee l", 26: "knee r", 27: "ankle l", 28: "ankle r"},
    "body25": {0: "nose", 1: "neck", 2: "shoulder r", 3: "elbow r", 4: "hand r", 5: "shoulder l",
               6: "elbow l", 7: "hand l", 8: "hip", 9: "pelvis r", 10: "knee r", 11: "ankle r",
               12: "pelvis l", 13: "knee l", 14: "ankle l", 17: "ear", 18: "ear"},
}  # fmt: skip
_LISTS["spin49"] = _LISTS["body25"] | {19: "toe l", 22: "toe r", 21: "ankle l", 24: "ankle r"}
COUNT = {"h36m17": 17, "coco17": 17, "mediapipe": 33, "body25": 25, "spin49": 49, "smpl": 24}


def pose(frames: int = 12) -> np.ndarray:
    """SMPL rotations [rad] of somebody who stands, turns and moves the arms, (n, 72)."""
    t = np.linspace(0.0, 1.0, frames)
    turns = np.zeros((frames, 24, 3))
    turns[:, 0, 1] = 0.7 * np.sin(3.0 * t)
    turns[:, 16, 2] = -1.0 + 0.5 * t  # left upper arm down, then up
    turns[:, 17, 2] = 1.2 - 0.3 * t
    turns[:, 18, 1] = -0.8 * t
    turns[:, 19, 1] = 0.5
    turns[:, 3, 0] = 0.1 * t
    return turns.reshape(frames, 72)


def body(frames: int = 12) -> np.ndarray:
    """SMPL's joints of this person, x forward, y left, z up [m], (n, 22, 3)."""
    return smpl.joints(pose(frames)) @ np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], float)


def points(joints: np.ndarray) -> np.ndarray:
    """The ten points of SMPL's joints, (n, 10, 3)."""
    sides = {"r": 0, "l": 1}
    at = [_BODY[p][0] if p in ("hip", "neck") else _BODY[p[2:]][sides[p[0]]] for p in POINTS]
    return joints[:, at]


def listed(layout: str, joints: np.ndarray) -> np.ndarray:
    """SMPL's joints (n, 22, 3) as another list of joints, (n, count, 3)."""
    n, count = len(joints), COUNT[layout]
    if layout == "smpl":
        return np.concatenate([joints, joints[:, 20:22]], axis=1)
    across = np.cross(joints[:, 1] - joints[:, 2], joints[:, 12] - joints[:, 0])
    forward = across / np.linalg.norm(across, axis=1, keepdims=True)
    made = np.zeros((n, count, 3)) + joints[:, 15:16]
    for place, what in _LISTS[layout].items():
        part, _, side = what.partition(" ")
        if part == "nose":
            made[:, place] = joints[:, 15] + 0.1 * forward
        elif part == "ear":
            made[:, place] = joints[:, 15]
        else:
            made[:, place] = joints[:, _BODY[part][side == "l"]]
    return made


def tilted(joints: np.ndarray, degrees: float) -> np.ndarray:
    """Camera joints as a camera sees them that looks down by so much."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return joints @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])


# --- as files with names

_TREE = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19)  # SMPL's 22
_PLACE = ("hip", "neck", "head", "collar", "shoulder", "elbow", "hand", "pelvis", "knee", "ankle",
          "toe")  # fmt: skip
_SMPL_PLACE = {"hip": (0,), "neck": (12,), "head": (15,), "collar": (14, 13),
               "shoulder": (17, 16), "elbow": (19, 18), "hand": (21, 20), "pelvis": (2, 1),
               "knee": (5, 4), "ankle": (8, 7), "toe": (11, 10)}  # fmt: skip
FAMILIES = {  # what right and left are; then _PLACE, - where a family has none
    "LAFAN1": "Right Left|Hips|Neck|Head|{}Shoulder|{}Arm|{}ForeArm|{}Hand|{}UpLeg|{}Leg|{}Foot|"
    "{}Toe",
    "lower case": "right left|hips|neck|head|{}shoulder|{}arm|{}forearm|{}hand|{}upleg|{}leg|{}foot"
    "|{}toe",
    "small a": "Right Left|Hips|Neck|Head|{}Shoulder|{}Arm|{}Forearm|{}Hand|{}UpLeg|{}Leg|{}Foot|"
    "{}ToeBase",
    "Mixamo": "Right Left|mixamorig:Hips|mixamorig:Neck|mixamorig:Head|mixamorig:{}Shoulder|"
    "mixamorig:{}Arm|mixamorig:{}ForeArm|mixamorig:{}Hand|mixamorig:{}UpLeg|mixamorig:{}Leg|"
    "mixamorig:{}Foot|mixamorig:{}ToeBase",
    "HumanIK": "Right Left|Character1_Hips|Character1_Neck|Character1_Head|Character1_{}Shoulder|"
    "Character1_{}Arm|Character1_{}ForeArm|Character1_{}Hand|Character1_{}UpLeg|Character1_{}Leg|"
    "Character1_{}Foot|Character1_{}ToeBase",
    "Perception Neuron": "Right Left|Robot_Hips|Robot_Neck|Robot_Head|Robot_{}Shoulder|Robot_{}Arm|"
    "Robot_{}ForeArm|Robot_{}Hand|Robot_{}UpLeg|Robot_{}Leg|Robot_{}Foot|-",
    "Biped": "R L|Bip01 Pelvis|Bip01 Neck|Bip01 Head|Bip01 {} Clavicle|Bip01 {} UpperArm|"
    "Bip01 {} Forearm|Bip01 {} Hand|Bip01 {} Thigh|Bip01 {} Calf|Bip01 {} Foot|Bip01 {} Toe0",
    "VRoid": "R L|J_Bip_C_Hips|J_Bip_C_Neck|J_Bip_C_Head|J_Bip_{}_Shoulder|J_Bip_{}_UpperArm|"
    "J_Bip_{}_LowerArm|J_Bip_{}_Hand|J_Bip_{}_UpperLeg|J_Bip_{}_LowerLeg|J_Bip_{}_Foot|"
    "J_Bip_{}_ToeBase",
    "iPi": "R L|Hip|Neck|Head|{}Clavicle|{}Shoulder|{}Forearm|{}Hand|{}Thigh|{}Shin|{}Foot|{}Toe",
    "Motive": "R L|Hip|Neck|Head|{}Shoulder|{}UArm|{}FArm|{}Hand|{}Thigh|{}Shin|{}Foot|{}Toe",
    "Motive's actor": "R L|Bob_Hip|Bob_Neck|Bob_Head|Bob_{}Shoulder|Bob_{}UArm|Bob_{}FArm|"
    "Bob_{}Hand|Bob_{}Thigh|Bob_{}Shin|Bob_{}Foot|Bob_{}Toe",
    "Unreal": "r l|pelvis|neck_01|head|clavicle_{}|upperarm_{}|lowerarm_{}|hand_{}|thigh_{}|calf_{}"
    "|foot_{}|ball_{}",
    "Unity": "Right Left|Hips|Neck|Head|{}Shoulder|{}UpperArm|{}LowerArm|{}Hand|{}UpperLeg|"
    "{}LowerLeg|{}Foot|{}Toes",
    "VRM": "right left|hips|neck|head|{}Shoulder|{}UpperArm|{}LowerArm|{}Hand|{}UpperLeg|"
    "{}LowerLeg|{}Foot|{}Toes",
    "SMPL": "R L|Pelvis|Neck|Head|{}_Collar|{}_Shoulder|{}_Elbow|{}_Wrist|{}_Hip|{}_Knee|{}_Ankle|"
    "{}_Foot",
    "SMPL-X": "right left|pelvis|neck|head|{}_collar|{}_shoulder|{}_elbow|{}_wrist|{}_hip|{}_knee|"
    "{}_ankle|{}_foot",
    "SMPL in Blender": "R L|f_avg_Pelvis|f_avg_Neck|f_avg_Head|f_avg_{}_Collar|f_avg_{}_Shoulder|"
    "f_avg_{}_Elbow|f_avg_{}_Wrist|f_avg_{}_Hip|f_avg_{}_Knee|f_avg_{}_Ankle|f_avg_{}_Foot",
    "Human3.6M": "R L|Hip|Thorax|Head|-|{}Shoulder|{}Elbow|{}Wrist|{}Hip|{}Knee|{}Foot|-",
    "SOMA": "Right Left|Hips|Neck1|Head|{}Shoulder|{}Arm|{}ForeArm|{}Hand|{}Leg|{}Shin|{}Foot|"
    "{}ToeBase",
    "Xsens": "Right Left|Hips|Neck|Head|{}Collar|{}Shoulder|{}Elbow|{}Wrist|{}Hip|{}Knee|{}Ankle|"
    "{}Toe",
    "Xsens' segments": "Right Left|Pelvis|Neck|Head|{}Shoulder|{}UpperArm|{}ForeArm|{}Hand|"
    "{}UpperLeg|{}LowerLeg|{}Foot|{}Toe",
    "Rokoko": "Right Left|Hips|Neck|Head|{}Shoulder|{}Arm|{}ForeArm|{}Hand|{}Thigh|{}Shin|{}Foot|"
    "{}Toe",
    "Bandai-Namco": "R L|Hips|Neck|Head|Shoulder_{}|UpperArm_{}|LowerArm_{}|Hand_{}|UpperLeg_{}|"
    "LowerLeg_{}|Foot_{}|Toes_{}",
    "DAZ": "r l|hip|neck|head|{}Collar|{}Shldr|{}ForeArm|{}Hand|{}Thigh|{}Shin|{}Foot|{}Toe",
    "DAZ Genesis": "r l|pelvis|neckLower|head|{}Collar|{}ShldrBend|{}ForearmBend|{}Hand|"
    "{}ThighBend|{}Shin|{}Foot|{}Toe",
    "ASF": "r l|root|lowerneck|head|{}clavicle|{}humerus|{}radius|{}wrist|{}femur|{}tibia|{}foot|"
    "{}toes",
    "Character Creator": "R L|CC_Base_Pelvis|CC_Base_NeckTwist01|CC_Base_Head|CC_Base_{}_Clavicle|"
    "CC_Base_{}_Upperarm|CC_Base_{}_Forearm|CC_Base_{}_Hand|CC_Base_{}_Thigh|CC_Base_{}_Calf|"
    "CC_Base_{}_Foot|CC_Base_{}_ToeBase",
    "Rigify": "R L|-|-|DEF-spine.006|DEF-shoulder.{}|DEF-upper_arm.{}|DEF-forearm.{}|DEF-hand.{}|"
    "DEF-thigh.{}|DEF-shin.{}|DEF-foot.{}|DEF-toe.{}",
    "Advanced Skeleton": "R L|Root_M|Neck_M|Head_M|Scapula_{}|Shoulder_{}|Elbow_{}|Wrist_{}|Hip_{}|"
    "Knee_{}|Ankle_{}|Toes_{}",
    "ARKit": "right left|hips_joint|neck_1_joint|head_joint|{}_shoulder_1_joint|{}_arm_joint|"
    "{}_forearm_joint|{}_hand_joint|{}_upLeg_joint|{}_leg_joint|{}_foot_joint|{}_toes_joint",
    "Kinect": "Right Left|SpineBase|Neck|Head|-|Shoulder{}|Elbow{}|Wrist{}|Hip{}|Knee{}|Ankle{}|"
    "Foot{}",
    "VRChat": "Right Left|Hips|Neck|Head|{} shoulder|{} arm|{} elbow|{} wrist|{} leg|{} knee|"
    "{} ankle|{} toe",
    "MikuMikuDance": "右 左|下半身|首|頭|{}肩|{}腕|{}ひじ|{}手首|{}足|{}ひざ|{}足首|{}つま先",
    "GENEA": "r l|b_root|b_neck0|b_head|b_{}_shoulder|b_{}_arm|b_{}_forearm|b_{}_wrist|b_{}_upleg|"
    "b_{}_leg|b_{}_foot|-",
    "Source": "R L|ValveBiped.Bip01_Pelvis|ValveBiped.Bip01_Neck1|ValveBiped.Bip01_Head1|"
    "ValveBiped.Bip01_{}_Clavicle|ValveBiped.Bip01_{}_UpperArm|ValveBiped.Bip01_{}_Forearm|"
    "ValveBiped.Bip01_{}_Hand|ValveBiped.Bip01_{}_Thigh|ValveBiped.Bip01_{}_Calf|"
    "ValveBiped.Bip01_{}_Foot|ValveBiped.Bip01_{}_Toe0",
}  # fmt: skip


def named(family: str) -> list[str]:
    """Names of SMPL's 22 joints as a family has them; spines are its own affair."""
    sides, *parts = FAMILIES[family].split("|")
    names = [f"extra {i}" for i in range(22)]
    for place, part in zip(_PLACE, parts, strict=True):
        for joint, side in zip(_SMPL_PLACE[place], sides.split(), strict=False):
            if part != "-":
                names[joint] = part.format(side)
    return names


def bvh_of(joints: np.ndarray, names: list[str], rest: str = "none", fps: float = 30.0) -> str:
    """SMPL's joints (n, 22, 3) in any axes as BVH whose joints all have places as channels.

    Args:
        joints: where they are.
        names: of the joints.
        rest: what the offsets say: "y" or "z", that the first frame's body stands along that
            axis, given its own axes; "none", all bones along x.
        fps: frames per second [Hz].
    """
    children: dict[int, list[int]] = {}
    for joint, above in enumerate(_TREE):
        children.setdefault(above, []).append(joint)
    order: list[int] = []

    def offset(joint: int) -> np.ndarray:
        if joint == 0:
            return np.zeros(3)
        bone = joints[0, joint] - joints[0, _TREE[joint]]
        if rest == "none":
            return np.array([np.linalg.norm(bone), 0.0, 0.0])
        up = joints[0, 12] - joints[0, 0]
        axis = {"y": 1, "z": 2}[rest]
        now = int(np.abs(up).argmax())  # exchange the axes so that the body stands along `axis`
        swapped = bone.copy()
        swapped[[axis, now]] = bone[[now, axis]]
        return swapped

    def text(joint: int) -> str:
        order.append(joint)
        place = " ".join(f"{v:.9f}" for v in offset(joint))
        own = f"{'ROOT' if joint == 0 else 'JOINT'} {names[joint]}\n{{\nOFFSET {place}\n"
        own += "CHANNELS 3 Xposition Yposition Zposition\n"
        below = "".join(map(text, children.get(joint, [])))
        return own + (below or "End Site\n{\nOFFSET 0 0 0\n}\n") + "}\n"

    head = "HIERARCHY\n" + text(0)
    local = [joints[:, j] - (joints[:, _TREE[j]] if j else 0.0) for j in order]
    table = np.stack(local, axis=1).reshape(len(joints), -1)
    rows = "\n".join(" ".join(f"{v:.9f}" for v in row) for row in table)
    return f"{head}MOTION\nFrames: {len(joints)}\nFrame Time: {1 / fps:.7f}\n{rows}\n"
