"""Rough shape of a character: our body stretched joint by joint to its lengths and widths.

The joints of both have the same anatomical places and the limbs point the same way. One affine map for each
joint, blended by the blend weights, therefore brings our body near the character's surface, whatever its
proportions. A part without a surface, as programs take skin away beneath clothes, gets the lengths alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.gather import gather
from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import face_normals
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.motion.anatomy import unit
from uvcloth.physics.exposure import spread

POINTS = 20000
"""Points sampled on a surface to measure it."""

FEWEST = 30
"""Least number of points from which the size of a body part is measured."""

RATIOS = (0.2, 5.0)
"""Least and greatest stretch of a part of the body."""

LEAST_COVERED = 0.3
"""Least area of a part, over that of our part at its length, from which its width is measured."""

WITHIN = (0.03, 0.97)
"""Quantiles of a part's points that bound its extent."""

TRUNK = ("Hips", "LHipJoint", "RHipJoint", "LowerBack", "Spine", "Spine1", "LeftShoulder", "RightShoulder")
HEAD = ("Neck", "Neck1", "Head")
LIMBS = {"UpLeg": "Leg", "Leg": "Foot", "Arm": "ForeArm", "ForeArm": "Hand"}
"""Joints of limbs by the ending of their names, and the joint that each points at."""


REGION_OF_LIMB = {"UpLeg": "thigh", "Leg": "calf", "Arm": "upper_arm", "ForeArm": "forearm"}


@dataclass(frozen=True)
class SkinnedSurface:
    """A surface that joints move: vertices (V, 3) m, faces (F, 3), weights (V, J)."""

    vertices: Tensor
    faces: Tensor
    weights: Tensor

    def sample(self, count: int) -> tuple[Tensor, Tensor]:
        """Points (P, 3) spread evenly over the area, and the joint (P,) that moves each most."""
        sample = spread(self.vertices, self.faces, count)
        weights = gather(self.weights, sample.corners, sample.barycentrics)
        return sample.points(self.vertices), weights.argmax(1)


def rough_fit(pattern: Body, skeleton: Skeleton, target: SkinnedSurface) -> Tensor:
    """Affine maps (J, 3, 4) that bring the pattern's surface near the target, one for each joint.

    skeleton: of the target, with the pattern's joints, at the same rest pose.
    """
    names = skeleton.names
    usual = SkinnedSurface(pattern.mesh.vertices, pattern.mesh.faces, pattern.weights)
    before, after = _Measured(usual, pattern.skeleton), _Measured(target, skeleton)
    trunk = _trunk(before, after)
    maps = []
    for name in names:
        side, ending = _parts_of(name)
        at_joint = _moved_to(trunk, before.head(name), after.head(name))
        if name in TRUNK or name == "Neck":
            maps.append(at_joint)
        elif name in HEAD:
            maps.append(_box(before, after, HEAD[1:], at_joint))
        elif ending in LIMBS:
            stretch = _limb(before, after, name, f"{side}{LIMBS[ending]}")
            maps.append(_moved_to(stretch, before.head(name), after.head(name)))
        elif ending in ("Foot", "ToeBase"):
            maps.append(_box(before, after, (f"{side}Foot", f"{side}ToeBase"), at_joint))
        else:
            maps.append(_box(before, after, _hand(names, side), at_joint))
    return torch.stack(maps)


class _Measured:
    """Points on a surface, each with the joint that moves it most, and the joints' positions."""

    def __init__(self, surface: SkinnedSurface, skeleton: Skeleton) -> None:
        self.points, self.joint = surface.sample(POINTS)
        self._area = float(face_normals(surface.vertices, surface.faces).norm(dim=1).sum()) / 2
        self.names, self._heads = skeleton.names, skeleton.heads

    def head(self, name: str) -> Tensor:
        return self._heads[self.names.index(name)]

    def on(self, joints: Sequence[str]) -> Tensor:
        """Points (P, 3) that some joints move most."""
        strongest = torch.tensor([name in joints for name in self.names])
        return self.points[strongest[self.joint]]

    def area(self, joints: Sequence[str]) -> float:
        """Area, m2, that some joints move most."""
        return self._area * len(self.on(joints)) / len(self.points)

    def box(self, joints: Sequence[str]) -> tuple[Tensor, Tensor] | None:
        """Lower and upper corner (3,) around the points of some joints, None where there are too few."""
        points = self.on(joints)
        if len(points) < FEWEST:
            return None
        low, high = points.quantile(torch.tensor(WITHIN), dim=0)
        return low, high

    def radius(self, joint: str, tip: str) -> float | None:
        """Median distance of a joint's points from its bone, m; None where there are too few."""
        points, start = self.on((joint,)), self.head(joint)
        if len(points) < FEWEST:
            return None
        along = unit(self.head(tip) - start)
        away = points - start
        return float((away - (away @ along)[:, None] * along).norm(dim=1).median())


def _trunk(before: _Measured, after: _Measured) -> Tensor:
    """Stretch (3, 3) of the trunk: its width and depth at the surface, its length by the joints."""
    usual, actual = (float(each.head("Neck")[2] - each.head("LeftUpLeg")[2]) for each in (before, after))
    stretch = torch.full((3,), actual / usual)
    boxes = before.box(TRUNK), after.box(TRUNK)
    covered = after.area(TRUNK) >= LEAST_COVERED * (actual / usual) ** 2 * before.area(TRUNK)
    if boxes[0] is not None and boxes[1] is not None and covered:
        stretch[:2] = ((boxes[1][1] - boxes[1][0]) / (boxes[0][1] - boxes[0][0]))[:2]
    return torch.diag(stretch.clamp(*RATIOS))


def _box(before: _Measured, after: _Measured, joints: Sequence[str], otherwise: Tensor) -> Tensor:
    """Map (3, 4) from box to box around some joints' points; `otherwise` where there are too few."""
    usual, actual = before.box(joints), after.box(joints)
    if usual is None or actual is None:
        return otherwise
    stretch = torch.diag(((actual[1] - actual[0]) / (usual[1] - usual[0])).clamp(*RATIOS))
    return _moved_to(stretch, (usual[0] + usual[1]) / 2, (actual[0] + actual[1]) / 2)


def _moved_to(stretch: Tensor, source: Tensor, target: Tensor) -> Tensor:
    """Map (3, 4) with the linear part (3, 3) that takes one point (3,) to another."""
    return torch.cat([stretch, (target - stretch @ source)[:, None]], dim=1)


def _limb(before: _Measured, after: _Measured, joint: str, tip: str) -> Tensor:
    """Stretch (3, 3) of a limb: along its bone by the lengths, across by the girths."""
    usual, actual = before.head(tip) - before.head(joint), after.head(tip) - after.head(joint)
    along = (actual.norm() / usual.norm()).clamp(*RATIOS)
    girths = before.radius(joint, tip), after.radius(joint, tip)
    covered = after.area((joint,)) >= LEAST_COVERED * float(along) ** 2 * before.area((joint,))
    across = along
    if girths[0] is not None and girths[1] is not None and covered:
        across = torch.tensor(girths[1] / girths[0])
    direction = unit(usual)
    outer = direction[:, None] * direction
    return across.clamp(*RATIOS) * (torch.eye(3) - outer) + along * outer


def region_of(joint: str) -> str:
    """Region of trunk and limbs that a joint moves, "" for head, hands and feet."""
    return "torso" if joint in TRUNK else REGION_OF_LIMB.get(_parts_of(joint)[1], "")


def _hand(names: Sequence[str], side: str) -> tuple[str, ...]:
    """Joints of one hand."""
    return tuple(
        name
        for name in names
        if name.startswith((f"{side}Hand", f"{side}Finger")) or name == f"{side[:1]}Thumb"
    )


def _parts_of(name: str) -> tuple[str, str]:
    """Side and the rest of a joint's name; a thumb has one letter for its side."""
    for side in ("Left", "Right"):
        if name.startswith(side):
            return side, name.removeprefix(side)
    return ("Left" if name.startswith("L") else "Right"), name[1:]
