"""Arms kept out of torso and legs: turned at the shoulder, smoothly in time.

The joint rotations of one person take hands into the torso or the thighs of a wider one, where no sleeve can
be right.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy import sparse
from scipy.sparse.linalg import spsolve
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.rotations import from_axis_angles, rotate, rotate_back, to_axis_angles
from uvcloth.motion.arms import (
    FRAMES_AT_ONCE,
    PosedTrunk,
    arm_joints,
    arm_places,
    missing_clearance,
    posed_trunk,
)
from uvcloth.motion.clip import Clip

TOLERANCE = 0.002
"""Metres of clearance that may be missing."""

ROUNDS = 40
"""Most rounds of turning."""

HALVINGS = 5
"""Halvings by which the least share of a turn is searched that keeps an arm clear."""

FADING = 0.13
"""Seconds before and after a frame over which the share of its turn fades."""

PASSES = 4
"""Most times that turns are found, each with the frames in which those before took an arm inside."""

STIFFNESS = 1.0
"""Weight of squared second differences of a turn at 30 fps, rad^2, beside squared depths, m^2."""

DAMPING = 0.002
"""Weight of squared turns, rad^2: with STIFFNESS, an arm is back on its path some five frames later."""

HELD_WEIGHT = 1e6
"""The same weight in frames in which arms stay as they are."""


@dataclass(frozen=True)
class _DeepFrames:
    """The F frames of a clip in which one of A arms misses its clearance, or would after turns in others.

    indices: (F,) in the clip. trunks: in these frames, in parts. places: (F, A, P, 3) m on the arms.
    """

    indices: Tensor
    trunks: Sequence[PosedTrunk]
    places: Tensor

    def missing(self, places: Tensor) -> tuple[Tensor, Tensor]:
        """Metres (F, P) of clearance that places (F, P, 3) miss, and directions (F, P, 3) outwards."""
        parts = places.split([len(trunk.parts[0].vertices) for trunk in self.trunks])
        missing, outwards = zip(
            *(trunk.missing(part) for trunk, part in zip(self.trunks, parts, strict=True)), strict=True
        )
        return torch.cat(missing).clamp(min=0.0), torch.cat(outwards)


@dataclass(frozen=True)
class _Arm:
    """One arm in the F deep frames of a clip, in the axes of the joint that carries its shoulder.

    shoulders: (F, 1, 3) m. carriers: (F, 1, 3, 3), the rotations of that joint. offsets: (F, P, 3) m, of
    places on the arm from the shoulder.
    """

    deep: _DeepFrames
    shoulders: Tensor
    carriers: Tensor
    offsets: Tensor

    def turned(self, turns: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The offsets turned by (F, 3, 3), metres (F, P) of clearance that they miss, and ways outwards."""
        turned = rotate(turns[:, None], self.offsets)
        missing, outwards = self.deep.missing(self.shoulders + rotate(self.carriers, turned))
        return turned, missing, rotate_back(self.carriers, outwards)


def clear_arms(clip: Clip, body: Body, held: int = 0) -> Clip:
    """Turn the upper arms of a clip on a body so that forearms and hands keep clear of torso and legs.

    held: number of frames at the end in which arms stay as they are.

    In each round, the turns w of a shoulder, in the axes of the joint that carries it, minimize the sum of
    (a w - b)^2 over all places r of the arm (from the shoulder) that miss their clearance by b, with
    a = r x n for the direction n outwards, plus the weighted squares of w and of its second differences in
    time. Rotations of other joints stay. Where that takes an arm inside in a frame in which it was outside,
    all is done again with this frame among the others. At the end the turns are as small as they may be.
    Returns the clip itself where no arm misses its clearance.
    """
    transforms = _around_start(clip)
    watched = _missing(body, transforms) > 0.0
    smoothness = _smoothness(len(clip), clip.fps, held)
    cleared, inside = clip, watched
    for _ in range(PASSES):
        if not inside.any():
            break
        watched = watched | inside
        cleared = _cleared(clip, body, _deep_frames(body, transforms, watched), transforms, smoothness)
        inside = (_missing(body, _around_start(cleared)) > 2.0 * TOLERANCE) & ~watched
    return cleared


def _cleared(
    clip: Clip, body: Body, deep: _DeepFrames, transforms: Tensor, smoothness: sparse.csr_array
) -> Clip:
    skeleton, rotations = clip.skeleton, clip.rotations.clone()
    for arm, (upper, *_) in enumerate(arm_joints(body)):
        at = transforms[deep.indices, upper]
        shoulders = (at[..., :3] @ skeleton.heads[upper] + at[..., 3])[:, None]
        carriers, branch = clip.rotations[:, skeleton.parents[upper]], skeleton.branch(upper)
        carrying = carriers[deep.indices][:, None]
        offsets = rotate_back(carrying, deep.places[:, arm] - shoulders)
        reached = _Arm(deep, shoulders, carrying, offsets)
        turns = _least_shares(reached, _turns(reached, smoothness), clip.fps)
        rotations[:, branch] = (carriers @ turns @ carriers.mT)[:, None] @ rotations[:, branch]
    return replace(clip, rotations=rotations)


def _around_start(clip: Clip) -> Tensor:
    """Transforms (T, J, 3, 4) of a clip relative to its first place."""
    return replace(clip, translation=clip.translation - clip.translation[:1]).transforms()


def _missing(body: Body, transforms: Tensor) -> Tensor:
    """Metres (T,) of clearance that an arm misses at the worst place, negative where all keep more."""
    missing = missing_clearance(body, transforms)
    return missing.amax(1) if missing.numel() else missing.new_full((len(missing),), -torch.inf)


def _deep_frames(body: Body, transforms: Tensor, deep: Tensor) -> _DeepFrames:
    """The frames of a mask (T,), given the transforms (T, J, 3, 4) of all."""
    indices = deep.nonzero()[:, 0]
    parts = transforms[indices].split(FRAMES_AT_ONCE)
    return _DeepFrames(
        indices, [posed_trunk(body, some) for some in parts], arm_places(body, transforms[indices])
    )


def _smoothness(count: int, fps: float, held: int) -> sparse.csr_array:
    """Matrix (T, T) of the weighted squares of `clear_arms` for the turns of T = `count` frames."""
    identity = sparse.eye_array(count, format="csr")
    first = identity[1:] - identity[:-1]
    second = first[1:] - first[:-1]
    weights = np.full(count, DAMPING)
    weights[count - held :] = HELD_WEIGHT
    return STIFFNESS * (fps / 30.0) ** 4 * (second.T @ second) + sparse.diags_array(weights)


def _turns(arm: _Arm, smoothness: sparse.csr_array) -> Tensor:
    """Turns (T, 3, 3) of an arm's shoulder in all frames of a clip."""
    turns, at = torch.eye(3).repeat(smoothness.shape[0], 1, 1), arm.deep.indices
    for _ in range(ROUNDS):
        turned, missing, outwards = arm.turned(turns[at])
        if float(missing.max()) <= TOLERANCE:
            break
        rows = torch.linalg.cross(turned, outwards)
        rows *= (missing > 0.0)[..., None]
        turns = from_axis_angles(_least_turns(rows, missing, at, smoothness)) @ turns
    return turns


def _least_shares(arm: _Arm, turns: Tensor, fps: float) -> Tensor:
    """Turns (T, 3, 3) of an arm's shoulder by the least share of some in each frame that keeps it as clear.

    Smooth turns that take a hand around a knee take it far from it in the frames beside. Shares fade slowly.
    """
    angles, at = to_axis_angles(turns), arm.deep.indices

    def missing(shares: Tensor) -> Tensor:
        """Metres (F,) of clearance that the arm misses at the worst place, turned by shares (F,)."""
        return arm.turned(from_axis_angles(shares[:, None] * angles[at]))[1].amax(1)

    low, high = torch.zeros(len(at)), torch.ones(len(at))
    allowed = missing(high).clamp(min=TOLERANCE)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        is_clear = missing(middle) <= allowed
        low, high = torch.where(is_clear, low, middle), torch.where(is_clear, middle, high)
    radius = max(1, round(FADING * fps))
    shares = torch.zeros(len(turns)).index_put((at,), high)[None, None]
    highest = torch.nn.functional.max_pool1d(shares, 2 * radius + 1, stride=1, padding=radius)
    padded = torch.nn.functional.pad(highest, (radius, radius), mode="replicate")
    faded = torch.nn.functional.avg_pool1d(padded, 2 * radius + 1, stride=1)[0, 0]
    return from_axis_angles(faded[:, None] * angles)


def _least_turns(rows: Tensor, distances: Tensor, indices: Tensor, smoothness: sparse.csr_array) -> Tensor:
    """Turns w (T, 3) that minimize the sum of `clear_arms`, of rows a (F, P, 3) and distances b (F, P)."""
    count = smoothness.shape[0]
    blocks, right = torch.zeros(count, 3, 3, dtype=torch.float64), torch.zeros(count, 3, dtype=torch.float64)
    rows, distances = rows.double(), distances.double()
    blocks[indices] = rows.mT @ rows
    right[indices] = (rows * distances[..., None]).sum(1)
    matrix = sparse.kron(smoothness, sparse.eye_array(3)) + sparse.bsr_array(
        (blocks.numpy(), range(count), range(count + 1)), shape=(3 * count, 3 * count)
    )
    return torch.from_numpy(spsolve(matrix.tocsc(), right.flatten().numpy())).view(count, 3).float()
