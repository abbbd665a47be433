"""A method as a rig: blend weights, and blend shapes whose weights a perceptron gives from the pose."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.rotations import to_axis_angles
from uvcloth.geometry.skeleton import local_rotations


@dataclass(frozen=True)
class PoseRig:
    """Garments on one skeleton, posed by linear blend skinning of their rest shape plus K blend shapes.

    name: of the model. garments: names, the innermost first, and meshes at rest, N vertices in all. owner:
    (N,) int64, which of U points each vertex is. weights: (U, J). shapes: (K, U, 3) m at rest. layers: of the
    pose embedding, weights (out, in) and biases (out,), a ReLU after each; pose vector in, K weights out.
    parents: of the joints. poses: (M, 3 J) pose vectors that it was made for. sum_to_one: whether the weights
    are divided by their sum, as `shares` does.
    """

    name: str
    garments: tuple[tuple[str, Mesh], ...]
    owner: Tensor
    weights: Tensor
    shapes: Tensor
    layers: tuple[tuple[Tensor, Tensor], ...]
    parents: tuple[int, ...]
    poses: Tensor
    sum_to_one: bool = False

    @property
    def rest(self) -> Tensor:
        """All vertices at rest (N, 3), m."""
        return torch.cat([mesh.vertices for _, mesh in self.garments])

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
