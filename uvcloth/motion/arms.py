"""Depth of the bones of forearms and hands in the torso."""

import math

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import TORSO_PART, make_collider
from uvcloth.bodies.posing import posed_skin
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.motion.roles import joint_roles

FOREARM_SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Places on the bone from elbow to wrist that are tested; the elbow itself may touch the ribs."""

HAND_SHARES = (0.6, 1.2, 1.8)
"""Places on the line from wrist to knuckles and on to the fingertips, in lengths of the palm."""

POINTS_AT_ONCE = 32
"""Points that are compared with all triangles of the torso at once."""


def arm_depth(body: Body, transforms: Tensor) -> Tensor:
    """Metres by which each arm's bones are inside the torso, at the deepest place; negative outside.

    transforms: (F, J, 3, 4) of the body. Returns (F, A) for the A arms that have forearm, hand and fingers;
    distances are to the nearest vertex of the torso's skin, which is closed where limbs and neck begin.
    """
    collider = make_collider(body)
    used, faces = collider.parts[TORSO_PART].unique(return_inverse=True)
    arms = [places for side in ("left", "right") if (places := _places(body, transforms, side)) is not None]
    if not arms or not len(faces):
        return transforms.new_zeros(len(transforms), 0)
    torso = collider.vertices(posed_skin(body, transforms))[:, used]
    normals = vertex_normals(torso, faces)
    places = torch.cat(arms, dim=1)
    distance, nearest = torch.cdist(places, torso).min(-1)
    at = nearest[..., None].expand(-1, -1, 3)
    outwards = ((places - torso.gather(1, at)) * normals.gather(1, at)).sum(-1)
    depth = -distance
    # At folds, the nearest vertex's normal can mistake outside for inside: the winding number decides.
    for at in (outwards < 0).nonzero().split(POINTS_AT_ONCE):
        frame, place = at.unbind(1)
        around = winds_around(torso[frame][:, faces], places[frame, place])
        depth[frame, place] *= torch.where(around, -1.0, 1.0)
    return depth.unflatten(1, (len(arms), -1)).amax(2)


def winds_around(corners: Tensor, points: Tensor) -> Tensor:
    """Mask (K,) of the points (K, 3) inside closed surfaces of triangles (K, M, 3, 3), one for each point.

    Sums up solid angles (van Oosterom and Strackee 1983).
    """
    a, b, c = (corners - points[:, None, None]).unbind(2)
    far_a, far_b, far_c = (side.norm(dim=-1) for side in (a, b, c))
    volume = (a * torch.linalg.cross(b, c)).sum(-1)
    products = (a * b).sum(-1) * far_c + (b * c).sum(-1) * far_a + (c * a).sum(-1) * far_b
    return torch.atan2(volume, far_a * far_b * far_c + products).sum(1) > math.pi


def _places(body: Body, transforms: Tensor, side: str) -> Tensor | None:
    """Places (F, P, 3) m along the forearm and hand of a side, None if the skeleton lacks them."""
    roles, heads = joint_roles(body.skeleton.names), body.skeleton.heads
    needed = [f"{side}_{part}" for part in ("forearm", "hand", "fingers")]
    if not all(role in roles for role in needed):
        return None
    forearm, hand, fingers = (roles[role] for role in needed)
    places = []
    for start, end, shares in ((forearm, hand, FOREARM_SHARES), (hand, fingers, HAND_SHARES)):
        rest = torch.lerp(heads[start], heads[end], torch.tensor(shares)[:, None])
        posed = transforms[:, start]
        places.append(rest @ posed[..., :3].mT + posed[:, None, :, 3])
    return torch.cat(places, dim=1)
