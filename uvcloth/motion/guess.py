"""Roles of joints guessed from where they are, for skeletons whose names say nothing.

A person at rest is mirror symmetric. The two branches that reach the ground are the legs, the two that reach
farthest to the sides are the arms. They leave the trunk at the hips and the chest; the head is above, on the
plane of symmetry. Hip, knee and ankle are the three joints of a leg that make two bones of about one length,
together as long as a person's, with a bend in the middle; so are shoulder, elbow and wrist. Toes and knees
tell front from back, and so left from right.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from torch import Tensor, from_numpy

from uvcloth.geometry.roles import assign_roles
from uvcloth.motion.rest import standing_axis
from uvcloth.motion.retarget import REQUIRED_ROLES

TOLERANCE = 0.03
"""Distance, over the height of the skeleton, within which a joint is on the plane or mirrors another."""

LEG, ARM, FOREARM = 0.9, 0.63, 0.9
"""Hip to ankle, over the hip's height; shoulder to wrist, over hip to ankle; forearm, over the upper arm."""

BEND, BRANCHING = 0.3, 0.25
"""Largest reward for a bend in the middle joint, and for the second and third branch at the last: fingers."""

FEWEST_MIRRORED = 8
"""Least number of joints off the plane that mirror one another: three in each leg, and arms."""

GROUND = 0.12
"""Height, over that of the skeleton, below which the end of a branch is on the ground."""

CROWN = 1.5
"""Length of the last bone, over that of the one before, above which it is the head's."""

LEAST_FORWARD = 0.02
"""Least distance of toes before the ankles, over the leg, that tells front from back; also of the knees."""

LONGEST_CHAIN = 24
"""Joints of a limb that are considered."""


@dataclass(frozen=True)
class _Tree:
    """A skeleton in axes of its own: points (J, 3) in lateral, depth and upward direction, from the plane."""

    parents: tuple[int, ...]
    points: np.ndarray

    @property
    def height(self) -> float:
        return float(np.ptp(self.points[:, 2]))

    @property
    def tolerance(self) -> float:
        return TOLERANCE * self.height

    def children(self, joint: int) -> list[int]:
        return [child for child, parent in enumerate(self.parents) if parent == joint]

    def above(self, joint: int) -> list[int]:
        """A joint and all its ancestors, from the root."""
        way = [joint]
        while self.parents[way[-1]] >= 0:
            way.append(self.parents[way[-1]])
        return way[::-1]

    def mirrored(self, joint: int) -> int:
        """Joint nearest to the mirror image of another, -1 where none is within the tolerance."""
        away = np.linalg.norm(self.points - self.points[joint] * [-1.0, 1.0, 1.0], axis=1)
        nearest = int(away.argmin())
        return nearest if away[nearest] < 2.0 * self.tolerance else -1

    def toes(self, foot: int) -> list[int]:
        """Joints from a foot to the one below it that is farthest along the depth; the heel is closer."""
        below = [joint for joint in range(foot, len(self.parents)) if foot in self.above(joint)]
        tip = max(below, key=lambda joint: abs(float(self.points[joint, 1] - self.points[foot, 1])))
        way = self.above(tip)
        return way[way.index(foot) :]

    def branch(self, tip: int) -> tuple[int, list[int], list[int]] | None:
        """Joint from which two mirrored branches leave, and the joints of that to a tip and of the other."""
        other = self.mirrored(tip)
        if other < 0:
            return None
        ways = self.above(tip), self.above(other)
        shared = sum(first == second for first, second in zip(*ways, strict=False))
        near, far = (
            [joint for joint in way[shared:] if abs(self.points[joint, 0]) > self.tolerance] for way in ways
        )
        same = shared > 0 and len(near) == len(far) and 3 <= len(near) <= LONGEST_CHAIN
        return (ways[0][shared - 1], near, far) if same else None


def find_roles(
    names: Sequence[str],
    parents: Sequence[int],
    heads: Tensor,
    overrides: Mapping[str, str],
    table: Mapping[str, int],
) -> tuple[dict[str, int], bool]:
    """Find the joint of each role, and say if it is a guess.

    `assign_roles` decides if it finds all joints that are needed, otherwise `guess_roles` and the overrides;
    the arguments are theirs. Raises InputError as `assign_roles` does.
    """
    roles = assign_roles(names, overrides, table)
    if table or all(role in roles for role in REQUIRED_ROLES):
        return roles, False
    guess = guess_roles(parents, heads)
    if not guess:
        return roles, False
    return assign_roles(names, overrides, guess), True


def guess_roles(parents: Sequence[int], heads: Tensor) -> dict[str, int]:
    """Joint of each role of a skeleton at rest, empty where it does not look like a standing person.

    parents: J indices, -1 for a root, parents before children. heads: (J, 3), any unit and axes, turned about
    one of them at most.
    """
    points = heads.double().numpy()
    turns = (np.eye(3), *(_square(points, axis) for axis in range(3)))
    return next((roles for turn in turns if (roles := _guess_along_axes(parents, points @ turn.T))), {})


def _square(points: np.ndarray, axis: int) -> np.ndarray:
    """Rotation (3, 3) about an axis that turns principal directions of points (J, 3) to the other two.

    The lateral direction of what is mirror symmetric is one.
    """
    plane = [other for other in range(3) if other != axis]
    spread = points[:, plane] - points[:, plane].mean(0)
    directions = np.linalg.eigh(spread.T @ spread)[1]
    directions[:, 0] *= np.linalg.det(directions)
    turn = np.eye(3)
    turn[np.ix_(plane, plane)] = directions.T
    return turn


def _guess_along_axes(parents: Sequence[int], points: np.ndarray) -> dict[str, int]:
    """Joint of each role of joints (J, 3) that stand along an axis and face along another, empty for none."""
    sideways, plane = _lateral(points)
    if sideways < 0:
        return {}
    depth, up = sorted({0, 1, 2} - {sideways}, key=lambda axis: float(np.ptp(points[:, axis])))
    for sign in (1.0, -1.0):
        placed = (points - plane)[:, [sideways, depth, up]] * [1.0, 1.0, sign]
        limbs = _limbs(_Tree(tuple(parents), placed - [0.0, 0.0, placed[:, 2].min()]))
        if limbs is None:
            continue
        roles, forward = limbs
        # With up and front known, the left is at the right hand of a frame (left, back, up).
        axes = np.zeros((3, 3))
        axes[[0, 1, 2], [sideways, depth, up]] = 1.0, forward, sign
        sides = ("left", "right") if np.linalg.det(axes) < 0 else ("right", "left")
        side_of = dict(zip(("near", "far"), sides, strict=True))
        named = {_with_side(role, side_of): joint for role, joint in roles.items()}
        if standing_axis(from_numpy(points), named) is not None:
            return named
    return {}


def _lateral(points: np.ndarray) -> tuple[int, np.ndarray]:
    """Axis across the plane of symmetry, -1 for none, and a point (3,) on the plane."""
    tolerance = TOLERANCE * float(np.ptp(points, axis=0).max())
    middle = (points.max(0) + points.min(0)) / 2
    counts = []
    for axis in range(3):
        image = points.copy()
        image[:, axis] = 2 * middle[axis] - points[:, axis]
        nearest = np.linalg.norm(points[:, None] - image, axis=2).min(0)
        counts.append(
            ((np.abs(points[:, axis] - middle[axis]) > tolerance) & (nearest < 2 * tolerance)).sum()
        )
    best = int(np.argmax(counts))
    return (best if counts[best] >= FEWEST_MIRRORED else -1), np.eye(3)[best] * middle


def _limbs(tree: _Tree) -> tuple[dict[str, int], float] | None:
    """Joints by role, sides named near (where the lateral axis points) and far, and the sign of the front."""
    tips = [joint for joint in range(len(tree.parents)) if not tree.children(joint)]
    beside = [joint for joint in tips if tree.points[joint, 0] > tree.tolerance]
    low = [tip for tip in beside if tree.points[tip, 2] < GROUND * tree.height]
    legs = _farthest_branch(tree, low, -tree.points[:, 2])
    if legs is None:
        return None
    hips, *leg = legs
    thigh, knee, ankle = _limb(tree, leg[0], LEG * float(tree.points[leg[0][0], 2]), 1.0)
    held = {leg[0][0], leg[1][0]}
    free = [tip for tip in beside if not held & set(tree.above(tip))]
    arms = _farthest_branch(tree, free, tree.points[:, 0])
    if arms is None:
        return None
    chest, *arm = arms
    length = float(np.linalg.norm(tree.points[leg[0][ankle]] - tree.points[leg[0][thigh]]))
    shoulder, elbow, wrist = _limb(tree, arm[0], ARM * length, FOREARM)
    roles = {"hips": hips} | _trunk(tree, hips, chest, {arm[0][0], arm[1][0]})
    forward = 0.0
    for side, leg_chain, arm_chain in zip(("near", "far"), leg, arm, strict=True):
        hip_joint, knee_joint, foot = (leg_chain[place] for place in (thigh, knee, ankle))
        roles |= {f"{side}_thigh": hip_joint, f"{side}_shin": knee_joint, f"{side}_foot": foot}
        toes = tree.toes(foot)
        roles |= {f"{side}_toes": toes[1]} if len(toes) > 1 else {}
        forward += tree.points[toes[-1], 1] - tree.points[foot, 1]
        if len(toes) == 1:
            forward += tree.points[knee_joint, 1] - (tree.points[hip_joint, 1] + tree.points[foot, 1]) / 2
        places = {"upper_arm": shoulder, "forearm": elbow, "hand": wrist, "fingers": wrist + 1}
        roles |= {f"{side}_{part}": arm_chain[at] for part, at in places.items() if at < len(arm_chain)}
        first, upper_arm = tree.above(arm_chain[-1])[len(tree.above(chest))], arm_chain[shoulder]
        roles |= {f"{side}_clavicle": first} if first != upper_arm else {}
    if "head" not in roles or abs(forward) < LEAST_FORWARD * length:
        return None
    return roles, float(np.sign(forward))


def _with_side(role: str, sides: Mapping[str, str]) -> str:
    side, _, part = role.partition("_")
    return f"{sides[side]}_{part}" if side in sides else role


def _farthest_branch(
    tree: _Tree, tips: Sequence[int], reach: np.ndarray
) -> tuple[int, list[int], list[int]] | None:
    """The branch, as in `_Tree.branch`, to the tip of the greatest reach (J,) that has a mirror image."""
    branches = (tree.branch(tip) for tip in sorted(tips, key=lambda tip: -float(reach[tip])))
    return next((branch for branch in branches if branch is not None), None)


def _limb(tree: _Tree, chain: Sequence[int], length: float, ratio: float) -> tuple[int, int, int]:
    """Places in a chain of the three joints that make the likeliest limb.

    length: expected of both bones together. ratio: of the second bone to the first.
    """
    points = tree.points[chain]

    def cost(places: tuple[int, int, int]) -> float:
        first, middle, last = places
        bones = points[middle] - points[first], points[last] - points[middle]
        upper, lower = (max(float(np.linalg.norm(bone)), 1e-6 * tree.height) for bone in bones)
        bend = float(np.linalg.norm(np.cross(*bones))) / (upper * lower)
        fingers = BRANCHING * (min(max(len(tree.children(chain[last])), 1), 3) - 1)
        whole = (upper + lower) / max(length, 1e-6 * tree.height)
        return abs(np.log(ratio * upper / lower)) + abs(np.log(whole)) - min(bend, BEND) - fingers

    return min(combinations(range(len(chain)), 3), key=cost)


def _trunk(tree: _Tree, hips: int, chest: int, arms: set[int]) -> dict[str, int]:
    """Joints from above the hips to the head, by role."""
    below = set(tree.above(hips))
    spine = [joint for joint in tree.above(chest) if joint not in below]
    if len(spine) > 3:
        spine = [spine[0], spine[len(spine) // 2], spine[-1]]
    # The joint that the arms leave from is the upper spine, whatever is below it.
    roles = dict(zip(("upper_spine", "middle_spine", "lower_spine"), reversed(spine), strict=False))
    neck = _neck(tree, chest, arms | below)
    roles |= dict(zip(("lower_neck", "upper_neck"), neck[:-1], strict=False))
    return roles | ({"head": neck[-1]} if neck else {})


def _neck(tree: _Tree, chest: int, others: set[int]) -> list[int]:
    """Joints from the chest to the head, on the plane of symmetry."""

    def next_joints(joint: int) -> list[int]:
        middle = abs(tree.points[:, 0]) < tree.tolerance
        higher = tree.points[:, 2] > tree.points[joint, 2]
        return [c for c in tree.children(joint) if middle[c] and higher[c] and c not in others]

    neck: list[int] = []
    joint = chest
    while above := next_joints(joint):
        joint = max(above, key=lambda each: float(tree.points[each, 2]))
        neck.append(joint)
        if len(tree.children(joint)) > 1:
            return neck
    # A last bone that is much longer than the neck ends at the top of the head.
    lengths = np.linalg.norm(np.diff(tree.points[[chest, *neck]], axis=0), axis=1)
    return neck[:-1] if len(neck) > 2 and lengths[-1] > CROWN * lengths[-2] else neck
