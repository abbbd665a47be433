"""Recombination of poses: the legs of one, the trunk of another, the arms of two more; and of clips.

A few clips hold each arm and each leg in many positions, but only in few combinations. Training can use other
combinations too: it needs only poses that the body can take.
"""

from collections.abc import Callable
from dataclasses import replace

import torch
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.errors import InputError
from uvcloth.geometry.skeleton import Skeleton, local_rotations, world_rotations
from uvcloth.motion.clip import Clip
from uvcloth.motion.poses import SPLITS, PoseDatabase

DONOR_PARTS: tuple[tuple[str, ...], ...] = (
    (),
    ("lower_spine", "middle_spine", "upper_spine"),
    ("left_clavicle", "left_upper_arm"),
    ("right_clavicle", "right_upper_arm"),
)
"""Top joints of each part, the first that a skeleton has: legs (all the rest), trunk, left and right arm."""

RECOMBINED = 2000
"""Default number of poses to make."""

CANDIDATES_PER_POSE = 20
"""Most candidates per pose."""


def recombine(
    poses: PoseDatabase, body: Body, valid: Callable[[Tensor], bool], count: int, seed: int = 0
) -> PoseDatabase:
    """Add `count` training poses to a database, each made of the parts of training poses.

    Each arm is that of the trunk's pose with probability 1/2. valid: test of the posed body (V, 3) m. Raises
    InputError if too few of the combinations are valid.
    """
    generator = torch.Generator().manual_seed(seed)
    rows = torch.nonzero(poses.splits == SPLITS.index("train")).squeeze(1)
    part = joint_parts(body.skeleton)
    local = local_rotations(body.skeleton.parents, poses.rotations)
    kept: list[Tensor] = []
    with Progress(TextColumn("recombining"), BarColumn(), MofNCompleteColumn()) as progress:
        bar = progress.add_task("", total=count)
        for _ in range(CANDIDATES_PER_POSE * count):
            if len(kept) == count:
                break
            donors = rows[torch.randint(len(rows), (len(DONOR_PARTS),), generator=generator)]
            same = torch.rand(2, generator=generator) < 0.5
            donors[2:] = torch.where(same, donors[1], donors[2:])
            made = _made_of(poses, local, donors[None], part, body.skeleton)
            if valid(posed_skin(body, made.transforms(body.skeleton))[0]):
                kept.append(donors)
                progress.advance(bar)
    if len(kept) < count:
        raise InputError(f"--recombine {count}: only {len(kept)} combinations are valid on body {body.name}")
    if not kept:
        return poses
    made = _made_of(poses, local, torch.stack(kept), part, body.skeleton)
    return poses.followed_by(made)


def legs_and_trunk(legs: Clip, trunk: Clip) -> Clip:
    """A clip that goes as one does, with the trunk, the head and the arms of another on its hips.

    It is as long as the shorter one. Both are of one skeleton and frame rate.
    """
    frames, parents = min(len(legs), len(trunk)), legs.skeleton.parents
    below, above = (local_rotations(parents, each.rotations[:frames]) for each in (legs, trunk))
    is_above = (joint_parts(legs.skeleton) > 0)[:, None, None]
    rotations = world_rotations(parents, torch.where(is_above, above, below))
    return replace(legs.window(0, frames), rotations=rotations)


def joint_parts(skeleton: Skeleton) -> Tensor:
    """Index into DONOR_PARTS of each joint: (J,) int64."""
    roles = skeleton.roles
    tops = {
        next((roles[role] for role in part if role in roles), None): index
        for index, part in enumerate(DONOR_PARTS)
    }
    parts: list[int] = []
    for joint, parent in enumerate(skeleton.parents):
        parts.append(tops.get(joint, parts[parent] if parent >= 0 else 0))
    return torch.tensor(parts)


def _made_of(
    poses: PoseDatabase, local: Tensor, donors: Tensor, part: Tensor, skeleton: Skeleton
) -> PoseDatabase:
    """Poses whose rotations relative to parents, local (M, J, 3, 3), are those of donors (K, parts)."""
    picked = local[donors[:, part], torch.arange(len(part))]
    legs = poses.select(donors[:, 0])
    return replace(legs, rotations=world_rotations(skeleton.parents, picked), donors=donors)
