"""Regions of a skinned mesh, by the joints that move it."""

import torch
from torch import Tensor

from uvcloth.bodies.body import REGIONS
from uvcloth.geometry.skeleton import Skeleton

REGION_SUFFIXES = {
    "UpLeg": "thigh",
    "Leg": "calf",
    "Foot": "foot",
    "ToeBase": "foot",
    "ForeArm": "forearm",
    "Arm": "upper_arm",
    "Hand": "hand",
    "Thumb": "hand",
    "FingerBase": "hand",
    "HandFinger1": "hand",
    "Neck1": "head",
    "Head": "head",
    "_hip": "thigh",
    "_knee": "calf",
    "_ankle": "foot",
    "_foot": "foot",
    "_shoulder": "upper_arm",
    "_elbow": "forearm",
    "_wrist": "hand",
    "head": "head",
}
"""Region that a joint moves, by the ending of its name: in our bodies, and below those in SMPL's."""


def face_regions(skeleton: Skeleton, weights: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    """Region (F,) and side (F,), as of `Body`, of faces (F, 3), from the joint that moves each most.

    weights: (V, J). A joint with another name has its parent's region and side, a root the torso's.
    """
    region_of_joint: list[int] = []
    side_of_joint: list[int] = []
    for joint, parent in zip(skeleton.names, skeleton.parents, strict=True):
        ending = next((s for s in REGION_SUFFIXES if joint.endswith(s)), None)
        if ending is None:
            region_of_joint.append(region_of_joint[parent] if parent >= 0 else REGIONS.index("torso"))
            side_of_joint.append(side_of_joint[parent] if parent >= 0 else 0)
            continue
        limb = REGION_SUFFIXES[ending] != "head"
        region_of_joint.append(REGIONS.index(REGION_SUFFIXES[ending]))
        side_of_joint.append((1 if joint.startswith(("L", "left")) else -1) if limb else 0)
    strongest = weights[faces].sum(1).argmax(1)
    return torch.tensor(region_of_joint)[strongest], torch.tensor(side_of_joint)[strongest]
