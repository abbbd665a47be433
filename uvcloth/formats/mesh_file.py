"""Mesh files of users, read with their own vertex order and texture coordinates."""

from io import BytesIO
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from uvcloth.errors import InputError, cause
from uvcloth.files.reading import read_content
from uvcloth.formats.gltf import SCENES
from uvcloth.formats.gltf_mesh import read_gltf_mesh
from uvcloth.formats.obj import read_obj
from uvcloth.formats.size import refuse_large_file, refuse_too_many
from uvcloth.geometry.mesh import Mesh
from uvcloth.player.gltf_document import LARGEST

EXTENSIONS = (".obj", ".ply", ".glb", ".gltf", ".fbx", ".stl", ".off")


def read_mesh(path: Path) -> Mesh:
    """Read a mesh as its file has it: units, axes and vertex order untouched, polygons cut into triangles.

    An OBJ, a glTF and an FBX file give an AuthoredMesh, which keeps polygons, groups, materials and colours.
    A file without texture coordinates gives uvs (0, 2) and face_uvs (0, 3). Raises InputError for an
    unsupported extension, an unreadable file, no faces, a face with vertices that do not exist, more than
    MOST_VERTICES or MOST_FACES, or a number that is not finite or beyond LARGEST.
    """
    path = Path(path)
    if path.suffix.lower() not in EXTENSIONS:
        ending = f"not in '{path.suffix}'" if path.suffix else "this name has no ending"
        raise InputError(f"{path}: a garment file ends in {', '.join(EXTENSIONS)} or .mhclo, {ending}")
    refuse_large_file(path)
    mesh = _read(path)
    check_mesh(path, mesh)
    return mesh


def check_mesh(path: Path, mesh: Mesh) -> None:
    """Raise InputError naming the path for a mesh that cannot be a garment's, see `read_mesh`."""
    refuse_too_many(path, len(mesh.vertices), len(mesh.faces))
    if not len(mesh.vertices) or not len(mesh.faces):
        raise InputError(f"{path}: the garment is empty, it has {len(mesh.vertices)} vertices and no faces")
    wrong = mesh.faces[((mesh.faces < 0) | (mesh.faces >= len(mesh.vertices))).any(dim=1)]
    if len(wrong):
        raise InputError(
            f"{path}: a face has the vertices {wrong[0].tolist()}, expected 0 to {len(mesh.vertices) - 1}"
        )
    broken = torch.nonzero(~(mesh.vertices.abs() <= LARGEST).all(dim=1))
    if len(broken):
        fault = f"beyond {LARGEST:g}" if mesh.vertices[broken[0]].isfinite().all() else "not a finite number"
        raise InputError(f"{path}: vertex {int(broken[0])} is {fault}")
    if not (mesh.uvs.abs() <= LARGEST).all():
        raise InputError(f"{path}: a texture coordinate is not a finite number, or beyond {LARGEST:g}")


def _read(path: Path) -> Mesh:
    kind = path.suffix.lower()
    if kind == ".obj":
        return read_obj(path)
    try:
        return read_gltf_mesh(path) if kind in SCENES else _read_with_trimesh(path)
    except InputError:
        raise
    except Exception as error:  # With a broken file, readers raise exceptions of any type.
        raise InputError(f"{path}: not a readable {kind[1:].upper()} file ({cause(error)})") from error


def _read_with_trimesh(path: Path) -> Mesh:
    import trimesh

    content = BytesIO(read_content(path))
    # Without a path it opens no other files.
    scene = trimesh.load_scene(content, file_type=path.suffix[1:].lower(), process=False, skip_materials=True)
    parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    counts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    if not parts:
        return _mesh(
            np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), None, np.zeros((0, 3), dtype=np.int64)
        )
    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, counts[:-1], strict=True)])
    textures = [_texture(part) for part in parts]
    whole = [texture for texture in textures if texture is not None]
    return _mesh(vertices, faces, np.concatenate(whole) if len(whole) == len(parts) else None, faces)


def _texture(part: object) -> NDArray[np.float64] | None:
    """Texture coordinates per vertex (N, 2), if the part has them."""
    uv = getattr(getattr(part, "visual", None), "uv", None)
    vertices = getattr(part, "vertices", ())
    if uv is None or len(uv) != len(vertices):
        return None
    return np.asarray(uv, dtype=np.float64)[:, :2]


def _mesh(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    uvs: NDArray[np.float64] | None,
    face_uvs: NDArray[np.int64],
) -> Mesh:
    if uvs is None:
        uvs, face_uvs = np.zeros((0, 2)), np.zeros((0, 3), dtype=np.int64)
    return Mesh(
        torch.from_numpy(np.ascontiguousarray(vertices, dtype=np.float64)),
        torch.from_numpy(np.ascontiguousarray(faces, dtype=np.int64)),
        torch.from_numpy(np.ascontiguousarray(uvs, dtype=np.float32)),
        torch.from_numpy(np.ascontiguousarray(face_uvs, dtype=np.int64)),
    )
