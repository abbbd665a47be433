"""Simulation on another mesh of the same garment: how much of a result is due to the mesh."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor
from trimesh.triangles import area

from rasterize.charts import face_components
from uvcloth.garments.cage import Cage
from uvcloth.garments.remesh import remesh, surface_of
from uvcloth.geometry.mesh import join_meshes
from uvcloth.physics.fabric import Fabric
from uvcloth.simulation.engine import Frame, Scene, SubstepEngine

FEWEST = 12
"""Least number of vertices of a remeshed piece."""

OTHER_EDGE = 0.95
"""Factor on the length of edges that makes another mesh of one whose edges are given."""


def other_mesh(vertices: Tensor, faces: Tensor, edge: float | None = None) -> Cage:
    """Remesh a surface (N, 3) m, (M, 3) to triangles of about one size.

    edge: m, length of their edges; None for no more vertices than the surface has.

    It is a cage with all of the surface's vertices. Each connected piece is remeshed by itself, its hems stay
    on its hems; the same surface gives the same mesh. Raises InputError as `remesh` does.
    """
    pieces = torch.from_numpy(face_components(faces.numpy(), np.zeros(0, dtype=np.int64)))
    parts: list[tuple[Tensor, Tensor]] = []
    corners, weights = [], []
    own_corners = torch.zeros(len(vertices), 3, dtype=torch.int64)
    own_weights = torch.zeros(len(vertices), 3)
    for piece in range(int(pieces.max()) + 1):
        kept, triangles = faces[pieces == piece].unique(return_inverse=True)
        surface = vertices[kept].double().numpy()
        count = len(kept) if edge is None else _count(vertices[kept], triangles, edge)
        points, new_faces = remesh(surface, triangles.numpy(), count)
        placed = torch.from_numpy(points).float(), torch.from_numpy(new_faces)
        closest = surface_of(surface, triangles.numpy()).closest(placed[0])
        back = surface_of(points, new_faces).closest(vertices[kept])
        corners.append(kept[triangles[closest.faces]])
        weights.append(closest.barycentrics)
        own_corners[kept] = placed[1][back.faces] + sum(len(part) for part, _ in parts)
        own_weights[kept] = back.barycentrics
        parts.append(placed)
    joined = join_meshes(parts)
    return Cage(
        joined.vertices, joined.faces, torch.cat(corners), torch.cat(weights), own_corners, own_weights
    )


def _count(vertices: Tensor, faces: Tensor, edge: float) -> int:
    """Vertices of a mesh of equilateral triangles, of which it has twice as many, on a surface."""
    square_metres = float(area(vertices[faces].double().numpy()).sum())
    return max(FEWEST, round(square_metres / (edge**2 * math.sqrt(0.75))))


@dataclass(frozen=True)
class Remeshed:
    """An engine that simulates another mesh of the cloth, and carries its motion back to the scene's.

    Vertices of the scene follow the other mesh by the interpolated offset from the skinned garment. edge: m,
    length of its edges, as `other_mesh` has it.
    """

    engine: SubstepEngine
    edge: float | None = None

    def describe(self) -> dict[str, Any]:
        """Describe the engine, as `Engine` says; its settings include the change of the mesh."""
        described = self.engine.describe()
        length = {} if self.edge is None else {"edge": self.edge}
        return {**described, "settings": {**described["settings"], "mesh": "remeshed", **length}}

    def with_fabric(self, fabric: Fabric) -> Self:
        """Make the same engine for cloth of another fabric."""
        return replace(self, engine=self.engine.with_fabric(fabric))

    def with_more_substeps(self, share: float) -> Self:
        """Make the same engine with 1 + share times as many substeps."""
        return replace(self, engine=self.engine.with_more_substeps(share))

    def on_another_mesh(self) -> Self:
        """Make the same engine for a mesh that differs by chance: with somewhat shorter edges."""
        return replace(self, edge=None if self.edge is None else OTHER_EDGE * self.edge)

    def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
        """Yield the frames as `Engine` says. Raises InputError as the engine and `other_mesh` do."""
        mesh = other_mesh(scene.rest, scene.faces, self.edge)
        other = scene_on(scene, mesh)
        for frame in self.engine.simulate(other, _recalled(after, len(other.rest))):
            offsets = frame.vertices - other.skinned[frame.index]
            vertices = scene.skinned[frame.index] + mesh.at_garment(offsets)
            yield Frame(frame.index, vertices, _with_vertices(frame))


def scene_on(scene: Scene, mesh: Cage) -> Scene:
    """The scene with another mesh of its cloth."""
    near = mesh.corners.gather(1, mesh.weights.argmax(1, keepdim=True))[:, 0]
    return replace(
        scene,
        rest=mesh.at_cage(scene.rest),
        faces=mesh.faces,
        band=scene.band[near],
        mass_factor=scene.mass_factor[near],
        inner_thickness=scene.inner_thickness[near],
        skinned=mesh.at_cage(scene.skinned),
        touches=scene.touches[:, near],
    )


def _with_vertices(frame: Frame) -> Tensor | None:
    """Vertices and memory (3 P + K,) of a frame of the other mesh."""
    return None if frame.memory is None else torch.cat([frame.vertices.flatten(), frame.memory])


def _recalled(frame: Frame | None, count: int) -> Frame | None:
    """The frame of the other mesh of `count` vertices that a frame remembers."""
    if frame is None or frame.memory is None:
        return None
    vertices, memory = frame.memory.split([3 * count, len(frame.memory) - 3 * count])
    return Frame(frame.index, vertices.view(-1, 3), memory)
