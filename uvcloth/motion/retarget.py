"""Retargeting of a motion from any known skeleton to a body's own.

Rotations are transferred, not positions: capture skeletons leave bones out or give them no length. Both rest
poses are first brought to a common one, the T-pose of the capture skeleton.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.rotations import from_axis_angles, from_euler, smallest_rotation, to_axis_angles
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.motion.clip import Clip, require_fps
from uvcloth.motion.rest import nearest_axis

LIMB_BONES = {
    f"{side}_{bone}": f"{side}_{tip}"
    for side in ("left", "right")
    for bone, tip in {
        "thigh": "shin",
        "shin": "foot",
        "upper_arm": "forearm",
        "forearm": "hand",
        "hand": "fingers",
    }.items()
}
"""Bones whose rest directions are aligned, and the joint that each points at."""

REQUIRED_ROLES = ("hips", *LIMB_BONES, "left_foot", "right_foot")

FLOOR_PERCENTILE = 15.0
"""Percentile of the lowest vertex over frames: below jumps, above bent toes and the capture's drift."""

SKINNED_AT_ONCE = 256
"""Frames that are skinned at once."""


def retarget(clip: Clip, body: Body, fps: float = 30.0, roles: Mapping[str, int] | None = None) -> Clip:
    """Retarget a clip on any known skeleton to a body: resampled, feet on the floor z = 0.

    The clip may be in any unit and any right-handed axes in which its rest pose stands along one of
    them. For a joint j that both skeletons have, the world rotation relative to the body's rest pose is
    Q_j(t) = G_j(t) G_j(T-pose)^T A_j, with G the clip's rotations in the body's axes and A_j the smallest
    rotation from the body's rest bone to the T-pose bone (limbs; identity elsewhere). Other joints move with
    their parents. The root's path is scaled by the leg lengths, and the floor is the 15th percentile
    over frames of the body's lowest vertex.

    fps: frames per second of the result. roles: joint of each role in the clip, by default as their names
    say.
    Returns Clip(skeleton=body.skeleton, rotations (T, J, 3, 3), translation (T, 3) m, fps).
    Raises InputError naming the clip and the joint if either skeleton lacks a joint that is needed, and for a
    frame rate as `resample` does.
    """
    source = required_roles(clip.skeleton, f"clip {clip.name}", roles)
    target = required_roles(body.skeleton, f"body {body.name}")
    clip = resample(in_body_axes(clip, source), fps)

    rotations, bones = _relative_to_t_pose(clip, source)
    rest_bones = bone_directions(body.skeleton.heads, target)
    align = {role: smallest_rotation(rest_bones[role], bones[role]) for role in rest_bones}

    role_of = {joint: role for role, joint in target.items() if role in source}
    turned: list[Tensor] = []
    for joint, parent in enumerate(body.skeleton.parents):
        role = role_of.get(joint)
        if role is None:
            turned.append(turned[parent] if parent >= 0 else rotations[:, source["hips"]])
        else:
            turn = rotations[:, source[role]]
            turned.append(turn @ align[role] if role in align else turn)
    result = Clip(
        name=clip.name,
        skeleton=body.skeleton,
        rotations=torch.stack(turned, dim=1),
        translation=_root_path(clip, source, body.skeleton, target, turned),
        fps=clip.fps,
    )
    return on_floor(result, body)


def resample(clip: Clip, fps: float) -> Clip:
    """Resample a clip to another frame rate: rotations by slerp, the root's path linearly.

    fps: frames per second. Raises InputError for a rate outside FPS_RANGE.
    """
    require_fps(fps)
    if fps == clip.fps:
        return clip
    steps = int((len(clip) - 1) * fps / clip.fps + 1e-6)
    times = torch.arange(steps + 1, dtype=torch.float64) * (clip.fps / fps)
    return replace(at_times(clip, times), fps=fps)


def at_times(clip: Clip, times: Tensor) -> Clip:
    """Sample a clip at times (T,) float64, in its frames, from 0 to its last; fps stays."""
    frames = times.long()
    if torch.equal(times, frames.double()):  # Nothing to interpolate: kornia takes 0.6 s to import.
        return replace(clip, rotations=clip.rotations[frames], translation=clip.translation[frames])
    last = len(clip) - 1
    before = times.floor().long().clamp(max=max(last - 1, 0))
    after = (before + 1).clamp(max=last)
    share = times - before
    start = clip.rotations[before].double()
    turn = to_axis_angles(start.mT @ clip.rotations[after].double())
    rotations = start @ from_axis_angles(share[:, None, None] * turn)
    translation = torch.lerp(
        clip.translation[before].double(), clip.translation[after].double(), share[:, None]
    )
    return replace(clip, rotations=rotations.to(clip.rotations), translation=translation.to(clip.translation))


def required_roles(
    skeleton: Skeleton, owner: str, roles: Mapping[str, int] | None = None
) -> Mapping[str, int]:
    """Joint of each role, by default as the names say. Raises InputError naming roles that are needed."""
    roles = skeleton.roles if roles is None else roles
    missing = [role for role in REQUIRED_ROLES if role not in roles]
    if missing:
        wanted = ", ".join(role.replace("_", " ") for role in missing)
        raise InputError(
            f"{owner}: unknown joint set ({', '.join(skeleton.names[:6])}, ...), no joint is the {wanted}; "
            "name them with --joints (`uvcloth motion FILE` shows which are known)"
        )
    return roles


def require_limbs(skeleton: Skeleton, roles: Mapping[str, int]) -> None:
    """Raise InputError naming an arm or a leg bone without length, whose direction is undefined."""
    for bone, tip in LIMB_BONES.items():
        if tip not in roles or bone.endswith("hand"):
            continue
        length = float((skeleton.heads[roles[tip]] - skeleton.heads[roles[bone]]).norm())
        if not 0.0 < length < math.inf:
            names = f"{skeleton.names[roles[bone]]} to {skeleton.names[roles[tip]]}"
            raise InputError(f"the {bone.replace('_', ' ')} ({names}) has no length")


def in_body_axes(clip: Clip, roles: Mapping[str, int]) -> Clip:
    """Clip with Z up and its rest pose facing -Y; units stay."""
    turned = body_axes(clip.skeleton.heads, roles).to(clip.rotations)
    return replace(
        clip,
        skeleton=replace(clip.skeleton, heads=clip.skeleton.heads @ turned.T),
        rotations=turned @ clip.rotations @ turned.T,
        translation=clip.translation @ turned.T.to(clip.translation),
    )


def body_axes(heads: Tensor, roles: Mapping[str, int]) -> Tensor:
    """Rotation (3, 3) by right angles that takes standing joints (J, 3) to Z up, facing -Y."""
    heads = heads.double()
    legs = heads[[roles["left_thigh"], roles["right_thigh"]]]
    arms = heads[[roles["left_upper_arm"], roles["right_upper_arm"]]]
    up = nearest_axis(arms.mean(0) - legs.mean(0))
    across = legs[0] - legs[1]
    left = nearest_axis(across - (across @ up) * up)
    return torch.stack([left, torch.linalg.cross(up, left), up])


def _relative_to_t_pose(clip: Clip, roles: Mapping[str, int]) -> tuple[Tensor, dict[str, Tensor]]:
    """Rotations (T, J, 3, 3) relative to the T-pose, and the T-pose directions of the limb bones.

    The all-zero pose of many capture skeletons splays the legs: the T-pose turns each thigh, and all below
    it, about the front axis until the shin points straight down.
    """
    heads = clip.skeleton.heads
    t_pose = torch.eye(3).to(heads).repeat(len(heads), 1, 1)
    for side in ("left", "right"):
        shin = heads[roles[f"{side}_foot"]] - heads[roles[f"{side}_shin"]]
        turn = from_euler("y", torch.atan2(shin[0], -shin[2])[None])
        leg = {roles[f"{side}_thigh"]}
        for joint, parent in enumerate(clip.skeleton.parents):
            if parent in leg:
                leg.add(joint)
        t_pose[list(leg)] = turn
    bones = {
        role: t_pose[roles[role]] @ direction for role, direction in bone_directions(heads, roles).items()
    }
    return clip.rotations @ t_pose.mT, bones


def bone_directions(heads: Tensor, roles: Mapping[str, int]) -> dict[str, Tensor]:
    """Unit rest directions of the limb bones; a hand without fingers continues its forearm."""
    directions: dict[str, Tensor] = {}
    for bone, tip in LIMB_BONES.items():
        if tip in roles:
            directions[bone] = torch.nn.functional.normalize(heads[roles[tip]] - heads[roles[bone]], dim=0)
        else:
            directions[bone] = directions[bone.replace("hand", "forearm")]
    return directions


def _root_path(
    clip: Clip, source: Mapping[str, int], skeleton: Skeleton, target: Mapping[str, int], turned: list[Tensor]
) -> Tensor:
    """World path of the body's root (T, 3) m: the middle of its hip joints follows the clip's, scaled."""
    heads = clip.skeleton.heads
    scale = leg_length(skeleton.heads, target) / leg_length(heads, source)
    posed = clip.positions()[:, [source["left_thigh"], source["right_thigh"]]]
    hips = target["hips"]
    middle = skeleton.heads[[target["left_thigh"], target["right_thigh"]]].mean(0) - skeleton.heads[hips]
    return scale * posed.mean(1) - turned[hips] @ middle


def leg_length(heads: Tensor, roles: Mapping[str, int]) -> Tensor:
    """Length of thigh plus shin, mean of both legs, in the unit of heads (J, 3)."""
    chain = [[roles[f"{side}_{bone}"] for side in ("left", "right")] for bone in ("thigh", "shin", "foot")]
    thigh, shin, foot = (heads[joints] for joints in chain)
    return ((shin - thigh).norm(dim=1) + (foot - shin).norm(dim=1)).mean()


def on_floor(clip: Clip, body: Body) -> Clip:
    """A clip on a body's skeleton, moved up or down so that its feet are on the floor z = 0."""
    floor = np.percentile(lowest_vertex(clip, body).numpy(), FLOOR_PERCENTILE)
    return replace(clip, translation=clip.translation - torch.tensor([0.0, 0.0, floor]).to(clip.translation))


def lowest_vertex(clip: Clip, body: Body) -> Tensor:
    """Height of the posed body's lowest vertex at every frame: (T,) metres."""
    points = torch.nn.functional.pad(body.mesh.vertices, (0, 1), value=1.0)
    influence = (body.weights[:, :, None] * points[:, None, :]).flatten(1)
    rows = clip.transforms()[:, :, 2].flatten(1)
    return torch.cat([(influence @ part.T).amin(0) for part in torch.split(rows, SKINNED_AT_ONCE)])
