"""Wavefront OBJ of users, with materials: vertices in the file's order, polygons as they are.

trimesh would reorder vertices whose texture coordinates have indices of their own.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

from uvcloth.errors import InputError, cause
from uvcloth.formats.materials import TextureFiles, read_libraries, read_text
from uvcloth.geometry.authored import AuthoredMesh, Labels, Polygons, SurfaceMaterial, UvSet

LARGEST_INDEX = 2**31
"""Limit for an index in a face."""


@dataclass
class _Names:
    """Names of polygons while a file is read: the current one, and the index of each polygon's name."""

    index: dict[str, int] = field(default_factory=dict)
    current: int = -1
    of: list[int] = field(default_factory=list)

    def switch(self, words: list[str]) -> None:
        name = " ".join(words)
        self.current = self.index.setdefault(name, len(self.index)) if name else -1

    def labels(self) -> Labels:
        return Labels(tuple(self.index), np.array(self.of, dtype=np.int64))


def read_obj(path: Path) -> AuthoredMesh:
    """Read an OBJ, its vertices float64 as they are.

    Raises InputError naming a line that is not valid.
    """
    vertices: list[list[float]] = []
    uvs: list[list[float]] = []
    corners: list[tuple[int, int]] = []
    sizes: list[int] = []
    objects, groups, used = _Names(), _Names(), _Names()
    libraries: list[str] = []
    for number, line in enumerate(read_text(path), start=1):
        try:
            match line.split():
                case ["v", _, _, _, *_] as words:
                    vertices.append([float(word) for word in words[1:8]])
                case ["vt", u, v, *_]:
                    uvs.append([float(u), float(v)])
                case ["f", _, _, _, *_] as words:
                    corners.extend(_corner(corner, len(vertices), len(uvs)) for corner in words[1:])
                    sizes.append(len(words) - 1)
                    for names in (objects, groups, used):
                        names.of.append(names.current)
                case ["o", *words]:
                    objects.switch(words)
                case ["g", *words]:
                    groups.switch(words)
                case ["usemtl", *words]:
                    used.switch(words)
                case ["mtllib", *words]:
                    libraries.append(" ".join(words))
        except ValueError as error:
            raise InputError(f"{path}, line {number}: not a readable OBJ file ({cause(error)})") from error
    points = np.array([row[:3] for row in vertices], dtype=np.float64).reshape(-1, 3)
    with np.errstate(over="ignore"):  # Values that are not finite are refused with the mesh.
        texture = np.array(uvs, dtype=np.float32).reshape(-1, 2)
    pairs = np.array(corners, dtype=np.int64).reshape(-1, 2)
    for kind, indices, count in (("vertex", pairs[:, 0], len(points)), ("vt", pairs[:, 1], len(texture))):
        if indices.size and not (-1 if kind == "vt" else 0) <= indices.min() <= indices.max() < count:
            raise InputError(f"{path}: a face refers to a {kind} that the file does not have")
    textured = len(texture) > 0 and bool((pairs[:, 1] >= 0).all())
    pictures = TextureFiles(path.parent)
    materials = read_libraries(pictures, libraries)
    polygons = Polygons(
        sizes=np.array(sizes, dtype=np.int64),
        corners=pairs[:, 0],
        uv_sets=(UvSet(texture, pairs[:, 1]),) if textured else (),
        objects=objects.labels(),
        groups=groups.labels(),
        materials=tuple(materials.get(name, SurfaceMaterial(name)) for name in used.index),
        material=used.labels().of,
        colors=_colors(vertices),
        missing=tuple(pictures.missing),
    )
    return AuthoredMesh.of(torch.from_numpy(points), polygons)


def _colors(vertices: list[list[float]]) -> np.ndarray | None:
    """Colours (N, 4) of vertex lines `x y z r g b`, None unless all have them, 0 to 1."""
    if not vertices or min(map(len, vertices)) < 6:
        return None
    rows = np.array([row[3:6] for row in vertices])
    if not ((rows >= 0) & (rows <= 1)).all():
        return None
    colors = rows.astype(np.float32)
    return np.concatenate([colors, np.ones_like(colors[:, :1])], axis=1)


def _corner(corner: str, vertices: int, uvs: int) -> tuple[int, int]:
    """Indices of a corner `v/vt/vn`, counted from 1, or backwards from -1; -1 without texture."""
    vertex, _, rest = corner.partition("/")
    texture = rest.partition("/")[0]
    return _index(vertex, vertices), _index(texture, uvs) if texture else -1


def _index(word: str, count: int) -> int:
    index = int(word)
    if index == 0 or index < -count or index > LARGEST_INDEX:
        raise ValueError(f"index {index}")
    return index - 1 if index > 0 else count + index
