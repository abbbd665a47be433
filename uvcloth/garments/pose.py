"""Garments that were modelled on a body in another pose than its rest pose."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.attach import DIFFUSION, make_garment
from uvcloth.garments.placing import POINTS, ClothSample, misfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.roles import assign_roles
from uvcloth.geometry.rotations import smallest_rotation
from uvcloth.geometry.skeleton import Skeleton, joint_transforms
from uvcloth.geometry.skinning import blend_transforms, skin
from uvcloth.physics.surface import BodySurface

POSES = {"t": 0.0, "a": 45.0}
"""Degrees below the horizontal at which straight arms are held to the sides, by the name of the pose."""

ARM = ("upper_arm", "forearm", "hand")
"""Roles of the joints along an arm."""

LEG = ("thigh", "foot")
"""Roles of the joints at the ends of a leg."""

LIES_WELL = 0.02
"""Misfit, m, up to which cloth lies well enough on the rest pose."""

FAR_BETTER = 0.6
"""Largest share of that misfit which remains in the pose that a garment was modelled in: 0.13 to 0.5 for
sleeves of templates, 0.95 or more for garments modelled on the rest pose.
"""


def other_pose(mesh: Mesh, body: Body) -> str:
    """The one of POSES in which a body fits a mesh, placed on its rest pose, far better; "" for none."""
    cloth = ClothSample.of(mesh.vertices, mesh.faces, POINTS)
    misfits = {"": FAR_BETTER * float(misfit(cloth, BodySurface(body.mesh.vertices, body.mesh.faces)))}
    if misfits[""] < FAR_BETTER * LIES_WELL or not has_arms(body):
        return ""
    for pose in POSES:
        posed = posed_body(body, arms_held(body, pose)).mesh
        misfits[pose] = float(misfit(cloth, BodySurface(posed.vertices, posed.faces)))
    return min(misfits, key=lambda pose: misfits[pose])


def has_arms(body: Body) -> bool:
    """Test for arms and legs that are recognized by the names of their joints."""
    roles = assign_roles(body.skeleton.names, {})
    return all(f"{side}_{part}" in roles for side in ("left", "right") for part in (*ARM, *LEG))


@dataclass(frozen=True)
class Stance:
    """Pose of the limbs: straight arms, degrees below the horizontal, and legs, degrees that each leans out.

    None leaves them as they are in the rest pose.
    """

    arms: float | None = None
    legs: float | None = None

    def text(self) -> str:
        """Description of the pose, "" for the rest pose."""
        arms = f"arms {self.arms:.0f} degrees below the horizontal" if self.arms is not None else ""
        legs = f"legs {self.legs:.0f} degrees outwards" if self.legs is not None else ""
        return ", ".join(filter(None, (arms, legs)))


REST = Stance()


def arms_held(body: Body, pose: str) -> Tensor:
    """Joint transforms (J, 3, 4) from a body's rest pose to one of POSES: its arms turn, all else stays.

    Raises InputError naming the body if it has no arms.
    """
    if not has_arms(body):
        raise InputError(f"--garment-pose {pose}: body {body.name!r} has no arms that are recognized by name")
    return limbs_held(body, Stance(POSES[pose]))


def limbs_held(body: Body, stance: Stance) -> Tensor:
    """Joint transforms (J, 3, 4) from a body's rest pose to a stance. The body `has_arms`, and legs."""
    skeleton = body.skeleton
    roles = assign_roles(skeleton.names, {})
    turn_of: dict[int, Tensor] = {}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        arm = [roles[f"{side}_{part}"] for part in ARM] if stance.arms is not None else []
        for start, end in pairwise(arm):
            turn_of[start] = _turn(skeleton, start, end, sign, 90.0 - (stance.arms or 0.0))
        if stance.legs is not None:
            start, end = (roles[f"{side}_{part}"] for part in LEG)
            turn_of[start] = _turn(skeleton, start, end, sign, stance.legs)
    turns: list[Tensor] = []
    for joint, parent in enumerate(skeleton.parents):
        above = turns[parent] if parent >= 0 else torch.eye(3)
        turns.append(turn_of.get(joint, above))
    return joint_transforms(skeleton, torch.stack(turns)[None], skeleton.heads[:1])[0]


def _turn(skeleton: Skeleton, start: int, end: int, sign: float, outwards: float) -> Tensor:
    """Rotation (3, 3) of the line between two joints to an angle, degrees from straight down to its side."""
    line, angle = skeleton.heads[end] - skeleton.heads[start], math.radians(outwards)
    return smallest_rotation(
        line / line.norm(), torch.tensor([sign * math.sin(angle), 0.0, -math.cos(angle)])
    )


def posed_body(body: Body, transforms: Tensor) -> Body:
    """A body whose rest pose is the one that joint transforms (J, 3, 4) take it to."""
    heads = (transforms[..., :3] @ body.skeleton.heads[:, :, None]).squeeze(-1) + transforms[..., 3]
    vertices = skin(body.mesh.vertices, body.weights, transforms[None])[0]
    return replace(
        body,
        mesh=replace(body.mesh, vertices=vertices),
        skeleton=replace(body.skeleton, heads=heads),
        proxies={},
        base=None,
        appearance=None,
    )


def unposed(mesh: Mesh, posed: Body, transforms: Tensor) -> Mesh:
    """A mesh that lies on a body posed by joint transforms (J, 3, 4), transferred to the body's rest pose.

    Inverse of linear blend skinning by smooth weights.
    """
    garment = make_garment("", mesh, posed, DIFFUSION["tops"])
    blended = blend_transforms(garment.smooth_weights, transforms[None])[0].double()
    offset = mesh.vertices.double() - blended[..., 3]
    return replace(mesh, vertices=torch.linalg.solve(blended[..., :3], offset).float())
