"""Meshes as their author made them: polygons, groups, materials, texture coordinate sets and vertex colours.

Everything is computed on the triangles that the polygons were cut into; the polygons are kept for export.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.geometry.mesh import Mesh

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Texture:
    """A picture file: its name without suffix, its suffix (".png", ".jpg", ...) and its bytes."""

    name: str
    suffix: str
    content: bytes


@dataclass(frozen=True)
class SurfaceMaterial:
    """Surface of polygons: colour (sRGB and opacity, 0 to 1), and a texture on one of the UV sets."""

    name: str
    color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    texture: Texture | None = None
    uv_set: int = 0


@dataclass(frozen=True)
class Labels:
    """Names that polygons have; of: (P,) index of the name of each, -1 for none."""

    names: tuple[str, ...]
    of: Indices

    def select(self, rows: Indices) -> "Labels":
        """Labels of some of the polygons; names that are no longer used are dropped."""
        used, of = np.unique(self.of[rows], return_inverse=True)
        first = int(len(used) > 0 and used[0] < 0)
        return Labels(tuple(self.names[index] for index in used[first:]), of.reshape(-1) - first)


@dataclass(frozen=True)
class UvSet:
    """Texture coordinates: uvs (U, 2), from the bottom of the picture, and corners (C,) into them."""

    uvs: NDArray[np.float32]
    corners: Indices


@dataclass(frozen=True)
class Polygons:
    """Faces of a mesh as its file has them.

    sizes: (P,) corners of each. corners: (C,) vertices, polygon after polygon. material: (P,) index of each
    into materials. colors: (N, 4) of the vertices, 0 to 1, None without. missing: files that the mesh names
    but that do not exist.
    """

    sizes: Indices
    corners: Indices
    uv_sets: tuple[UvSet, ...]
    objects: Labels
    groups: Labels
    materials: tuple[SurfaceMaterial, ...]
    material: Indices
    colors: NDArray[np.float32] | None = None
    missing: tuple[str, ...] = ()

    @property
    def starts(self) -> Indices:
        """First corner of each polygon: (P,)."""
        return np.cumsum(self.sizes) - self.sizes

    def triangles(self) -> tuple[Indices, Indices]:
        """Corners (T, 3) of the fans that polygons are cut into, and the polygon (T,) of each."""
        counts = np.maximum(self.sizes - 2, 0)
        owner = np.repeat(np.arange(len(counts)), counts)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        first = self.starts[owner]
        return np.stack([first, first + step + 1, first + step + 2], axis=1), owner

    def select(self, rows: Indices, turned: NDArray[np.bool_]) -> "Polygons":
        """Some of the polygons (R,), with those that are turned (R,) the other way around."""
        sizes = self.sizes[rows]
        owner = np.repeat(np.arange(len(rows)), sizes)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        # The first corner stays the first, so that the fans are cut along the same lines.
        place = np.where(turned[owner] & (step > 0), sizes[owner] - step, step)
        corners = self.starts[rows][owner] + place
        kept, material = np.unique(self.material[rows], return_inverse=True)
        first = int(len(kept) > 0 and kept[0] < 0)
        return replace(
            self,
            sizes=sizes,
            corners=self.corners[corners],
            uv_sets=tuple(replace(uv_set, corners=uv_set.corners[corners]) for uv_set in self.uv_sets),
            objects=self.objects.select(rows),
            groups=self.groups.select(rows),
            materials=tuple(self.materials[index] for index in kept[first:]),
            material=material.reshape(-1) - first,
        )


@dataclass(frozen=True)
class AuthoredMesh(Mesh):
    """A mesh of a file: its triangles, and the polygons that they were cut from."""

    polygons: Polygons

    @classmethod
    def of(cls, vertices: Tensor, polygons: Polygons) -> "AuthoredMesh":
        """Cut polygons into triangles; the first set of texture coordinates is that of the mesh."""
        corners, _ = polygons.triangles()
        uvs, face_uvs = torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64)
        if polygons.uv_sets:
            uvs = torch.from_numpy(polygons.uv_sets[0].uvs)
            face_uvs = torch.from_numpy(polygons.uv_sets[0].corners[corners])
        return cls(vertices, torch.from_numpy(polygons.corners[corners]), uvs, face_uvs, polygons)


def polygons_of(mesh: Mesh) -> Polygons:
    """The polygons of a mesh; its triangles where it was not read from a file."""
    if isinstance(mesh, AuthoredMesh):
        return mesh.polygons
    count = len(mesh.faces)
    sets = (UvSet(mesh.uvs.numpy().astype(np.float32), mesh.face_uvs.numpy().reshape(-1)),)
    none = Labels((), np.full(count, -1))
    return Polygons(
        sizes=np.full(count, 3),
        corners=mesh.faces.numpy().reshape(-1),
        uv_sets=sets if len(mesh.uvs) else (),
        objects=none,
        groups=none,
        materials=(),
        material=np.full(count, -1),
    )


def follow_triangles(mesh: Mesh) -> Mesh:
    """Drop the polygons whose triangles were dropped, and turn those whose triangles were turned."""
    if not isinstance(mesh, AuthoredMesh):
        return mesh
    polygons = mesh.polygons
    corners, owner = polygons.triangles()
    cut, faces = polygons.corners[corners], mesh.faces.numpy()
    _, place = np.unique(np.sort(np.concatenate([cut, faces]), axis=1), axis=0, return_inverse=True)
    place = place.reshape(-1)
    triangle = np.full(int(place.max()) + 1, -1)
    triangle[place[: len(cut)][::-1]] = np.arange(len(cut))[::-1]
    source = triangle[place[len(cut) :]]
    flipped = (cut[source][:, ::-1] == faces).all(1)
    rows, first = np.unique(owner[source], return_index=True)
    return replace(mesh, polygons=polygons.select(rows, flipped[first]))


def part_of(mesh: Mesh, inside: Tensor) -> Mesh:
    """Mesh of the vertices inside (N,) bool, in their order, and of the faces between them."""
    kept = inside[mesh.faces].all(1)
    number = inside.long().cumsum(0) - 1
    used, face_uvs = torch.unique(mesh.face_uvs[kept], return_inverse=True)
    plain = Mesh(mesh.vertices[inside], number[mesh.faces[kept]], mesh.uvs[used], face_uvs)
    if not isinstance(mesh, AuthoredMesh):
        return plain
    among = mesh.polygons
    owner = np.repeat(np.arange(len(among.sizes)), among.sizes)
    outside = np.bincount(owner[~inside.numpy()[among.corners]], minlength=len(among.sizes))
    rows = np.nonzero(outside == 0)[0]
    polygons = among.select(rows, np.zeros(len(rows), dtype=np.bool_))
    polygons = replace(
        polygons,
        corners=number.numpy()[polygons.corners],
        colors=None if polygons.colors is None else polygons.colors[inside.numpy()],
    )
    return AuthoredMesh(plain.vertices, plain.faces, plain.uvs, plain.face_uvs, polygons)
