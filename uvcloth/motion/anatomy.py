"""Joint frames from joint positions: bones, lines of hips and shoulders, axes of knees and elbows."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

UNTWISTED = ("shin", "forearm", "foot")
"""Limb joints that turn almost only about one axis relative to their parent."""


@dataclass(frozen=True)
class JointFrames:
    """Frames of one joint over T poses, each times its weight: (T, 3, 3), columns left or hinge, back, bone.

    weights: (T,) from 0, only the bone is known, to 1. bones: (T, 3) unit directions of the bone. is_limb:
    the bone is exact, the twist about it is not. untwisted: the joint hardly twists relative to its parent.
    """

    frames: Tensor
    weights: Tensor
    bones: Tensor
    is_limb: bool
    untwisted: bool = False


def joint_frames(positions: Tensor, roles: Mapping[str, int]) -> dict[str, JointFrames]:
    """Frames of the joints that have a role, by role, from the posed joints (T, J, 3).

    The trunk's bone points from the hips to the shoulders. A limb's bone points along the limb; its hinge is
    the axis that the knee or elbow bends about, weighted by the sine of the bend. Fingers, toes and hands
    without fingers have the frame of their parent, a foot without toes that of the hips.
    """

    def joint(role: str) -> Tensor:
        return positions[:, roles[role]]

    hips_line = unit(joint("left_thigh") - joint("right_thigh"))
    shoulder_line = unit(joint("left_upper_arm") - joint("right_upper_arm"))
    hips = (joint("left_thigh") + joint("right_thigh")) / 2
    shoulders = (joint("left_upper_arm") + joint("right_upper_arm")) / 2
    spine = unit(shoulders - hips)
    lines = {"hips": hips_line, "lower_spine": unit(hips_line + shoulder_line)}
    frames = {
        role: _trunk(lines.get(role, shoulder_line), spine)
        for role in ("hips", "lower_spine", "middle_spine", "upper_spine", "lower_neck", "upper_neck", "head")
        if role in roles
    }
    for side in ("left", "right"):
        knee = torch.linalg.cross(*_bones(joint, side, "thigh", "shin", "foot"))
        elbow = torch.linalg.cross(*_bones(joint, side, "upper_arm", "forearm", "hand"))
        level = torch.linalg.cross(spine, shoulder_line if side == "left" else -shoulder_line)
        for bone, tip, hinge in (
            ("clavicle", "upper_arm", level),
            ("thigh", "shin", knee),
            ("shin", "foot", knee),
            ("foot", "toes", knee),
            ("upper_arm", "forearm", elbow),
            ("forearm", "hand", elbow),
            ("hand", "fingers", elbow),
        ):
            if f"{side}_{bone}" in roles and f"{side}_{tip}" in roles:
                along = unit(joint(f"{side}_{tip}") - joint(f"{side}_{bone}"))
                frames[f"{side}_{bone}"] = _limb(along, hinge, bone in UNTWISTED)
        # Ends have no bone: on average they continue their parent's, and a foot points as the pelvis does.
        frames.setdefault(f"{side}_foot", frames["hips"])
        frames.setdefault(f"{side}_hand", replace(frames[f"{side}_forearm"], is_limb=False))
        for end, above in (("toes", "foot"), ("fingers", "hand")):
            frames[f"{side}_{end}"] = replace(frames[f"{side}_{above}"], is_limb=False)
    return frames


def unit(vectors: Tensor) -> Tensor:
    """Vectors (..., 3) of length 1; those of length 0 stay so."""
    return torch.nn.functional.normalize(vectors, dim=-1)


def _bones(joint: Callable[[str], Tensor], side: str, *chain: str) -> tuple[Tensor, Tensor]:
    first, second, third = (joint(f"{side}_{part}") for part in chain)
    return unit(second - first), unit(third - second)


def _trunk(left: Tensor, up: Tensor) -> JointFrames:
    back = unit(torch.linalg.cross(up, left))
    frames = torch.stack([left, back, torch.linalg.cross(left, back)], dim=-1)
    return JointFrames(frames, torch.ones(len(left)).to(left), up, is_limb=False)


def _limb(bone: Tensor, hinge: Tensor, untwisted: bool) -> JointFrames:
    across = hinge - (hinge * bone).sum(-1, keepdim=True) * bone
    weights = across.norm(dim=-1)
    axis = unit(across)
    frames = torch.stack([axis, torch.linalg.cross(bone, axis), bone], dim=-1)
    return JointFrames(weights[:, None, None] * frames, weights, bone, True, untwisted)
