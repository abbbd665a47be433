"""Points of a body that keypoints of a photograph show, each attached to a joint."""

from collections.abc import Sequence

import torch
from torch import Tensor

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.geometry.skinning import apply_transforms

JOINTS = {
    **{"shoulder": "upper_arm", "elbow": "forearm", "wrist": "hand"},
    **{"hip": "thigh", "knee": "shin", "ankle": "foot"},
}
"""Role of the joint that a keypoint of a limb shows."""

EYE_HEIGHT, EYE_DISTANCE = 0.3, 0.4
"""Place of the eyes: above the nose over the height from there to the crown; from the middle, over the half
width of the head."""


def landmarks(body: Body, names: Sequence[str]) -> tuple[Tensor, Tensor]:
    """Joints (K,) and points at rest (K, 3) m of keypoints, words of BODY_25.

    A keypoint of a limb is its joint, the neck of OpenPose is between the shoulders. Nose, eyes, ears, toes
    and heels are points of the skin, found by where they lie at rest.
    """
    roles, heads = body.skeleton.roles, body.skeleton.heads
    points: dict[str, tuple[int, Tensor]] = {}
    for side in ("left", "right"):
        for part, role in JOINTS.items():
            joint = roles[f"{side}_{role}"]
            points[f"{side}_{part}"] = joint, heads[joint]
        points |= {f"{side}_{part}": (roles[f"{side}_foot"], at) for part, at in _foot(body, side).items()}
    head = roles.get("head", roles.get("upper_neck", roles.get("lower_neck", 0)))
    points |= {part: (head, at) for part, at in _face(body).items()}
    shoulders, hips = (
        (points[f"left_{part}"][1] + points[f"right_{part}"][1]) / 2 for part in ("shoulder", "hip")
    )
    points["neck"] = roles.get("upper_spine", 0), shoulders
    points["middle_hip"] = roles["hips"], hips
    joints, places = zip(*(points[name] for name in names), strict=True)
    return torch.tensor(joints), torch.stack(places)


def posed_landmarks(joints: Tensor, points: Tensor, transforms: Tensor) -> Tensor:
    """Points (B, K, 3) m of a body posed by joint transforms (B, J, 3, 4)."""
    return apply_transforms(transforms[:, joints], points)


def _face(body: Body) -> dict[str, Tensor]:
    """Nose, eyes and ears at rest."""
    skin = _region(body, "head")
    nose = skin[skin[:, 1].argmin()]
    above = skin[skin[:, 2] >= nose[2]]
    width, crown = above[:, 0].abs().max(), above[:, 2].max()
    places = {"nose": nose}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        places[f"{side}_ear"] = above[(sign * above[:, 0]).argmax()]
        height = nose[2] + EYE_HEIGHT * (crown - nose[2])
        front = above[above[:, 1] < above[:, 1].mean()]
        eye = torch.stack([sign * EYE_DISTANCE * width, height])
        places[f"{side}_eye"] = front[(front[:, [0, 2]] - eye).norm(dim=1).argmin()]
    return places


def _foot(body: Body, side: str) -> dict[str, Tensor]:
    """Toes and heel at rest."""
    sign = 1 if side == "left" else -1
    skin = _region(body, "foot", sign)
    across = sign * skin[:, 0]
    return {
        "big_toe": skin[skin[:, 1].argmin()],
        "small_toe": skin[(across - 0.5 * skin[:, 1]).argmax()],
        "heel": skin[(skin[:, 1] - skin[:, 2]).argmax()],
    }


def _region(body: Body, region: str, side: int = 0) -> Tensor:
    """Vertices (N, 3) at rest of a region and side."""
    faces = body.mesh.faces[(body.regions == REGIONS.index(region)) & (body.sides == side)]
    return body.mesh.vertices[faces.unique()]
