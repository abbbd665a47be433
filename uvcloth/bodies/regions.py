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
}
"""Region that a joint moves, by the ending of its name; the others move the torso."""


def face_regions(skeleton: Skeleton, weights: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    """Region and side of every face, from the joint that moves it most."""
    region_of_joint, side_of_joint = [], []
    for joint in skeleton.names:
        ending = next((s for s in REGION_SUFFIXES if joint.endswith(s)), "")
        region_of_joint.append(REGIONS.index(REGION_SUFFIXES.get(ending, "torso")))
        limb = REGION_SUFFIXES.get(ending, "torso") not in ("torso", "head")
        side_of_joint.append((1 if joint.startswith("L") else -1) if limb else 0)
    strongest = weights[faces].sum(1).argmax(1)
    return torch.tensor(region_of_joint)[strongest], torch.tensor(side_of_joint)[strongest]
