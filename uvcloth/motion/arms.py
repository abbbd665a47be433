"""Distances of the bones of forearms and hands from torso and legs."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import LEG_PARTS, TORSO_PART, part_alone
from uvcloth.bodies.posing import posed_skin
from uvcloth.geometry.mesh import faces_around

TORSO_CLEARANCE = 0.02
"""Metres that bones of forearms and hands keep from the torso's skin: a forearm then touches it."""

LEG_CLEARANCE = 0.01
"""Metres that they keep from the skin of legs: a palm then touches it. Hands that hang have 1 to 2 cm."""

CLEARANCES = {TORSO_PART: TORSO_CLEARANCE, **dict.fromkeys(LEG_PARTS, LEG_CLEARANCE)}
"""Clearance of each part of the collider that arms stay out of."""

FOREARM_SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Places on the bone from elbow to wrist that are tested; the elbow itself may touch the ribs."""

HAND_SHARES = (0.6, 1.2, 1.8)
"""Places on the line from wrist to knuckles and on to the fingertips, in lengths of the palm."""

POINTS_AT_ONCE = 32
"""Points that are compared with all triangles of a part at once."""

FRAMES_AT_ONCE = 256
"""Frames whose parts are posed at once."""


@dataclass(frozen=True)
class PosedPart:
    """A part of a body in F frames, closed where others begin, and the clearance, m, that arms keep from it.

    vertices: (F, N, 3) m. faces: (M, 3). around: (N, K) faces of each vertex, as of `faces_around`.
    """

    vertices: Tensor
    faces: Tensor
    around: Tensor
    clearance: float

    def missing(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Metres (F, P) of clearance that points (F, P, 3) miss, and unit directions (F, P, 3) outwards.

        Negative where points are farther away. Both are by the nearest vertex.
        """
        distance, nearest = torch.cdist(points, self.vertices).min(-1)
        way = points - self._at(nearest)
        inside = torch.zeros_like(distance, dtype=torch.bool)
        # At folds, the nearest vertex's normal can mistake outside for inside: the winding number decides.
        for doubtful in ((way * self._normals(nearest)).sum(-1) < 0).nonzero().split(POINTS_AT_ONCE):
            frame, point = doubtful.unbind(1)
            inside[frame, point] = winds_around(self.vertices[frame][:, self.faces], points[frame, point])
        sign = torch.where(inside, -1.0, 1.0)
        outwards = sign[..., None] * way / distance.clamp(min=1e-9)[..., None]
        return self.clearance - sign * distance, outwards

    def _at(self, indices: Tensor) -> Tensor:
        """Places (F, ..., 3) m of the vertices (F, ...) of each frame."""
        flat = indices.flatten(1)[..., None].expand(-1, -1, 3)
        return self.vertices.gather(1, flat).view(*indices.shape, 3)

    def _normals(self, indices: Tensor) -> Tensor:
        """Area-weighted normals (F, P, 3) of vertices (F, P), not of unit length."""
        around = self.around[indices]
        a, b, c = self._at(self.faces[around.clamp(min=0)]).unbind(-2)
        normals = torch.linalg.cross(b - a, c - a)
        return (normals * (around >= 0)[..., None]).sum(2)


@dataclass(frozen=True)
class PosedTrunk:
    """The parts of a body that arms stay out of, posed in F frames."""

    parts: tuple[PosedPart, ...]

    def missing(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """As `PosedPart.missing`, of the part of which a point misses most."""
        by_part = [part.missing(points) for part in self.parts]
        missing, outwards = (torch.stack(some) for some in zip(*by_part, strict=True))
        most, part = missing.max(0)
        return most, outwards.gather(0, part[None, ..., None].expand(1, *points.shape))[0]


def posed_trunk(body: Body, transforms: Tensor) -> PosedTrunk:
    """The parts of a body that arms stay out of, posed by joint transforms (F, J, 3, 4)."""
    parts = []
    for part, clearance in CLEARANCES.items():
        used, collider = part_alone(body, part)
        if not len(used):
            continue
        faces = collider.parts[0]
        vertices = collider.vertices(posed_skin(body, transforms, used))
        around = faces_around(faces, vertices.shape[1])
        parts.append(PosedPart(vertices, faces, around, clearance))
    return PosedTrunk(tuple(parts))


def missing_clearance(body: Body, transforms: Tensor) -> Tensor:
    """Metres of clearance that each arm's bones miss at the worst place; negative where they keep more.

    transforms: (F, J, 3, 4) of the body. Returns (F, A) for the A arms that have forearm, hand and fingers.
    """
    missing = [
        posed_trunk(body, some).missing(places.flatten(1, 2))[0].unflatten(1, places.shape[1:3]).amax(2)
        for some in transforms.split(FRAMES_AT_ONCE)
        if (places := arm_places(body, some)).numel()
    ]
    return torch.cat(missing) if missing else transforms.new_zeros(len(transforms), 0)


def winds_around(corners: Tensor, points: Tensor) -> Tensor:
    """Mask (K,) of the points (K, 3) inside closed surfaces of triangles (K, M, 3, 3), one for each point.

    Sums up solid angles (van Oosterom and Strackee 1983).
    """
    a, b, c = (corners - points[:, None, None]).unbind(2)
    far_a, far_b, far_c = (side.norm(dim=-1) for side in (a, b, c))
    volume = (a * torch.linalg.cross(b, c)).sum(-1)
    products = (a * b).sum(-1) * far_c + (b * c).sum(-1) * far_a + (c * a).sum(-1) * far_b
    return torch.atan2(volume, far_a * far_b * far_c + products).sum(1) > math.pi


def arm_joints(body: Body) -> list[tuple[int, int, int, int]]:
    """Joints of upper arm, forearm, hand and fingers of each arm that has them all, left before right."""
    roles = body.skeleton.roles
    names = ("upper_arm", "forearm", "hand", "fingers")
    arms = ([roles.get(f"{side}_{name}", -1) for name in names] for side in ("left", "right"))
    return [
        (upper, lower, hand, tip) for upper, lower, hand, tip in arms if min(upper, lower, hand, tip) >= 0
    ]


def arm_places(body: Body, transforms: Tensor) -> Tensor:
    """Places (F, A, P, 3) m along the forearm and hand of each of `arm_joints`, posed by (F, J, 3, 4)."""
    heads, arms = body.skeleton.heads, []
    if not len(part_alone(body, TORSO_PART)[0]):
        return transforms.new_zeros(len(transforms), 0, 0, 3)
    for _, forearm, hand, fingers in arm_joints(body):
        places = []
        for start, end, shares in ((forearm, hand, FOREARM_SHARES), (hand, fingers, HAND_SHARES)):
            rest = torch.lerp(heads[start], heads[end], torch.tensor(shares)[:, None]).to(transforms)
            posed = transforms[:, start]
            places.append(rest @ posed[..., :3].mT + posed[:, None, :, 3])
        arms.append(torch.cat(places, dim=1))
    return torch.stack(arms, dim=1) if arms else transforms.new_zeros(len(transforms), 0, 0, 3)
