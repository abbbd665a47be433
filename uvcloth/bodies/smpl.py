"""Bodies of SMPL, SMPL-H and SMPL-X, from the model files as their owners distribute them.

SMPL: Loper et al., "SMPL: A Skinned Multi-Person Linear Model", 2015. A body is T + B_S(beta) + B_P(theta),
skinned: a template, shapes of a person, and shapes that correct the skin for the pose.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rasterize.charts import largest_piece
from rasterize.layout import unwrap
from uvcloth.bodies.body import Body
from uvcloth.bodies.regions import face_regions
from uvcloth.bodies.smpl_joints import SMPL_JOINTS, STANDING
from uvcloth.errors import InputError
from uvcloth.files.archive import read_arrays
from uvcloth.files.fields import Field, check_fields, numbers
from uvcloth.formats.smpl_pickle import plain, read_smpl_pickle
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.rotations import from_axis_angles
from uvcloth.geometry.skeleton import Skeleton, joint_transforms, world_rotations
from uvcloth.geometry.skinning import apply_transforms, skin

FIELDS = {
    "weights": numbers("V", "J", least=-1.0, most=2.0, dtype=np.float64),
    "v_template": numbers("V", 3),
    "shapedirs": numbers("V", 3, "S"),
    "J_regressor": numbers("J", "V"),
    "kintree_table": Field((2, "J"), "numbers", np.int64, -1, 2**32),
    "f": Field(("F", 3), "numbers", np.int64, 0, "V"),
}
"""Arrays of a model file besides posedirs: V vertices, J joints, S shapes."""

ARRAYS = ("v_template", "shapedirs", "posedirs", "weights", "J_regressor", "kintree_table", "f")
"""Arrays of a model file that make a body."""

EXPECTED = "a model file of SMPL, SMPL-H or SMPL-X"

FACE_SHAPES = {400: 300}
"""Number of shapes of the person, before those of expressions, by the total of an SMPL-X file; else 10."""


@dataclass(frozen=True)
class SmplModel:
    """A model file: SMPL, SMPL-H or SMPL-X, of one gender.

    kind: key of SMPL_JOINTS. template: (V, 3) m, Y up. shapes: (S, V, 3) m of a unit of each shape parameter.
    pose_shapes: (9 (J-1), V, 3) m. weights: (V, J). regressor: (J, V), joints from vertices. parents: (J,).
    """

    name: str
    kind: str
    template: Tensor
    faces: Tensor
    shapes: Tensor
    pose_shapes: Tensor
    weights: Tensor
    regressor: Tensor
    parents: tuple[int, ...]

    def resting(self, pose: Tensor | None = None) -> "RestingModel":
        """The model with a rest pose, by default its zero pose, the T.

        pose: (J, 3) axis-angles, radians, relative to the parents, besides the turn to our axes.
        """
        turns = torch.zeros(len(self.parents), 3) if pose is None else pose.float()
        return _resting(self, from_axis_angles(turns))


@dataclass(frozen=True)
class RestingModel:
    """A model whose bodies all have one rest pose, and share its pose correction and pose shapes.

    used: (V,) int64, vertices of the model in the largest piece of its surface. faces: (F, 3) into these.
    rotations: (J, 3, 3) of the rest pose, world. correction: (V, 3) m, pose correction of the rest pose, in
    the zero pose's axes. pose_shapes: as of Body, from the rest pose. regions, sides: (F,) as of Body.
    """

    model: SmplModel
    used: Tensor
    faces: Tensor
    rotations: Tensor
    correction: Tensor
    pose_shapes: Tensor
    regions: Tensor
    sides: Tensor

    def body(self, betas: Tensor, unwrapped: bool = True) -> Body:
        """The body of a person: Z up, facing -Y, the pelvis where the model has it.

        betas: (B,) shape parameters, B at most S. unwrapped: False for a mesh without texture coordinates,
        which take seconds. With another rest pose than the zero pose, skin between two joints that it turns
        differs from SMPL's by millimetres, in wide poses.
        Raises InputError for more shape parameters than there are, and for one that is not finite.
        """
        model = self.model
        if len(betas) > len(model.shapes):
            raise InputError(
                f"{model.name}: has {len(model.shapes)} shape parameters, {len(betas)} were given"
            )
        if not torch.isfinite(betas).all():
            raise InputError(f"{model.name}: a shape parameter is not a finite number")
        vertices = model.template + torch.tensordot(betas.float(), model.shapes[: len(betas)], 1)
        heads = model.regressor @ vertices
        transforms = _transforms(model, heads, self.rotations)
        rest = skin(vertices[self.used] + self.correction, model.weights[self.used], transforms)[0]
        uvs, face_uvs = torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64)
        if unwrapped:
            uvs, face_uvs = unwrap(rest, self.faces, model.name)
        return Body(
            name=model.name,
            mesh=Mesh(rest, self.faces, uvs, face_uvs),
            skeleton=Skeleton(SMPL_JOINTS[model.kind], model.parents, apply_transforms(transforms, heads)[0]),
            weights=model.weights[self.used],
            regions=self.regions,
            sides=self.sides,
            proxies={},
            pose_shapes=self.pose_shapes,
        )


def read_smpl(path: Path) -> SmplModel:
    """Read a model file: an .npz, or a .pkl of the pickled kind, of which nothing is executed.

    Raises InputError naming the file if it is missing, damaged, asks for code, lacks an array, or holds
    arrays that do not fit together or are not finite.
    """
    path = Path(path)
    # Other arrays of an npz may be pickled: they are not read.
    arrays = read_arrays(path, EXPECTED, ARRAYS) if path.suffix.lower() == ".npz" else read_smpl_pickle(path)
    missing = [name for name in ARRAYS if name not in arrays]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}, expected {EXPECTED}")
    return _model(path, {name: _numbers(path, name, arrays[name]) for name in ARRAYS})


def _numbers(path: Path, name: str, value: Any) -> np.ndarray:
    try:
        array = np.asarray(plain(value))
    except InputError as error:
        raise InputError(f"{path}: {name} {error}") from error
    if array.dtype.kind not in "fiu":
        raise InputError(f"{path}: {name} holds no numbers")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise InputError(f"{path}: {name} holds a value that is not a finite number")
    return array


def _model(path: Path, arrays: dict[str, np.ndarray]) -> SmplModel:
    weights = arrays["weights"]
    joints = weights.shape[1] if weights.ndim == 2 else 0
    kind = next((kind for kind, names in SMPL_JOINTS.items() if len(names) == joints), None)
    if kind is None:
        counts = ", ".join(f"{len(names)} ({kind})" for kind, names in SMPL_JOINTS.items())
        raise InputError(
            f"{path}: weights has the shape {weights.shape}, expected a column for each of {counts} joints"
        )
    arrays = check_fields(path, arrays, FIELDS | {"posedirs": numbers("V", 3, 9 * (joints - 1))}, J=joints)
    weights, faces = arrays["weights"], arrays["f"]
    if not len(faces):
        raise InputError(f"{path}: f has no faces")
    parents = (-1, *arrays["kintree_table"][0, 1:].tolist())
    if not all(0 <= parent < joint for joint, parent in enumerate(parents) if joint):
        raise InputError(f"{path}: kintree_table has a joint before its parent")
    shapes = arrays["shapedirs"]
    if kind == "SMPL-X":
        shapes = shapes[..., : FACE_SHAPES.get(shapes.shape[-1], 10)]
    if (weights < 0).any() or not np.allclose(weights.sum(1), 1.0, atol=1e-3):
        raise InputError(f"{path}: weights of a vertex are negative or do not sum to one")
    return SmplModel(
        name=path.stem,
        kind=kind,
        template=_tensor(arrays["v_template"]),
        faces=torch.from_numpy(faces),
        shapes=_tensor(np.moveaxis(shapes, -1, 0)),
        pose_shapes=_tensor(np.moveaxis(arrays["posedirs"], -1, 0)),
        weights=_tensor(weights / weights.sum(1, keepdims=True)),
        regressor=_tensor(arrays["J_regressor"]),
        parents=parents,
    )


def _tensor(array: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))


def _resting(model: SmplModel, local: Tensor) -> RestingModel:
    """The model with the rest pose of rotations (J, 3, 3) relative to the parents.

    With G_j the world rotations of that pose, R_j - R0_j = G_p^T (L_j - 1) G_j: R_j is a local rotation from
    the zero pose, R0_j that of the rest pose, L_j the same from the rest pose, p the parent of j. Corrections
    are linear in R_j - 1, so also in L_j - 1; their value at rest is part of the rest mesh.
    """
    kept = torch.from_numpy(largest_piece(model.faces.numpy()))
    used, faces = model.faces[kept].unique(return_inverse=True)
    weights, template = model.weights[used], model.template[used]
    standing = from_axis_angles(torch.tensor(STANDING))
    world = world_rotations(model.parents, torch.cat([standing @ local[:1], local[1:]])[None])[0]
    shapes = model.pose_shapes[:, used].unflatten(0, (-1, 3, 3))
    correction = torch.tensordot(local[1:] - torch.eye(3), shapes, 3)

    shapes = torch.einsum("jab,jbcvx->jacvx", world[list(model.parents[1:])], shapes)
    shapes = torch.einsum("jdc,jacvx->jadvx", world[1:], shapes)
    shapes = torch.einsum("vxy,jadvy->jadvx", torch.einsum("vj,jxy->vxy", weights, world), shapes)
    transforms = _transforms(model, model.regressor @ model.template, world)
    shapes += _twice_skinned(template + correction, weights, transforms[0], model.parents)
    skeleton = Skeleton(SMPL_JOINTS[model.kind], model.parents, model.regressor @ model.template)
    regions, sides = face_regions(skeleton, weights, faces)
    return RestingModel(
        model, used, faces, world, correction, shapes.flatten(0, 2).contiguous(), regions, sides
    )


def _transforms(model: SmplModel, heads: Tensor, rotations: Tensor) -> Tensor:
    """Transforms (1, J, 3, 4) from the zero pose to world rotations (J, 3, 3), about the model's origin."""
    skeleton = Skeleton(SMPL_JOINTS[model.kind], model.parents, heads)
    pelvis = from_axis_angles(torch.tensor(STANDING)) @ heads[0]
    return joint_transforms(skeleton, rotations[None], pelvis[None])


def _twice_skinned(vertices: Tensor, weights: Tensor, transforms: Tensor, parents: tuple[int, ...]) -> Tensor:
    """Corrections for skinning to a rest pose and on from there: (J-1, 3, 3, V, 3) m, to first order.

    vertices: (V, 3) m in the zero pose, which transforms (J, 3, 4) skin to the rest pose; shapes of a person
    hardly matter. With d_j the offset from a rest vertex to its place by joint j alone, sum w_j R_j d_j
    is missing, R_j being world rotations from the rest pose: a local rotation L_k adds (L_k - 1) w_j d_j for
    all joints j from k down.
    """
    alone = torch.einsum("jab,vb->jva", transforms[..., :3], vertices) + transforms[:, None, :, 3]
    lost = weights.T[..., None] * (alone - torch.einsum("vj,jva->va", weights, alone))
    for joint in range(len(parents) - 1, 0, -1):
        lost[parents[joint]] += lost[joint]
    return torch.einsum("ax,jvd->jadvx", torch.eye(3), lost[1:])
