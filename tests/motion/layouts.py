"""A motion of our own body written as BVH in the conventions of other programs, independent of the reader."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from tests.motion.bvh_text import ROOT_CHANNELS, Joint, bvh_text
from uvcloth.motion.clip import Clip

ROLES = {
    "Hips": "hips", "LowerBack": "lower_spine", "Spine": "middle_spine", "Spine1": "upper_spine",
    "Neck": "lower_neck", "Neck1": "upper_neck", "Head": "head",
} | {
    f"{side}{name}": f"{side.lower()}_{role}"
    for side in ("Left", "Right")
    for name, role in {
        "UpLeg": "thigh", "Leg": "shin", "Foot": "foot", "ToeBase": "toes", "Shoulder": "clavicle",
        "Arm": "upper_arm", "ForeArm": "forearm", "Hand": "hand", "HandFinger1": "fingers",
    }.items()
}  # fmt: skip
"""Role of each joint of the body that a layout may have."""

TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
PARTS = ("thigh", "shin", "foot", "toes", "clavicle", "upper_arm", "forearm", "hand", "fingers")
MIDDLE = ("hips", "lower_spine", "middle_spine", "upper_spine", "lower_neck", "upper_neck", "head")


@dataclass(frozen=True)
class Layout:
    """Conventions of a file.

    middle, sides: names of the joints of MIDDLE and of PARTS, "-" for one that the file lacks; {S} is Left or
    Right, {s} l or r, {L} L or R. zero: the all-zero pose, see `zero_pose`. up: of the motion. unit: of a
    metre. order: of the rotation channels. above: joints above the hips. channels: "root" or "all" that move.
    """

    middle: str
    sides: str
    zero: str = "t_pose"
    up: str = "y"
    unit: float = 100.0
    order: str = "ZYX"
    above: tuple[str, ...] = ()
    channels: str = "root"

    def names(self) -> dict[str, str]:
        """Joint name of each role."""
        named = dict(zip(MIDDLE, self.middle.split(","), strict=True))
        for side in ("left", "right"):
            letters = {"S": side.title(), "s": side[0], "L": side[0].upper(), "side": side}
            for part, name in zip(PARTS, self.sides.split(","), strict=True):
                named[f"{side}_{part}"] = name.format(**letters)
        return {role: name for role, name in named.items() if name != "-"}


def write_layout(clip: Clip, layout: Layout, path: Path) -> None:
    """Write a clip on our body in a layout."""
    names = layout.names()
    joints = [j for j, name in enumerate(clip.skeleton.names) if ROLES.get(name) in names]
    roles = [ROLES[clip.skeleton.names[j]] for j in joints]
    parents = [_nearest(clip, j, joints) for j in joints]
    heads = clip.skeleton.heads[joints].double().numpy()
    at = {
        ROLES[n]: h.double().numpy()
        for n, h in zip(clip.skeleton.names, clip.skeleton.heads, strict=True)
        if n in ROLES
    }
    zero = zero_pose(layout.zero, roles, at, parents)
    axes = TO_Y_UP if layout.up == "y" else np.eye(3)

    world = axes @ clip.rotations[:, joints].double().numpy() @ np.swapaxes(zero, 1, 2) @ axes.T
    path_of_root = layout.unit * clip.translation.double().numpy() @ axes.T
    rows = [path_of_root]
    written: list[Joint] = []
    for index, parent in enumerate(parents):
        bone = heads[index] - heads[parent] if parent >= 0 else np.zeros(3)
        offset = layout.unit * axes @ (zero[parent] @ bone if parent >= 0 else bone)
        local = world[:, index] if parent < 0 else np.swapaxes(world[:, parent], 1, 2) @ world[:, index]
        turns = tuple(f"{axis}rotation" for axis in layout.order)
        moves = ("Xposition", "Yposition", "Zposition") if parent < 0 or layout.channels == "all" else ()
        if parent >= 0 and moves:
            rows.append(np.tile(offset, (len(world), 1)))
            offset = np.zeros(3)
        rows.append(Rotation.from_matrix(local).as_euler(layout.order, degrees=True))
        written.append((names[roles[index]], parent, tuple(np.round(offset, 6)), moves + turns))
    for name in reversed(layout.above):
        written = [(name, -1, (0.0, 0.0, 0.0), ROOT_CHANNELS), *((n, p + 1, o, c) for n, p, o, c in written)]
        rows = [np.zeros((len(world), 6)), *rows]
    path.write_text(bvh_text(written, np.concatenate(rows, axis=1), 1.0 / clip.fps), encoding="latin-1")


def zero_pose(kind: str, roles: list[str], at: dict[str, np.ndarray], parents: list[int]) -> np.ndarray:
    """World rotations (J, 3, 3) from the body's rest pose to a file's all-zero pose, in the body's axes.

    body: none. t_pose: arms to the sides, legs straight down. lying: that, turned from Z up to Y up. along_x:
    bones along +X and the axes of knees, elbows and hips along Z. along_y: bones along +Y, axes along X.
    twisted: that, the shins turned by 55 degrees about their bones. random: any rotation of every joint.
    """
    if kind == "random":
        return Rotation.random(len(roles), rng=np.random.default_rng(5)).as_matrix()
    zero = np.tile(np.eye(3), (len(roles), 1, 1))
    if kind == "body":
        return zero
    if kind in ("t_pose", "lying"):
        for index, role in enumerate(roles):
            side, _, part = role.partition("_")
            tip = {"upper_arm": "forearm", "forearm": "hand", "hand": "fingers"}.get(part)
            if part in ("thigh", "shin"):
                down = at[f"{side}_foot"] - at[f"{side}_thigh"]
                zero[index] = Rotation.from_euler("y", np.arctan2(down[0], -down[2])).as_matrix()
            elif tip is not None or part == "fingers":
                zero[index] = zero[parents[index]]
                if tip is not None:
                    aim = np.array([1.0 if side == "left" else -1.0, 0, 0])
                    zero[index] = smallest(at[f"{side}_{tip}"] - at[role], aim)
        return TO_Y_UP @ zero if kind == "lying" else zero
    target = np.eye(3)[:, [0, 2, 1]] if kind == "along_x" else np.eye(3)[:, [1, 0, 2]]
    for index, role in enumerate(roles):
        zero[index] = frame(target[:, 0], target[:, 1]) @ frame(*bone_and_hinge(role, at)).T
        if kind == "twisted" and role.endswith("shin"):
            zero[index] = Rotation.from_euler("y", 55, degrees=True).as_matrix() @ zero[index]
    return zero


def bone_and_hinge(role: str, at: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Direction of a joint's bone at rest, and an axis across it."""
    side, _, part = role.partition("_")
    tips = {
        "thigh": "shin", "shin": "foot", "foot": "toes", "toes": "foot", "clavicle": "upper_arm",
        "upper_arm": "forearm", "forearm": "hand", "hand": "fingers", "fingers": "hand",
    }  # fmt: skip
    if part not in tips:
        return np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
    tip = f"{side}_{tips[part]}"
    bone = at[tip] - at[role] if part not in ("toes", "fingers") else at[role] - at[tip]
    if part in ("upper_arm", "forearm", "hand", "fingers"):
        elbow, hand = at[f"{side}_forearm"], at[f"{side}_hand"]
        return bone, np.cross(elbow - at[f"{side}_upper_arm"], hand - elbow)
    return bone, np.array([1.0, 0, 0]) if part != "clavicle" else np.array([0.0, -1, 0])


def frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Orthonormal frame with the first column along a vector and the second in the plane of both."""
    first = first / np.linalg.norm(first)
    second = second - (second @ first) * first
    second = second / np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)], axis=1)


def smallest(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Rotation by the smallest angle from one direction to another."""
    axis = np.cross(source, target)
    angle = np.arctan2(np.linalg.norm(axis), source @ target)
    return Rotation.from_rotvec(angle * axis / max(np.linalg.norm(axis), 1e-12)).as_matrix()


@dataclass(frozen=True)
class Difference:
    """Worst joint of a clip against the true one, means over frames, whatever the heading of either."""

    joint: str
    degrees: float
    centimetres: float
    path_centimetres: float


def difference(found: Clip, true: Clip, names: dict[str, str]) -> Difference:
    """Compare two clips on our body: the joints that a layout has, but the fingers."""
    compared = set(names) - {"left_fingers", "right_fingers"}
    joints = [j for j, name in enumerate(true.skeleton.names) if ROLES.get(name) in compared]
    turn = _heading(found.rotations[0, 0] @ true.rotations[0, 0].T)
    turned = replace(true, rotations=turn @ true.rotations, translation=true.translation @ turn.T)
    relative = (found.rotations.mT @ turned.rotations)[:, joints]
    cosine = (relative.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2
    degrees = cosine.clamp(-1, 1).acos().rad2deg().mean(0)
    first, second = found.positions(), turned.positions()
    gap = ((first - first[:, :1]) - (second - second[:, :1])).norm(dim=-1).mean(0)[joints]
    paths = (found.translation - found.translation[:1]) - (turned.translation - turned.translation[:1])
    worst = int(degrees.argmax())
    return Difference(
        true.skeleton.names[joints[worst]],
        float(degrees[worst]),
        100 * float(gap.max()),
        100 * float(paths.norm(dim=-1).max()),
    )


def _heading(rotation: torch.Tensor) -> torch.Tensor:
    angle = torch.atan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1])
    return torch.from_numpy(Rotation.from_euler("z", float(angle)).as_matrix()).float()


def _nearest(clip: Clip, joint: int, joints: list[int]) -> int:
    """Number among `joints` of the nearest of them above a joint, -1 for none."""
    parent = clip.skeleton.parents[joint]
    while parent >= 0 and parent not in joints:
        parent = clip.skeleton.parents[parent]
    return joints.index(parent) if parent >= 0 else -1
