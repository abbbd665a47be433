"""Joints of SMPL, SMPL-H and SMPL-X by their usual names, in the order of their files."""

import math

TRUNK_AND_LIMBS = (
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
)
"""Joints that all three models begin with."""

FINGERS = ("index", "middle", "pinky", "ring", "thumb")

HANDS = tuple(
    f"{side}_{finger}{segment}" for side in ("left", "right") for finger in FINGERS for segment in (1, 2, 3)
)
"""Finger joints of SMPL-H and SMPL-X."""

FACE = ("jaw", "left_eye_smplhf", "right_eye_smplhf")

SMPL_JOINTS = {
    "SMPL": (*TRUNK_AND_LIMBS, "left_hand", "right_hand"),
    "SMPL-H": (*TRUNK_AND_LIMBS, *HANDS),
    "SMPL-X": (*TRUNK_AND_LIMBS, *FACE, *HANDS),
}
"""Joints of each model: 24, 52 and 55."""

STANDING = (0.5 * math.pi, 0.0, 0.0)
"""Turn, as an axis times an angle, from the models' axes, Y up, facing +Z, to ours, Z up, facing -Y."""
