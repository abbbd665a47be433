"""A method as a rig: blend weights, and blend shapes whose weights a network gives from the body's motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.rotations import from_axis_angles, to_axis_angles
from uvcloth.geometry.skeleton import Skeleton, joint_transforms, local_rotations, world_rotations


@dataclass(frozen=True)
class BlendRig:
    """Garments on one skeleton, posed by linear blend skinning of their rest shape plus K blend shapes.

    name: of the model. garments: names, the innermost first, and meshes at rest, N vertices in all. owner:
    (N,) int64, which of U points each vertex is. weights: (U, J). shapes: (K, U, 3) m at rest.
    """

    name: str
    garments: tuple[tuple[str, Mesh], ...]
    owner: Tensor
    weights: Tensor
    shapes: Tensor

    @property
    def rest(self) -> Tensor:
        """All vertices at rest (N, 3), m."""
        return torch.cat([mesh.vertices for _, mesh in self.garments])

    def known(self) -> Tensor:
        """Weights of the blend shapes (M, K) in what it was made for."""
        raise NotImplementedError

    def known_transforms(self, skeleton: Skeleton) -> Tensor:
        """Joint transforms (M, J, 3, 4) of what it was made for; none where only the weights are kept."""
        return torch.zeros(0, len(skeleton.names), 3, 4)

    def play(self, transforms: Tensor, fps: float) -> Tensor:
        """Weights of the blend shapes (F, K) over a motion (F, J, 3, 4)."""
        raise NotImplementedError


@dataclass(frozen=True)
class PoseRig(BlendRig):
    """A rig whose blend shapes follow the pose alone.

    layers: of the pose embedding, weights (out, in) and biases (out,), a ReLU after each; pose vector in, K
    weights out. parents: of the joints. poses: (M, 3 J) pose vectors that it was made for. sum_to_one:
    whether the weights are divided by their sum, as `shares` does.
    """

    layers: tuple[tuple[Tensor, Tensor], ...]
    parents: tuple[int, ...]
    poses: Tensor
    sum_to_one: bool = False

    def known(self) -> Tensor:
        """Weights of the blend shapes (M, K) in the training poses."""
        return self.embed(self.poses)

    def known_transforms(self, skeleton: Skeleton) -> Tensor:
        """Joint transforms (M, J, 3, 4) of the training poses, the root turned as at rest."""
        local = from_axis_angles(self.poses.unflatten(1, (-1, 3)))
        root = torch.tensor(skeleton.parents)[:, None, None] < 0
        turns = world_rotations(skeleton.parents, torch.where(root, torch.eye(3), local))
        return joint_transforms(skeleton, turns, skeleton.heads[:1].expand(len(self.poses), 3))

    def play(self, transforms: Tensor, fps: float) -> Tensor:
        """Weights of the blend shapes (F, K) in the poses of a motion."""
        return self.embed(pose_vectors(self.parents, transforms))

    def embed(self, poses: Tensor) -> Tensor:
        """Weights of the blend shapes (B, K) of pose vectors (B, 3 J); with layers none is negative."""
        if not len(self.shapes):
            return poses.new_zeros(len(poses), 0)
        for weight, bias in self.layers:
            poses = torch.relu(torch.nn.functional.linear(poses, weight, bias))
        return shares(poses) if self.sum_to_one else poses


def shares(keys: Tensor) -> Tensor:
    """Keys (..., K) divided by their sum; all zero where they are all zero."""
    total = keys.sum(-1, keepdim=True)
    return keys / torch.where(total > 0, total, 1.0)


def pose_vectors(parents: Sequence[int], transforms: Tensor) -> Tensor:
    """The pose theta as a rig sees it: joint transforms (B, J, 3, 4) -> (B, 3 J).

    Three numbers per joint: the axis-angle of its rotation relative to its parent, radians, and in place of
    the root's, which would tell north from south, the direction of gravity in the root's axes.
    """
    turns = transforms[..., :3]
    vectors = to_axis_angles(local_rotations(parents, turns))
    down = turns.new_tensor([0.0, 0.0, -1.0])
    root = torch.tensor([parent < 0 for parent in parents], device=turns.device)
    return torch.where(root[:, None], turns.mT @ down, vectors).flatten(1)
