"""Energies of cloth in joules, differentiable: training on physics minimizes them, the solver follows them.

A `Fabric` in SI units sets the stiffness of all terms. Stretch and bending have two forms each. `membrane`
and `hinges` are those of the solver in `physics/cloth`: its forces are minus their gradients. `springs` and
`folds` are those of PBNS (Bertiche et al. 2021, eq. 4). Their stiffness is that of the fabric on a mesh of
equilateral triangles (Seung and Nelson 1988), whose Poisson ratio is 1/3.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import accumulate, chain
from typing import Any

import torch
from torch import Tensor

from uvcloth.geometry.mesh import edge_lengths, face_normals, face_pairs, hinges, unique_edges
from uvcloth.geometry.operators import Operator
from uvcloth.geometry.units import GRAVITY
from uvcloth.physics.fabric import AIR_DENSITY, Fabric
from uvcloth.physics.measures import hinge_angles, normal_differences

SPRING_SHARE = math.sqrt(3.0) / 2.0
"""Stiffness of the spring along an edge, N/m, over the membrane stiffness of the fabric, N/m."""

FOLD_SHARE = 2.0 / math.sqrt(3.0)
"""Stiffness of a fold, J over half the squared difference of normals, over the bending rigidity, N m."""

NARROWEST = 1e-8
"""Least width of a face at rest, m."""

TILT = 1e-7
"""Least difference of squared principal stretches, halved, so that the slope of its root is finite."""

FLATTENED = 1e-2
"""Square of the stretch below which strain grows in proportion to the square."""


@dataclass(frozen=True)
class ClothEnergies:
    """Energies of the cloth of O outfits, one after another, of N vertices, F faces, E edges and P hinges.

    Terms take vertices (..., N, 3) m, whose leading dimensions are poses, and return (..., O) J.

    faces: (F, 3). edges: (E, 2). pairs: (P, 2) faces that share an edge. corners: (P, 4), see `hinges`.
    masses: (N,) kg. lengths: (E,) m at rest. spring: (E,) N/m. fold: (P,) J. angles: (P,) radians at rest.
    rigidity: (P,) N m. areas: (F,) m2 at rest. inverse: (F, 2, 2) 1/m of the two edges laid into the plane.
    shear, spread: (F,) Lame parameters mu and lambda, N/m. pressure: (F,) half the density of air times the
    drag coefficient, kg/m3. The counts are how many of each an outfit has.
    """

    faces: Tensor
    edges: Tensor
    pairs: Tensor
    corners: Tensor
    masses: Tensor
    lengths: Tensor
    spring: Tensor
    fold: Tensor
    angles: Tensor
    rigidity: Tensor
    areas: Tensor
    inverse: Tensor
    shear: Tensor
    spread: Tensor
    pressure: Tensor
    vertex_counts: tuple[int, ...]
    edge_counts: tuple[int, ...]
    face_counts: tuple[int, ...]
    hinge_counts: tuple[int, ...]

    def springs(self, vertices: Tensor) -> Tensor:
        """Stretch as springs along the edges, k (l - l0)^2 / 2 (PBNS L_edge)."""
        change = edge_lengths(vertices, self.edges) - self.lengths
        return _sums(0.5 * self.spring * change.square(), self.edge_counts)

    def membrane(self, vertices: Tensor, compression: float = 1.0) -> Tensor:
        """Stretch of faces, per area mu (e1^2 + e2^2) + lambda (e1 + e2)^2 / 2 of principal strains e1, e2.

        Those are Green's in tension, (s^2 - 1) / 2 at a stretch s, as in St. Venant and Kirchhoff's material,
        and Biot's in compression, s - 1, so that squeezed cloth does not give way. compression: share of the
        stiffness that is left for small negative strains; it grows to 1 where a face is flat.
        """
        first, second = self._deformation(vertices)
        c00, c11, c01 = (first * first).sum(-1), (second * second).sum(-1), (first * second).sum(-1)
        mean, half = 0.5 * (c00 + c11), 0.5 * (c00 - c11)
        apart = (half.square() + c01.square() + TILT**2).sqrt()
        high, low = (_strain(square, compression) for square in (mean + apart, mean - apart))
        density = self.shear * (high.square() + low.square()) + 0.5 * self.spread * (high + low).square()
        return _sums(self.areas * density, self.face_counts)

    def folds(self, vertices: Tensor) -> Tensor:
        """Bending as half the squared difference of neighbouring normals, in units of `fold` (PBNS L_bend).

        Flat cloth has none, whatever its shape at rest.
        """
        apart = normal_differences(vertices, self.faces, self.pairs)
        return _sums(0.5 * self.fold * apart, self.hinge_counts)

    def hinges(self, vertices: Tensor) -> Tensor:
        """Bending K (theta - theta0)^2 / 2 of the angle at each hinge; that of a plate on any mesh."""
        turned = hinge_angles(vertices, self.corners) - self.angles
        return _sums(0.5 * self.rigidity * turned.square(), self.hinge_counts)

    def roughness(self, normals: Tensor, average: Operator, stiffness: float) -> Tensor:
        """Stiffness, J, times the squared Laplacians of vertex normals (..., N, 3) (DeePSD, eq. 4).

        average: over each vertex and its neighbours; the Laplacian is the normal minus that. The term smooths
        cloth; no rigidity of a fabric corresponds to it.
        """
        rough = (normals - average(normals)).square().sum(-1)
        return _sums(stiffness * rough, self.vertex_counts)

    def gravity(self, vertices: Tensor) -> Tensor:
        """Weight m g z (PBNS L_gravity), zero at the height z = 0."""
        return _sums(GRAVITY * self.masses * vertices[..., 2], self.vertex_counts)

    def inertia(self, vertices: Tensor, before: Tensor, earlier: Tensor, seconds: float) -> Tensor:
        """Inertia m |x - 2 x' + x''|^2 / (2 h^2) of three positions, (..., N, 3) m each, h seconds apart.

        Its gradient is the mass times the acceleration: the positions with the least sum of all energies are
        those after a step of implicit Euler (after Santesteban et al. 2022, SNUG, eq. 8).
        """
        change = (vertices - 2.0 * before + earlier).square().sum(-1)
        return _sums(self.masses * change / (2.0 * seconds**2), self.vertex_counts)

    def air(self, vertices: Tensor, before: Tensor, seconds: float) -> Tensor:
        """Drag of still air on the way from the positions `before`, (..., N, 3) m, in h = `seconds`.

        h p a |v|^3 / 3 of each face, with `pressure` p and the speed v of its centre along its normal; normal
        and area a are those before. Minus its gradient is the drag p a v |v|, a third at each corner.
        """
        normals = 0.5 * face_normals(before, self.faces)
        areas = normals.norm(dim=-1)
        way = (vertices - before)[..., self.faces, :].mean(-2)
        speed = (way * normals).sum(-1) / (areas.clamp(min=NARROWEST**2) * seconds)
        return _sums(seconds / 3.0 * self.pressure * areas * speed.abs() ** 3, self.face_counts)

    def _deformation(self, vertices: Tensor) -> tuple[Tensor, Tensor]:
        """Columns (..., F, 3) of the deformation gradient of faces."""
        a, b, c = (vertices[..., self.faces[:, corner], :] for corner in range(3))
        edges = torch.stack([b - a, c - a], dim=-1) @ self.inverse
        return edges[..., 0], edges[..., 1]


def cloth_energies(vertices: Tensor, faces: Tensor, fabric: Fabric) -> ClothEnergies:
    """Energies of one outfit of a fabric, at rest vertices (N, 3) m and faces (F, 3).

    The mass of a face is shared by its corners.
    """
    edges, pairs, corners = unique_edges(faces), face_pairs(faces), hinges(faces)
    areas, inverse = _flattened(vertices, faces)
    masses = vertices.new_zeros(len(vertices)).index_add(0, faces.flatten(), areas.repeat_interleave(3))
    ends = vertices[corners[:, 3]] - vertices[corners[:, 2]]
    rigidity = fabric.bend * ends.square().sum(1) / areas[pairs].sum(1).clamp(min=NARROWEST**2)
    shear = fabric.stretch / (2.0 * (1.0 + fabric.poisson))
    spread = fabric.stretch * fabric.poisson / (1.0 - fabric.poisson**2)
    return ClothEnergies(
        faces=faces,
        edges=edges,
        pairs=pairs,
        corners=corners,
        masses=fabric.density / 3.0 * masses,
        lengths=edge_lengths(vertices, edges),
        spring=vertices.new_full((len(edges),), SPRING_SHARE * fabric.stretch),
        fold=vertices.new_full((len(pairs),), FOLD_SHARE * fabric.bend),
        angles=hinge_angles(vertices, corners),
        rigidity=rigidity,
        areas=areas,
        inverse=inverse,
        shear=torch.full_like(areas, shear),
        spread=torch.full_like(areas, spread),
        pressure=torch.full_like(areas, 0.5 * AIR_DENSITY * fabric.drag),
        vertex_counts=(len(vertices),),
        edge_counts=(len(edges),),
        face_counts=(len(faces),),
        hinge_counts=(len(pairs),),
    )


def join_energies(parts: Sequence[ClothEnergies]) -> ClothEnergies:
    """Energies of several outfits, whose vertices follow one another."""
    vertices = tuple(accumulate((len(part.masses) for part in parts[:-1]), initial=0))
    faces = tuple(accumulate((len(part.faces) for part in parts[:-1]), initial=0))
    starts = {"faces": vertices, "edges": vertices, "corners": vertices, "pairs": faces}
    joined: dict[str, Any] = {}
    for name in (field.name for field in fields(ClothEnergies)):
        values = [getattr(part, name) for part in parts]
        if name.endswith("_counts"):
            joined[name] = tuple(chain.from_iterable(values))
        elif name in starts:
            joined[name] = torch.cat([each + start for each, start in zip(values, starts[name], strict=True)])
        else:
            joined[name] = torch.cat(values)
    return ClothEnergies(**joined)


def collision_energy(distance: Tensor, thickness: float, stiffness: float) -> Tensor:
    """Springs against vertices too close (PBNS L_collision, eq. 5): (..., n) m, stiffness N/m -> (...,) J.

    distance: signed, of each vertex from a surface. k (thickness - distance)^2 / 2 where it is less than
    the thickness, m, the paper's epsilon.
    """
    return 0.5 * stiffness * (thickness - distance).clamp(min=0).square().sum(-1)


def attachment_energy(offsets: Tensor, stiffness: float | Tensor) -> Tensor:
    """Springs to where vertices are attached, k |d|^2 / 2: (..., n, 3) m, N/m or (n,) of each -> (...,) J."""
    return (0.5 * stiffness * offsets.square().sum(-1)).sum(-1)


def _strain(square: Tensor, compression: float) -> Tensor:
    """Strain of a squared principal stretch, reduced where it is negative."""
    stretch = square.clamp(min=FLATTENED).sqrt() + 0.5 / math.sqrt(FLATTENED) * (square - FLATTENED).clamp(
        max=0
    )
    squeezed, reduction = 1.0 - stretch, math.sqrt(compression)
    # The integral of the slope, which rises linearly from the reduction to 1.
    reduced = squeezed * (reduction + 0.5 * (1.0 - reduction) * squeezed)
    return torch.where(square > 1.0, 0.5 * (square - 1.0), -reduced)


def _flattened(rest: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    """Areas (F,) m2 of faces at rest, and the inverse (F, 2, 2) of their two edges laid into the plane."""
    a, b, c = (rest[faces[:, corner]] for corner in range(3))
    first, second = b - a, c - a
    size = first.norm(dim=1).clamp(min=NARROWEST)
    along = (first * second).sum(1) / size
    height = (torch.linalg.cross(first, second).norm(dim=1) / size).clamp(min=NARROWEST)
    rows = (1.0 / size, -along / (size * height), torch.zeros_like(size), 1.0 / height)
    return 0.5 * size * height, torch.stack(rows, dim=1).view(-1, 2, 2)


def _sums(values: Tensor, counts: Sequence[int]) -> Tensor:
    """Sums of the consecutive elements (..., n) that each outfit has: (..., O)."""
    return torch.stack([each.sum(-1) for each in values.split(counts, dim=-1)], dim=-1)
