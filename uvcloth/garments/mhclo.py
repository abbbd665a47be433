"""Clothes of MakeHuman (.mhclo with an OBJ): every vertex is bound to three vertices of the base mesh hm08.

A vertex lies at the weighted mean of the three, plus an offset. Offsets are in decimetres of the body that
the clothes were made on; along each axis they grow with the distance between two of its vertices.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.body import BASE_MESH, Body
from uvcloth.errors import InputError, cause
from uvcloth.files.reading import file_below
from uvcloth.formats.materials import TextureFiles, read_mhmat, read_text
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.geometry.authored import AuthoredMesh
from uvcloth.geometry.mesh import Mesh

SUFFIX = ".mhclo"

SAME = 1e-6
"""Metres within which a vertex of the body is one of the base mesh."""

LARGEST = 1e6
"""Greatest offset or coordinate, m."""

MOST_OF_BASE = 100_000
"""Most vertices of a base mesh."""

BODY_AXES = {"x": 0, "y": 2, "z": 1}
"""Axis of the body (Z up) along each axis of MakeHuman (Y up, facing +Z)."""


@dataclass(frozen=True)
class Binding:
    """Binding of N garment vertices to the base mesh.

    obj: file of the faces. corners: (N, 3) base-mesh vertices. weights: (N, 3). offsets: (N, 3) decimetres, Y
    up, facing +Z. scales: by axis "x", "y", "z" two base-mesh vertices and their distance there, decimetres.
    deleted: (K,) base-mesh vertices that the clothes hide. material: name of its file, "" for none.
    """

    obj: Path
    corners: Tensor
    weights: Tensor
    offsets: Tensor
    scales: dict[str, tuple[int, int, float]]
    deleted: Tensor
    material: str

    def place(self, base: Tensor) -> Tensor:
        """Garment vertices (N, 3) m on base-mesh vertices (B, 3) m, Z up, facing -Y."""
        scale = torch.ones(3)
        for axis, (one, other, decimetres) in self.scales.items():
            along = BODY_AXES[axis]
            scale["xyz".index(axis)] = (base[one, along] - base[other, along]).abs() / decimetres
        x, y, z = (self.offsets * scale).unbind(1)
        centres = (self.weights[..., None] * base[self.corners]).sum(1)
        return centres + torch.stack([x, -z, y], dim=1)

    def hides(self, body: Body) -> Tensor:
        """Vertices (K,) int64 of a body that the clothes hide; the body holds its base mesh."""
        from scipy.spatial import KDTree

        assert body.base is not None
        if not len(self.deleted):
            return self.deleted
        distance, nearest = KDTree(body.base.numpy()).query(body.mesh.vertices.numpy())
        hidden = torch.isin(torch.from_numpy(nearest), self.deleted) & (torch.from_numpy(distance) < SAME)
        return torch.nonzero(hidden).squeeze(1)


def fit_clothes(path: Path, body: Body) -> tuple[Mesh, Binding]:
    """Read clothes and place them on a body: their mesh as the OBJ has it, in metres, Z up, and the binding.

    Raises InputError naming the file if it cannot be read, is bound to another base mesh, to vertices that do
    not exist or to invalid places, or if the body does not contain its base mesh.
    """
    if body.base is None:
        raise InputError(
            f"{path}: body {body.name} does not contain the base mesh that these clothes are bound to, make "
            "it again with `uvcloth body`"
        )
    binding = read_binding(path)
    mesh = read_mesh(binding.obj)
    if len(mesh.vertices) != len(binding.corners):
        raise InputError(
            f"{path}: binds {len(binding.corners)} vertices, but {binding.obj.name} has {len(mesh.vertices)}"
        )
    last = max(int(binding.corners.max()), *(max(one, other) for one, other, _ in binding.scales.values()), 0)
    if last >= len(body.base):
        raise InputError(f"{path}: is bound to vertex {last}, the base mesh has {len(body.base)} vertices")
    mesh = replace(mesh, vertices=binding.place(body.base))
    if not bool((mesh.vertices.abs() <= LARGEST).all()):
        raise InputError(f"{path}: binds a vertex to a place beyond {LARGEST:g} m")
    return _with_material(mesh, path.parent, binding.material) if binding.material else mesh, binding


def _with_material(mesh: Mesh, folder: Path, name: str) -> Mesh:
    """The mesh all of one material, or as it is, with a note, where its file is not there."""
    if not isinstance(mesh, AuthoredMesh):
        return mesh
    pictures = TextureFiles(folder)
    material = read_mhmat(pictures, name)
    polygons = replace(mesh.polygons, missing=(*mesh.polygons.missing, *pictures.missing))
    if material is not None:
        polygons = replace(polygons, materials=(material,), material=np.zeros_like(polygons.material))
    return replace(mesh, polygons=polygons)


def read_binding(path: Path) -> Binding:
    """Read an .mhclo. Raises InputError naming the file if it is not one, or has another base mesh."""
    path = Path(path)
    bound: list[list[float]] = []
    scales: dict[str, tuple[int, int, float]] = {}
    files = {"obj_file": "", "material": ""}
    section = ""
    deleted = np.zeros(MOST_OF_BASE, dtype=np.bool_)
    for number, line in enumerate(read_text(path), start=1):
        try:
            match line.split():
                case [] | ["#", *_]:
                    continue
                case ["verts" | "delete_verts" as section, *_]:
                    continue
                case ["basemesh", name] if name != BASE_MESH:
                    raise InputError(f"{path}: made for the base mesh {name[:40]}, expected {BASE_MESH}")
                case ["obj_file" | "material" as key, *words]:
                    files[key] = " ".join(words)
                case ["x_scale" | "y_scale" | "z_scale" as key, one, other, distance]:
                    scales[key[0]] = (_index(one), _index(other), _positive(distance))
                case [_, *_] as words if section == "verts" and words[0].isdigit():
                    bound.append(_vertex(words))
                case [_, *_] as words if section == "delete_verts":
                    _mark(deleted, words)
        except ValueError as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"{path}, line {number}: not a readable MHCLO file ({cause(error)})") from error
    if not files["obj_file"] or not bound:
        raise InputError(f"{path}: not a readable MHCLO file, it names no obj_file or binds no vertices")
    rows = torch.tensor(bound, dtype=torch.float64)
    return Binding(
        obj=_sibling(path, files["obj_file"]),
        corners=rows[:, :3].long(),
        weights=rows[:, 3:6].float(),
        offsets=rows[:, 6:].float(),
        scales=scales,
        deleted=torch.from_numpy(np.flatnonzero(deleted)),
        material=files["material"],
    )


def _sibling(path: Path, name: str) -> Path:
    """The OBJ that an .mhclo names. Raises InputError if it lies in another folder."""
    try:
        return file_below(path.parent, path.parent, name)
    except InputError as error:
        raise InputError(f"{path}: its obj_file {error}") from error


def _mark(marks: NDArray[np.bool_], words: list[str]) -> None:
    """Mark the vertices of a line such as `3 5 - 7`: 3, 5, 6, 7."""
    first = 0
    for place, word in enumerate(words):
        if word != "-":
            last = _index(word)
            first = first if place and words[place - 1] == "-" else last
            marks[first : last + 1] = True


def _vertex(words: list[str]) -> list[float]:
    """Corners, weights and offsets of one vertex; one base-mesh vertex alone is that vertex itself."""
    if len(words) == 1:
        return [*[float(_index(words[0]))] * 3, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    if len(words) < 6:
        raise ValueError("expected three vertices, three weights and three offsets")
    numbers = [float(word) for word in (*words, "0", "0", "0")[:9]]
    if not all(abs(number) <= LARGEST for number in numbers):
        raise ValueError(f"a number is not finite, or beyond {LARGEST:g}")
    return [*(float(_index(word)) for word in words[:3]), *numbers[3:]]


def _index(word: str) -> int:
    index = int(word)
    if not 0 <= index < MOST_OF_BASE:
        raise ValueError(f"vertex {index}")
    return index


def _positive(word: str) -> float:
    value = float(word)
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"distance {word}")
    return value
