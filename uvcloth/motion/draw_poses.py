"""Drawing of distinct, valid poses from motion capture (PBNS section 4.3)."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.errors import InputError
from uvcloth.geometry.mirror import mirror_transforms
from uvcloth.geometry.rotations import to_axis_angles
from uvcloth.geometry.skeleton import Skeleton, local_rotations
from uvcloth.motion.clip_splits import SplitClip
from uvcloth.motion.library import load_clip
from uvcloth.motion.poses import DONORS, SPLITS, PoseDatabase

CANDIDATES_AT_ONCE = 256
"""Candidates that are compared at once with the poses drawn before, and with one another."""


def draw_poses(
    sources: Sequence[SplitClip],
    body: Body,
    valid: Callable[[Tensor], bool],
    apart: float = 0.5,
    mirror: bool = True,
    seed: int = 0,
    every: int = 1,
) -> PoseDatabase:
    """Draw poses of the sources in random order, training first, then validation, then test.

    A pose is kept if its `local_angles` differ by at least `apart` radians (largest difference) from those of
    every pose kept before, of all splits, and if `valid` accepts the posed body (V, 3) m, tested last.
    mirror: training poses are also drawn left-right mirrored. every: one of this many frames is used.

    Raises InputError for unreadable clips, for `apart` not above zero, `every` below one, for mirroring where
    a joint lacks its counterpart, and if no pose is valid.
    """
    if not 0.0 < apart < float("inf"):
        raise InputError(f"--apart {apart}: expected an angle above 0 radians")
    if every < 1:
        raise InputError(f"--every {every}: expected a number of frames, 1 or more")
    generator = torch.Generator().manual_seed(seed)
    with _progress() as progress:
        candidates = _candidates(sources, body, mirror, every, progress)
        candidates = replace(candidates, apart=apart)
        skeleton = body.skeleton
        near = torch.empty(0, 3 * (len(skeleton.names) - 1))
        drawn: list[Tensor] = []
        for split, name in enumerate(SPLITS):
            rows = torch.nonzero(candidates.splits == split).squeeze(1)
            if not len(rows):
                continue
            rows = rows[torch.randperm(len(rows), generator=generator)]
            bar = progress.add_task(f"drawing for {name}", total=len(rows))
            for chunk in rows.split(CANDIDATES_AT_ONCE):
                angles = local_angles(candidates.rotations[chunk], skeleton)
                far = (torch.cdist(angles, near, p=torch.inf) >= apart).all(1)
                transforms = candidates.select(chunk[far]).transforms(skeleton)
                kept = _distinct(angles[far], apart, transforms, body, valid)
                near = torch.cat([near, angles[far][kept]])
                drawn.append(chunk[far][kept])
                progress.advance(bar, len(chunk))
    if not len(near):
        raise InputError(f"{sources[0].file}: no pose of the clips is valid on the body {body.name}")
    return candidates.select(torch.cat(drawn))


def local_angles(rotations: Tensor, skeleton: Skeleton) -> Tensor:
    """Axis-angles of all joints but the root relative to their parents: (B, J, 3, 3) -> (B, 3 (J - 1))."""
    return to_axis_angles(local_rotations(skeleton.parents, rotations)[:, 1:]).flatten(1)


def _candidates(
    sources: Sequence[SplitClip], body: Body, mirror: bool, every: int, progress: Progress
) -> PoseDatabase:
    """Each `every`-th frame of all sources, and with `mirror` those for training once more, mirrored."""
    rotations: list[Tensor] = []
    labels: list[Tensor] = []
    bar = progress.add_task("reading clips", total=len(sources))
    for index, source in enumerate(sources):
        split = SPLITS.index(source.split)
        motion = load_clip(source.file, body).rotations[::every]
        frames = every * torch.arange(len(motion))
        for mirrored in (False, True) if mirror and source.split == "train" else (False,):
            rotations.append(mirror_transforms(motion, body.skeleton) if mirrored else motion)
            same = torch.tensor([index, mirrored, split]).expand(len(motion), 3)
            labels.append(torch.cat([frames[:, None], same], dim=1))
        progress.advance(bar)
    frame, clip, mirrored_, split_ = torch.cat(labels).unbind(1)
    return PoseDatabase(
        joints=body.skeleton.names,
        rotations=torch.cat(rotations),
        clip_names=tuple(source.name for source in sources),
        subjects=tuple(source.subject for source in sources),
        clips=clip,
        frames=frame,
        mirrored=mirrored_.bool(),
        splits=split_,
        donors=torch.full((len(split_), DONORS), -1),
        apart=0.0,
        body_name=body.name,
        body_hash=body.identity.shape,
    )


def _distinct(
    angles: Tensor, apart: float, transforms: Tensor, body: Body, valid: Callable[[Tensor], bool]
) -> Tensor:
    """Indices (K,) of the poses, angles (B, A), that are valid and `apart` from those kept before."""
    close = torch.cdist(angles, angles, p=torch.inf) < apart
    free = torch.ones(len(angles), dtype=torch.bool)
    kept: list[int] = []
    for row in range(len(angles)):
        if free[row] and valid(posed_skin(body, transforms[row : row + 1])[0]):
            kept.append(row)
            free &= ~close[row]
    return torch.tensor(kept, dtype=torch.int64)


def _progress() -> Progress:
    return Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
