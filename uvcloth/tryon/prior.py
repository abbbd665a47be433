"""Likelihood of poses: a normal distribution of the joints' rotations in the built-in clips."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.mirror import mirror_transforms
from uvcloth.geometry.once import once_per_record
from uvcloth.geometry.rotations import from_quaternions, heading, to_quaternions
from uvcloth.geometry.skeleton import local_rotations
from uvcloth.motion.library import builtin_clips, load_clip

EVERY = 4
"""One frame of this many is taken."""

FREEDOM = 0.2
"""Standard deviation, radians, that joints have in addition to that in the clips."""


@dataclass(frozen=True)
class PosePrior:
    """Normal distribution of poses, vectors of J joints with three numbers each.

    The numbers of a joint are twice its Rodrigues vector relative to its parent, near the axis times the
    angle; those of the root are relative to the heading. mean: (3 J,). spread: (3 J, 3 J), lower triangle,
    takes unit normal numbers to poses. poses: (M, 3 J), those of the clips, and mirrored.
    """

    mean: Tensor
    spread: Tensor
    poses: Tensor

    def whitened(self, poses: Tensor) -> Tensor:
        """Poses (B, 3 J) as numbers that are normally distributed, each with deviation one."""
        return torch.linalg.solve_triangular(self.spread, (poses - self.mean).mT, upper=False).mT

    def poses_of(self, whitened: Tensor) -> Tensor:
        """Poses of whitened numbers: (B, 3 J) -> (B, 3 J)."""
        return self.mean + whitened @ self.spread.mT


def rotations_of(poses: Tensor) -> Tensor:
    """Rotations (B, J, 3, 3) relative to the parent of poses (B, 3 J)."""
    halves = poses.unflatten(1, (-1, 3)) / 2
    return from_quaternions(torch.cat([halves, torch.ones_like(halves[..., :1])], dim=-1))


@once_per_record
def pose_prior(body: Body) -> PosePrior:
    """The distribution of poses of a body in the built-in clips."""
    motions = [load_clip(name, body).rotations[::EVERY] for name in builtin_clips()]
    rotations = torch.cat(
        [each for motion in motions for each in (motion, mirror_transforms(motion, body.skeleton))]
    )
    rotations = heading(rotations[:, 0]).mT[:, None] @ rotations
    quaternions = to_quaternions(local_rotations(body.skeleton.parents, rotations)).float()
    poses = (2 * quaternions[..., :3] / quaternions[..., 3:]).flatten(1)
    covariance = poses.T.cov() + FREEDOM**2 * torch.eye(poses.shape[1])
    return PosePrior(poses.mean(0), torch.linalg.cholesky(covariance), poses)
