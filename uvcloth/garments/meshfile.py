"""Mesh files of users, read with their own vertex order and texture coordinates."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from rasterize.errors import InputError
from uvcloth.geometry.mesh import Mesh

EXTENSIONS = (".obj", ".ply", ".glb", ".gltf", ".stl", ".off")


def read_mesh(path: Path) -> Mesh:
    """Read a mesh as its file has it: units, axes and vertex order untouched, polygons cut into triangles.

    A file without texture coordinates gives uvs (0, 2) and face_uvs (0, 3). Raises InputError for an
    unsupported extension, an unreadable file, no faces, or a number that is not finite.
    """
    path = Path(path)
    if path.suffix.lower() not in EXTENSIONS:
        raise InputError(
            f"{path}: a garment file ends in {', '.join(EXTENSIONS)} or .mhclo, not in '{path.suffix}'"
        )
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    mesh = _read_obj(path) if path.suffix.lower() == ".obj" else _read_with_trimesh(path)
    if not len(mesh.vertices) or not len(mesh.faces):
        raise InputError(f"{path}: the garment is empty, it has {len(mesh.vertices)} vertices and no faces")
    broken = torch.nonzero(~torch.isfinite(mesh.vertices).all(dim=1))
    if len(broken):
        raise InputError(f"{path}: vertex {int(broken[0])} is not a finite number")
    if not torch.isfinite(mesh.uvs).all():
        raise InputError(f"{path}: a texture coordinate is not a finite number")
    return mesh


def _read_obj(path: Path) -> Mesh:
    """Read an OBJ: trimesh would reorder vertices whose texture coordinates have indices of their own."""
    vertices: list[list[float]] = []
    uvs: list[list[float]] = []
    corners: list[tuple[int, int]] = []
    for number, line in enumerate(read_text(path), start=1):
        try:
            match line.split():
                case ["v", x, y, z, *_]:
                    vertices.append([float(x), float(y), float(z)])
                case ["vt", u, v, *_]:
                    uvs.append([float(u), float(v)])
                case ["f", *polygon]:
                    face = [_obj_corner(corner, len(vertices), len(uvs)) for corner in polygon]
                    for pair in pairwise(face[1:]):
                        corners.extend((face[0], *pair))
        except ValueError as error:
            raise InputError(f"{path}, line {number}: not a readable OBJ file ({error})") from error
    points, texture = np.array(vertices, dtype=np.float64), np.array(uvs, dtype=np.float64)
    faces = np.array(corners, dtype=np.int64).reshape(-1, 3, 2)
    for kind, indices, count in (("vertex", faces[..., 0], len(points)), ("vt", faces[..., 1], len(texture))):
        if indices.size and not (-1 if kind == "vt" else 0) <= indices.min() <= indices.max() < count:
            raise InputError(f"{path}: a face names a {kind} that the file does not have")
    textured = len(texture) > 0 and bool((faces[..., 1] >= 0).all())
    return _mesh(points.reshape(-1, 3), faces[..., 0], texture if textured else None, faces[..., 1])


def read_text(path: Path) -> list[str]:
    """Read the lines of a text file, those that end in a backslash joined with the next.

    Raises InputError if there is no such file or it cannot be read.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    return text.replace("\\\n", " ").splitlines()


def _obj_corner(corner: str, vertices: int, uvs: int) -> tuple[int, int]:
    """A corner `v/vt/vn`, counted from 1, or backwards from -1, as indices; -1 without texture."""
    vertex, _, rest = corner.partition("/")
    texture = rest.partition("/")[0]
    return _obj_index(vertex, vertices), _obj_index(texture, uvs) if texture else -1


def _obj_index(word: str, count: int) -> int:
    index = int(word)
    if index == 0 or index < -count:
        raise ValueError(f"index {index}")
    return index - 1 if index > 0 else count + index


def _read_with_trimesh(path: Path) -> Mesh:
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    except Exception as error:  # trimesh's readers raise whatever a broken file makes them trip over
        kind = path.suffix[1:].upper()
        raise InputError(f"{path}: not a readable {kind} file ({error or type(error).__name__})") from error
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
