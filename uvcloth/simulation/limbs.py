"""Limbs that have left their cloth: bones that stick through it, limbs outside their cuffs."""

from collections.abc import Mapping

import torch
from torch import Tensor

from uvcloth.bodies.collider import ARM_PARTS, FOREARM_PARTS, LEG_PARTS
from uvcloth.garments.places import hems
from uvcloth.geometry.mesh import boundary_edges, weld
from uvcloth.geometry.skeleton import Skeleton, joint_positions

COLLIDER_BONES = (
    ("left_upper_arm", "left_forearm"),
    ("right_upper_arm", "right_forearm"),
    ("left_thigh", "left_shin"),
    ("right_thigh", "right_shin"),
    ("left_shin", "left_foot"),
    ("right_shin", "right_foot"),
    ("left_forearm", "left_hand"),
    ("right_forearm", "right_hand"),
)
"""Roles of the joints at which the bones of the collider's arms and legs start and end."""

LIMBS = (
    ("left_upper_arm", "left_forearm", "left_hand"),
    ("right_upper_arm", "right_forearm", "right_hand"),
    ("left_thigh", "left_shin", "left_foot"),
    ("right_thigh", "right_shin", "right_foot"),
)
"""Roles of the joints of each limb, from the trunk outwards."""

BEYOND = {"hand": 0.2, "foot": 0.1}
"""Metres by which the last bone of a limb is extended, by the end of its last role: cuffs lie over wrists and
ankles, and a fast swing takes a sleeve over the hand.
"""


def limbs_left_percent(
    vertices: Tensor, rest: Tensor, faces: Tensor, transforms: Tensor, skeleton: Skeleton, touches: Tensor
) -> float:
    """Percent of frames in which a limb has left its cloth.

    vertices: (T, N, 3) m. rest: (N, 3) m. faces: (M, 3). transforms: (T, J, 3, 4). touches: (N,) int32, a bit
    per part of the collider. A limb has left its cloth in frames in which a bone crosses a face that is next
    to its part at rest, and in frames in which the limb is outside the cuff through which no other limb
    passes at rest.
    """
    if not len(vertices):
        return 0.0
    joints, roles = joint_positions(skeleton, transforms), skeleton.roles
    left = _pierced(vertices, faces, joints, roles, touches)
    limbs = [([roles[role] for role in limb], BEYOND[limb[-1].split("_")[-1]]) for limb in LIMBS]
    edges = boundary_edges(weld(rest)[faces])
    for hem in hems(edges):
        loop = edges[torch.isin(edges, hem).all(1)]
        passing = [
            (limb, beyond)
            for limb, beyond in limbs
            if _passes(skeleton.heads[None, limb], beyond, rest[None], loop).item()
        ]
        if len(passing) == 1:
            limb, beyond = passing[0]
            left |= ~_passes(joints[:, limb], beyond, vertices, loop)
    return 100.0 * float(left.float().mean())


def _pierced(
    vertices: Tensor, faces: Tensor, joints: Tensor, roles: Mapping[str, int], touches: Tensor
) -> Tensor:
    """Mask (T,) of the frames in which a bone crosses a face that lies beside its part at rest.

    joints: (T, J, 3) m. roles: the joint of each.
    """
    pierced = torch.zeros(len(vertices), dtype=torch.bool)
    for part, (start, end) in zip((*ARM_PARTS, *LEG_PARTS, *FOREARM_PARTS), COLLIDER_BONES, strict=True):
        beside = faces[((touches >> part) & 1).bool()[faces].all(1)]
        pierced |= _crosses(joints[:, roles[start]], joints[:, roles[end]], vertices[:, beside]).any(1)
    return pierced


def _passes(limb: Tensor, beyond: float, vertices: Tensor, edges: Tensor) -> Tensor:
    """Mask (T,) of the frames in which a limb, by its joints (T, 3, 3) m, passes through an opening.

    beyond: m by which its last bone is extended. edges: (E, 2) of the rim. It passes if it crosses a surface
    between the rim and its middle an odd number of times.
    """
    first, middle, last = limb.unbind(1)
    tip = last + beyond * torch.nn.functional.normalize(last - middle, dim=1)
    rim = vertices[:, edges]
    centre = rim.mean((1, 2), keepdim=True).expand(-1, len(edges), -1, -1)
    fan = torch.cat([rim, centre], dim=2)
    upper, lower = (_crosses(*bone, fan).sum(1) for bone in ((first, middle), (middle, tip)))
    return (upper + lower) % 2 == 1


def _crosses(heads: Tensor, tails: Tensor, corners: Tensor) -> Tensor:
    """Mask (T, F) of the triangles (T, F, 3 corners, 3) m that segments from heads to tails (T, 3) cross."""
    along = (tails - heads)[:, None]
    a, b, c = (corners - heads[:, None, None]).unbind(2)
    turns = torch.stack(
        [(along * torch.linalg.cross(p, q)).sum(-1) for p, q in ((a, b), (b, c), (c, a))], dim=-1
    )
    normal = torch.linalg.cross(b - a, c - a)
    before, after = -(a * normal).sum(-1), ((along - a) * normal).sum(-1)
    return ((turns > 0).all(-1) | (turns < 0).all(-1)) & (before * after < 0)
