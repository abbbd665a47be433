"""Rest poses: the motion of any file relative to a pose in which the person stands.

A file's zero pose may be that pose. Where it is not (in LAFAN1 all bones point along one axis), the frame of
each joint in the standing pose is estimated from the motion: posed joints are where the file says, whatever
its zero pose is, and give the directions of bones, the lines of hips and shoulders, the axes of knees and
elbows.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.rotations import smallest_rotation
from uvcloth.motion.anatomy import JointFrames, joint_frames, unit
from uvcloth.motion.clip import Clip

Roles = Mapping[str, int]

ZERO_POSE = "the zero pose"
"""Origin of a rest pose that the file has."""

FRAMES_LOOKED_AT = 500
"""Most frames that an estimate uses, spread evenly over the clip."""

UPRIGHT = 0.7
"""Cosine between an axis and the line from feet to shoulders of a person who stands along it."""

FLOOR_SHARE = 0.3
"""Height of the lowest foot, over the length of a leg, that is still on the floor."""

AXIS_DEGREES = 20.0
"""Degrees within which an estimated frame snaps to the axes of its joint."""

BONE_DEGREES = 1.0
"""The same for a bone, whose direction is known."""

UNTWISTED_DEGREES = 45.0
"""Degrees from no twist relative to its parent within which a shin, forearm or foot snaps to it."""

TURNED_DEGREES = 25.0
"""Degrees between the line of the hips and an axis from which on a pose is one of a motion, not of rest."""

LOPSIDED = 0.2
"""Distance of a joint from the mirror image of its counterpart, over that of a leg, from which on too."""

LEAST_BEND = 0.05
"""Mean sine of the bend of knees or elbows below which they do not tell the axis that they bend about."""


@dataclass(frozen=True)
class ClipFromRest:
    """A clip relative to a standing rest pose.

    origin: where that pose comes from. up: axis along which the motion stands, "+y" and the like.
    """

    clip: Clip
    origin: str
    up: str


def find_rest(
    clip: Clip, roles: Roles, body: Body, up: str | None = None, rest_frame: int | None = None
) -> ClipFromRest:
    """Find the rest pose in which the person stands, and the clip relative to it, in the file's axes.

    The pose is that of a named frame; else the zero pose, if it stands as one does at rest: along the axes,
    the same on both sides; else estimated from the motion, with bones that point like the body's. up: "y" or
    "z", the axis that the motion stands along, by default that of most frames. Raises InputError if there is
    no such frame, if the person does not stand in it, and if no axis can be determined.
    """
    looked_at = torch.linspace(0, len(clip) - 1, min(len(clip), FRAMES_LOOKED_AT)).round().long().unique()
    thinned = replace(clip, rotations=clip.rotations[looked_at], translation=clip.translation[looked_at])
    positions = thinned.positions()
    if rest_frame is not None:
        return _from_frame(clip, roles, rest_frame)
    resting = standing_axis(clip.skeleton.heads, roles)
    if resting is not None and not _at_rest(clip.skeleton.heads, roles, resting):
        resting = None
    up_axis = _named_axis(up) if up else None
    if resting is None:
        axis = _motion_axis(positions, roles) if up_axis is None else up_axis
        return ClipFromRest(
            rebase(clip, _estimate(thinned, positions, roles, body, axis)), "the motion", axis_name(axis)
        )
    axis = _motion_axis_beside(resting, positions, roles) if up_axis is None else up_axis
    if float(axis @ resting) > 0.5:
        return ClipFromRest(clip, ZERO_POSE, axis_name(axis))
    turned = smallest_rotation(resting, axis).expand(len(clip.skeleton.names), 3, 3)
    return ClipFromRest(
        rebase(clip, turned), f"{ZERO_POSE}, turned from {axis_name(resting)} up", axis_name(axis)
    )


def rebase(clip: Clip, rest: Tensor) -> Clip:
    """Clip relative to the rest pose in which its joints have the world rotations `rest` (J, 3, 3)."""
    rest = rest.to(clip.rotations)
    heads = [clip.skeleton.heads[0]]
    for joint, parent in enumerate(clip.skeleton.parents[1:], start=1):
        bone = clip.skeleton.heads[joint] - clip.skeleton.heads[parent]
        heads.append(heads[parent] + rest[parent] @ bone)
    skeleton = replace(clip.skeleton, heads=torch.stack(heads))
    return replace(clip, skeleton=skeleton, rotations=clip.rotations @ rest.mT)


def standing_axis(heads: Tensor, roles: Roles) -> Tensor | None:
    """Axis (3,) along which a pose of the joints (J, 3) stands, arms anywhere to their sides, or None."""
    left_thigh, right_thigh = heads[roles["left_thigh"]], heads[roles["right_thigh"]]
    left_arm, right_arm = heads[roles["left_upper_arm"]], heads[roles["right_upper_arm"]]
    trunk = (left_arm + right_arm - left_thigh - right_thigh) / 2
    across = left_thigh - right_thigh
    up = nearest_axis(trunk)
    left = unit(across - (across @ up) * up)
    upright = trunk @ up > UPRIGHT * trunk.norm() and (across @ up).abs() < 0.5 * across.norm()
    for side, out in (("left", left), ("right", -left)):
        thigh, shin, foot, arm, hand = (
            heads[roles[f"{side}_{part}"]] for part in ("thigh", "shin", "foot", "upper_arm", "hand")
        )
        leg = (shin - thigh).norm() + (foot - shin).norm()
        upright = upright and -(foot - thigh) @ up > UPRIGHT * leg
        upright = upright and (hand - arm) @ out > -0.5 * (hand - arm).norm()
    return up if bool(upright) and float((left_arm - right_arm) @ left) > 0 else None


def _at_rest(heads: Tensor, roles: Roles, up: Tensor) -> bool:
    """Test for a pose of the joints (J, 3), standing along an axis, that is no moment of a motion.

    Some files of motion alone have their first frame in its place.
    """
    legs = heads[[roles["left_thigh"], roles["right_thigh"]]]
    across = legs[0] - legs[1]
    left = unit(across - (across @ up) * up)
    if float((left @ nearest_axis(left)).acos().rad2deg()) > TURNED_DEGREES:
        return False
    size = (heads[roles["left_foot"]] - legs[0]).norm()
    sides = ("thigh", "shin", "foot", "upper_arm", "forearm", "hand")
    mine, other = (heads[[roles[f"{side}_{part}"] for part in sides]] for side in ("left", "right"))
    away = other - legs.mean(0)
    mirrored = other - 2.0 * (away @ left)[:, None] * left
    return bool(((mine - mirrored).norm(dim=1) < LOPSIDED * size).all())


def nearest_axis(vector: Tensor) -> Tensor:
    """Signed unit vector (3,) of the axis that a vector (3,) is nearest to."""
    axis = torch.zeros_like(vector)
    largest = vector.abs().argmax()
    axis[largest] = 1.0 if vector[largest] >= 0 else -1.0
    return axis


def axis_name(axis: Tensor) -> str:
    """Name of a signed unit axis (3,): "+y"."""
    index = int(axis.abs().argmax())
    return f"{'+' if axis[index] > 0 else '-'}{'xyz'[index]}"


def _named_axis(name: str) -> Tensor:
    return torch.eye(3)["xyz".index(name)]


def _from_frame(clip: Clip, roles: Roles, frame: int) -> ClipFromRest:
    if not 0 <= frame < len(clip):
        raise InputError(f"--rest-frame {frame}: the file has the frames 0 to {len(clip) - 1}")
    pose = rebase(clip, clip.rotations[frame]).skeleton
    up = standing_axis(pose.heads, roles)
    if up is None:
        raise InputError(
            f"--rest-frame {frame}: the person does not stand upright in it (legs straight down, hands not "
            "crossed)"
        )
    across = pose.heads[roles["left_thigh"]] - pose.heads[roles["right_thigh"]]
    level = unit(across - (across @ up) * up)
    facing_axis = smallest_rotation(level, nearest_axis(level))
    return ClipFromRest(rebase(clip, facing_axis @ clip.rotations[frame]), f"frame {frame}", axis_name(up))


def _upright_shares(positions: Tensor, roles: Roles) -> Tensor:
    """Share of the frames in which the person stands along +x, +y, +z, -x, -y and -z: (6,)."""
    ends = {end: (f"left_{end}", f"right_{end}") for end in ("upper_arm", "foot")}
    top, low = (positions[:, [roles[role] for role in pair]].mean(1) for pair in ends.values())
    along = unit(top - low)
    return (torch.cat([along, -along], dim=1) > UPRIGHT).float().mean(0)


def _motion_axis(positions: Tensor, roles: Roles) -> Tensor:
    shares = _upright_shares(positions, roles)
    best = int(shares.argmax())
    if float(shares[best]) <= 0.5:
        raise InputError(
            "no axis points up in most of the frames, and the zero pose does not stand: "
            "give the up axis with --up y or --up z, or name a standing frame with --rest-frame"
        )
    return torch.cat([torch.eye(3), -torch.eye(3)])[best]


def _motion_axis_beside(resting: Tensor, positions: Tensor, roles: Roles) -> Tensor:
    """Axis of the motion: the zero pose's, unless the person stands on the floor of another one."""
    axes, positions = torch.cat([torch.eye(3), -torch.eye(3)]), positions.to(resting)
    shares = _upright_shares(positions, roles)
    axis = axes[int(shares.argmax())]
    if float(shares[int((axes @ resting).argmax())]) > 0.5 or float(shares.max()) <= 0.5:
        return resting
    chain = [positions[0, roles[f"left_{bone}"]] for bone in ("thigh", "shin", "foot")]
    leg = (chain[1] - chain[0]).norm() + (chain[2] - chain[1]).norm()
    feet = (positions[:, [roles["left_foot"], roles["right_foot"]]] @ axis).amin(1) / leg
    return axis if float(feet.abs().quantile(0.8)) < FLOOR_SHARE else resting


def _estimate(clip: Clip, positions: Tensor, roles: Roles, body: Body, up: Tensor) -> Tensor:
    """World rotations (J, 3, 3) of the joints in a standing pose whose bones point like the body's.

    With G_j(t) the rotations of a joint and F_j(t) the frame that posed joints give it, K_j, the rotation
    nearest to the mean of G_j(t)^T F_j(t), is that frame in the joint's own axes. In the standing pose, where
    the frame is that of the body, F_j, the joint has the rotation F_j K_j^T.
    """
    posed = joint_frames(positions.double(), roles)
    on_body = body.skeleton.roles
    shared = {role: joint for role, joint in on_body.items() if role in roles}
    target = joint_frames(_straight_legs(body, on_body)[None].double(), shared)
    across = (positions[:, roles["left_thigh"]] - positions[:, roles["right_thigh"]]).mean(0).to(up)
    left = nearest_axis(across - (across @ up) * up)
    to_body = torch.stack([left, torch.linalg.cross(up, left), up]).double()

    role_of = {joint: role for role, joint in roles.items()}
    rest: list[Tensor] = []
    for joint, parent in enumerate(clip.skeleton.parents):
        role = role_of.get(joint, "")
        above = rest[parent] if parent >= 0 else torch.eye(3).double()
        if role in posed and role in target:
            rest.append(_rest_of(clip.rotations[:, joint].double(), posed[role], target[role], above))
        else:
            rest.append(above)
    return to_body.mT @ torch.stack(rest)


def _rest_of(rotations: Tensor, posed: JointFrames, target: JointFrames, above: Tensor) -> Tensor:
    """Rotation (3, 3) of a joint in the standing pose, given that of the joint above it there.

    rotations: (T, 3, 3) of the joint in the motion. The twist of a limb that hardly bends is unknown: it is
    that of the joint above.
    """
    bone = unit((rotations.mT @ posed.bones[:, :, None]).mean(0).squeeze(-1))
    untwisted = smallest_rotation(unit(above @ bone), target.bones[0]) @ above
    if float(posed.weights.mean()) < LEAST_BEND:
        return untwisted
    local = _to_axes(_nearest_rotation((rotations.mT @ posed.frames).sum(0)), bone, posed.is_limb)
    # Frames at rest are scaled by their weights as well.
    estimate = _nearest_rotation(target.frames[0]) @ local.mT
    if posed.untwisted and _degrees(estimate, untwisted) < UNTWISTED_DEGREES:
        return untwisted
    return estimate


def _to_axes(frame: Tensor, bone: Tensor, is_limb: bool) -> Tensor:
    """An estimated frame (3, 3), snapped to the joint's own axes if these are close."""
    order = frame.abs().argmax(0)
    along = torch.zeros_like(frame)
    along[order, torch.arange(3)] = frame.gather(0, order[None]).sign().squeeze(0)
    if float(torch.linalg.det(along)) < 0.5 or _degrees(frame, along) > AXIS_DEGREES:
        return frame
    if is_limb and float(bone.abs().max().clamp(max=1.0).acos().rad2deg()) > BONE_DEGREES:
        return frame
    return along


def _nearest_rotation(matrix: Tensor) -> Tensor:
    left, _, right = torch.linalg.svd(matrix)
    sign = torch.ones(3).to(matrix)
    sign[2] = torch.linalg.det(left @ right)
    return (left * sign) @ right


def _degrees(first: Tensor, second: Tensor) -> float:
    """Angle between two rotations (3, 3), degrees."""
    cosine = ((first * second).sum() - 1.0) / 2.0
    return float(cosine.clamp(-1.0, 1.0).acos().rad2deg())


def _straight_legs(body: Body, roles: Roles) -> Tensor:
    """Joints of the body at rest (J, 3) with legs that point straight down, seen from the front."""
    heads = body.skeleton.heads.clone()
    for side in ("left", "right"):
        thigh = roles[f"{side}_thigh"]
        shift = torch.zeros(3)
        for part in ("shin", "foot", "toes"):
            joint = roles.get(f"{side}_{part}")
            if joint is not None:
                if part != "toes":
                    shift = torch.tensor([float(heads[thigh, 0] - heads[joint, 0]), 0.0, 0.0])
                heads[joint] = heads[joint] + shift
    return heads
