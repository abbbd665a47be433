"""A rig as engines play it: a skeleton, skinned garments with blend shapes, and their motion."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import Mesh, face_normals, vertex_normals
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.geometry.skinning import skin, strongest
from uvcloth.methods.rig import BlendRig
from uvcloth.motion.clip import Clip
from uvcloth.writers.gltf_scene import GLTF_INFLUENCES
from uvcloth.writers.shapes import (
    POSES_AT_ONCE,
    Cost,
    ShapeCode,
    cost,
    own_shapes,
    principal_shapes,
    shape_cost,
)

REGULARIZATION = 1e-3
"""Ridge term, in squared weights, for `one` where the training poses do not determine it."""


@dataclass(frozen=True)
class RiggedGarment:
    """Garment of N vertices with blend weights and K blend shapes.

    mesh: at rest with all weights zero. joints, weights: (N, GLTF_INFLUENCES). shapes: (K, N, 3) m, at rest.
    usual: (K,) mean weights of the training poses. one: (K,), weights @ one is nearly 1 in all of them.
    """

    name: str
    mesh: Mesh
    joints: np.ndarray
    weights: np.ndarray
    shapes: Tensor
    usual: Tensor
    one: Tensor

    def normal_shapes(self) -> Tensor:
        """Change of the mesh's unit normals by each shape: (K, N, 3).

        The rest normals plus the weighted changes, normalized, are exact at the usual weights, and nearly so
        to first order around them. A tangent at zero weights would be inaccurate: no pose is near them.
        """
        rest, faces = self.mesh.vertices, self.mesh.faces
        usual = rest + torch.tensordot(self.usual, self.shapes, 1)
        # A face's normal is quadratic in its corners: this difference is its exact derivative.
        slope = 0.5 * (face_normals(usual + self.shapes, faces) - face_normals(usual - self.shapes, faces))
        total, change = torch.zeros_like(usual), torch.zeros_like(self.shapes)
        for corner in range(3):
            total = total.index_add(0, faces[:, corner], face_normals(usual, faces))
            change = change.index_add(1, faces[:, corner], slope)
        normals = torch.nn.functional.normalize(total, dim=-1)
        change = change / total.norm(dim=1, keepdim=True).clamp(min=1e-12)
        change = change - (change * normals).sum(-1, keepdim=True) * normals
        start = vertex_normals(rest, faces) + torch.tensordot(self.usual, change, 1)
        return change + self.one[:, None, None] * (normals - start)


@dataclass(frozen=True)
class Rig:
    """Garments, the innermost first, on one skeleton; all of them share the weights of K blend shapes.

    body: None leaves it out. resting: (K,) weights of the rest pose. transforms: (F, J, 3, 4) rest to posed,
    and weights: (F, K) in [0, 1]: the motion, F = 0 without one. fps: frames per second.
    """

    garments: tuple[RiggedGarment, ...]
    skeleton: Skeleton
    body: Body | None
    resting: np.ndarray
    transforms: np.ndarray
    weights: np.ndarray
    fps: float

    @property
    def shape_names(self) -> list[str]:
        """Names of the K blend shapes, the same in every garment."""
        return [f"shape_{index:03d}" for index in range(len(self.resting))]


@dataclass(frozen=True)
class Rigged:
    """A rig, the code from pose embeddings to its weights, and the costs of its simplifications.

    pruning: of joint influences. fewer: of blend shapes. Empty where nothing is lost. measured: whether poses
    are known to measure them in.
    """

    rig: Rig
    code: ShapeCode
    pruning: tuple[Cost, ...]
    fewer: tuple[Cost, ...]
    measured: bool


@torch.no_grad()
def rig_of(
    model: BlendRig, body: Body, clip: Clip | None = None, shapes: int | None = None, with_body: bool = True
) -> Rigged:
    """Make a rig of a model on its body, with the motion of a clip on that body or without.

    shapes: how many blend shapes, as principal components; None keeps the model's own. Weights cover the
    rest pose, the training poses and the clip. Raises InputError for a clip on another skeleton, a number of
    shapes out of range, and a model whose poses use none of its blend shapes.
    """
    if clip and clip.skeleton.names != body.skeleton.names:
        raise InputError(f"clip {clip.name}: its skeleton is not that of body {body.name!r}")
    if shapes is not None and not 1 <= shapes <= len(model.shapes):
        most = len(model.shapes)
        raise InputError(f"--shapes {shapes}: has to be from 1 to {most}, as many as the model has")
    transforms = clip.transforms() if clip else torch.zeros(0, len(body.skeleton.names), 3, 4)
    rest = torch.eye(3, 4).expand(1, len(body.skeleton.names), 3, 4)
    fps = clip.fps if clip else 30.0
    training, resting, moving = model.known(), model.play(rest, fps), model.play(transforms, fps)
    known = torch.cat([training, resting, moving])
    offsets = model.shapes
    code = (
        own_shapes(offsets, known) if shapes is None else principal_shapes(offsets, training, known, shapes)
    )
    if len(offsets) and not len(code):
        raise InputError(f"model {model.name}: none of its training poses moves any of its blend shapes")
    rig = Rig(
        garments=_garments(model, code, code.weights(training)),
        skeleton=body.skeleton,
        body=body if with_body else None,
        resting=code.weights(resting)[0].numpy(),
        transforms=transforms.numpy(),
        weights=code.weights(moving).numpy(),
        fps=fps,
    )
    variants: dict[str, tuple[Tensor, Tensor]] = {}
    if len(poses := model.known_transforms(body.skeleton)):
        variants[f"{len(poses)} training poses"] = (training, poses)
    if clip:
        variants[clip.name] = (moving, transforms)
    return Rigged(
        rig,
        code,
        pruning=_pruning(model, {over: posed for over, (_, posed) in variants.items()}),
        fewer=tuple(
            shape_cost(code, offsets, embeddings, over)
            for over, (embeddings, _) in variants.items()
            if shapes is not None
        ),
        measured=bool(variants),
    )


def _garments(model: BlendRig, code: ShapeCode, trained: Tensor) -> tuple[RiggedGarment, ...]:
    """Garments of the rig; trained: (M, K) weights of the training poses."""
    usual = trained.mean(0) if len(trained) else trained.new_zeros(trained.shape[1])
    gram = trained.T @ trained / max(len(trained), 1)
    one = torch.linalg.solve(gram + REGULARIZATION * torch.eye(len(usual)), usual)
    shapes = model.shapes[:, model.owner]
    base = model.rest + torch.tensordot(code.constant, shapes, 1)
    mixed = torch.tensordot(code.mix, shapes, 1)
    joints, weights = strongest(model.weights[model.owner], GLTF_INFLUENCES)
    sizes = [len(mesh.vertices) for _, mesh in model.garments]
    ends = np.cumsum(sizes)
    return tuple(
        RiggedGarment(
            name,
            replace(mesh, vertices=base[end - size : end]),
            joints[end - size : end],
            weights[end - size : end],
            mixed[:, end - size : end],
            usual,
            one / (one @ usual) if len(usual) else one,
        )
        for (name, mesh), size, end in zip(model.garments, sizes, ends, strict=True)
    )


def _pruning(model: BlendRig, poses: dict[str, Tensor]) -> tuple[Cost, ...]:
    """Costs of keeping only the strongest joints of each vertex, for the skinned rest shape."""
    weights = model.weights[model.owner]
    if int((weights > 0).sum(1).max()) <= GLTF_INFLUENCES:
        return ()
    joints, kept = (torch.from_numpy(values) for values in strongest(weights, GLTF_INFLUENCES))
    lost = weights.scatter_add(1, joints, -kept)
    return tuple(
        cost((skin(model.rest, lost, some).norm(dim=-1) for some in transforms.split(POSES_AT_ONCE)), over)
        for over, transforms in poses.items()
    )
