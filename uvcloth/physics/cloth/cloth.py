"""Cloth for the solver: masses, faces and hinges at rest, and neighbourhoods."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterize.charts import edge_keys, edge_twins, edges_of, face_components
from uvcloth.physics.fabric import AIR_DENSITY, Fabric

SPACING = 1.5
"""Distance of vertices two edges apart over the length of a short edge, in cloth that is squeezed."""

NARROWEST = 1e-8
"""Least width, m, of a face: one without an area is refused for its stiffness."""

SQUEEZED = 0.5
"""Share of its area at rest below which the bending forces of a face fade: they would grow without bound."""

Floats = NDArray[np.floating]
Integers = NDArray[np.integer]


class Particles(NamedTuple):
    """Vertices of cloth.

    mass: (N,) kg. weight: (N,) share of the mass on which gravity acts. thickness: (N,) m of other cloth
    between a vertex and the body. friction: (N,) coefficient on the body and on cloth.
    """

    mass: Floats
    weight: Floats
    thickness: Floats
    friction: Floats


class Membrane(NamedTuple):
    """Faces of cloth.

    corners: (M, 3). inverse: (M, 4) 1/m, entries 00, 01, 10, 11 of the inverse of the rest edges' matrix.
    area: (M,) m2. shear, spread: (M,) N/m, Lame parameters mu, lambda. damping: (M,) N s/m, of strain rates.
    pressure: (M,) kg/m3, half the density of air times the drag coefficient. reduction: root of the share of
    the stiffness that is left where cloth begins to be compressed; it grows to 1 where a face is flat, or
    shirts would ruck up on hips and stay so.
    """

    corners: Integers
    inverse: Floats
    area: Floats
    shear: Floats
    spread: Floats
    damping: Floats
    pressure: Floats
    reduction: float


class Hinges(NamedTuple):
    """Edges between two faces.

    corners: (E, 4), the vertices opposite of the edge, then its ends. stiffness: (E,) N m. rest: (E,)
    radians. floors: (E, 2) m4, square of the doubled area of each face below which forces fade. damping: s,
    times the stiffness.
    """

    corners: Integers
    stiffness: Floats
    rest: Floats
    floors: Floats
    damping: float


class Sheet(NamedTuple):
    """Surface of cloth for contact with itself.

    faces: (M, 3), piece after piece. starts: (K + 1,) first face of each piece. edges: (E, 2). owned: (M,)
    uint8, bits 0 to 2 of the corners and bits 3 to 5 of the edges (corner i to i + 1) that a face stands for,
    so that each is tested once. face_edges: (M, 3) into edges. apart: (K, K) bool, pairs of pieces that do
    not touch. spacing: m, least distance of vertices along the mesh that are no neighbours, in slightly
    squeezed cloth.
    """

    faces: Integers
    starts: Integers
    edges: Integers
    owned: NDArray[np.uint8]
    face_edges: Integers
    apart: NDArray[np.bool_]
    spacing: float


@dataclass(frozen=True)
class Damping:
    """Material damping: seconds by which viscous stress lags elastic stress, in the plane and in bending."""

    stretch: float = 1e-4
    bend: float = 2e-3


@dataclass(frozen=True)
class Cloth:
    """One garment, or several as one cloth, at rest, (N, 3) m."""

    rest: NDArray[np.float64]
    particles: Particles
    membrane: Membrane
    hinges: Hinges
    sheet: Sheet

    def elastic_sections(self) -> dict[str, NDArray[Any]]:
        """The arrays of faces and hinges that the runtime reads, by their names there."""
        return {**_named("membrane", self.membrane), **_named("hinges", self.hinges)}

    def sections(self) -> dict[str, NDArray[Any]]:
        """All arrays that the runtime reads, by their names there."""
        particles, sheet = _named("particles", self.particles), _named("sheet", self.sheet)
        return {"cloth.rest": self.rest, **particles, **self.elastic_sections(), **sheet}


def make_cloth(
    rest: NDArray,
    faces: Integers,
    fabric: Fabric | Sequence[Fabric],
    mass_factor: Floats | None = None,
    thickness: Floats | None = None,
    fabric_of: Integers | None = None,
    apart: NDArray[np.bool_] | None = None,
    compression: float = 1.0,
    damping: Damping = Damping(),
    moved_mass: float = 0.01,
) -> Cloth:
    """Make cloth of a mesh at rest, (N, 3) m and (M, 3).

    fabric: of the cloth; or several, one a garment, and fabric_of: (M,) which of them each face is of. apart:
    (G, G), pairs of garments that do not touch, because others lie between them. mass_factor: (N,) on
    the mass of vertices; gravity acts on their mass without it. thickness: (N,) m of other cloth beneath.
    compression: share of the membrane's stiffness that is left at the beginning of compression; it grows to 1
    where a face is flat. moved_mass: share of the mass that is moved to the stiffest vertices, so that a few
    small faces do not decide the step (after selective mass scaling: Olovsson et al. 2005).
    """
    faces = np.ascontiguousarray(faces, np.int32)
    rest = np.ascontiguousarray(rest, np.float64)
    factor = np.ones(len(rest)) if mass_factor is None else np.asarray(mass_factor, np.float64)
    area, inverse = _flattened(rest, faces)
    fabrics = [fabric] if isinstance(fabric, Fabric) else fabric
    of_face = np.zeros(len(faces), int) if fabric_of is None else fabric_of
    materials = np.array([astuple(each) for each in fabrics])[of_face]
    density, stretch, poisson, bend, friction_of, drag = materials.T
    mass = np.zeros(len(rest))
    np.add.at(mass, faces.ravel(), np.repeat(density * area / 3.0, 3))
    mass[mass == 0.0] = (density * area).mean() / 3.0
    friction = np.zeros(len(rest))
    friction[faces] = friction_of[:, None]
    reduction = math.sqrt(compression)
    shear = stretch / (2.0 * (1.0 + poisson))
    spread = stretch * poisson / (1.0 - poisson**2)
    stiffness = _corner_stiffness(faces, (2.0 * shear + spread) * area, inverse, len(rest))
    true_mass = _redistributed(mass, factor, stiffness, moved_mass)
    heavy = true_mass + (factor - 1.0) * mass
    return Cloth(
        rest,
        Particles(
            mass=heavy.astype(np.float32),
            weight=(true_mass / heavy).astype(np.float32),
            thickness=np.zeros(len(rest), np.float32)
            if thickness is None
            else np.ascontiguousarray(thickness, np.float32),
            friction=friction.astype(np.float32),
        ),
        Membrane(
            corners=faces,
            inverse=inverse.reshape(-1, 4),
            area=area,
            shear=shear,
            spread=spread,
            damping=2.0 * damping.stretch * (shear + spread),
            pressure=0.5 * AIR_DENSITY * drag,
            reduction=reduction,
        ),
        _hinges(rest, faces, bend, damping.bend),
        _sheet(rest, faces, of_face, np.zeros((len(fabrics),) * 2, np.bool_) if apart is None else apart),
    )


def _named(prefix: str, record: NamedTuple) -> dict[str, NDArray[Any]]:
    """Fields of a record as arrays of at least one axis, by their names after a prefix."""
    return {f"{prefix}.{name}": np.atleast_1d(value) for name, value in record._asdict().items()}


def _flattened(rest: NDArray[np.float64], faces: Integers) -> tuple[NDArray, NDArray]:
    """Areas (M,) m2 of faces, and the inverse (M, 2, 2) of their two edges laid into the plane."""
    a, b, c = (rest[faces[:, corner]] for corner in range(3))
    first, second = b - a, c - a
    size = np.maximum(np.linalg.norm(first, axis=1), NARROWEST)
    along = (first * second).sum(1) / size
    height = np.maximum(np.linalg.norm(np.cross(first, second), axis=1) / size, NARROWEST)
    edges = np.stack([np.stack([size, along], 1), np.stack([np.zeros_like(size), height], 1)], 1)
    return 0.5 * size * height, np.linalg.inv(edges)


def _corner_stiffness(faces: Integers, moduli: NDArray, inverse: NDArray, count: int) -> NDArray:
    """Stiffness (N,) of the faces around each vertex that is moved alone.

    moduli: (M,) N m, of the faces, times their areas.
    """
    slopes = np.concatenate([-inverse.sum(1, keepdims=True), inverse], 1)
    stiffness = np.zeros(count)
    np.add.at(stiffness, faces, moduli[:, None] * (slopes**2).sum(2))
    return stiffness


def _redistributed(mass: NDArray, factor: NDArray, stiffness: NDArray, share: float) -> NDArray:
    """Masses (N,) kg, of the same sum, with a share of it moved to where the frequency is highest."""
    heavy = factor * mass
    squared = stiffness / heavy
    order = np.argsort(-squared)
    limits = np.cumsum(stiffness[order]) / (np.cumsum(heavy[order]) + share * mass.sum())
    limit = limits[max(int((limits < squared[order]).sum()), 1) - 1]
    true_mass = mass + np.maximum(stiffness / limit - heavy, 0.0)
    return true_mass * (mass.sum() / true_mass.sum())


def _hinges(rest: NDArray[np.float64], faces: Integers, bend: NDArray, damping: float) -> Hinges:
    """Hinges whose stiffness makes a mesh of any resolution bend like a plate.

    An edge of length l between faces of areas a and b stores B l^2 / (a + b) / 2 times its angle squared
    (exact for cylinders on the equilateral lattice: Seung and Nelson 1988). bend: (M,) N m, B of the faces.
    """
    twins = edge_twins(faces, np.zeros(0, np.int64))
    edge, face = np.divmod(twins, len(faces))
    opposite = faces[face, (edge + 2) % 3]
    pairs = edges_of(faces)[0][twins[:, 0]]
    a, b = rest[pairs[:, 0]], rest[pairs[:, 1]]
    first, second = rest[opposite[:, 0]], rest[opposite[:, 1]]
    along = b - a
    lengths = np.linalg.norm(along, axis=1)
    n0, n1 = np.cross(a - first, b - first), np.cross(b - second, a - second)
    areas = np.stack([np.linalg.norm(n0, axis=1), np.linalg.norm(n1, axis=1)])
    sine = (np.cross(n0, n1) * along).sum(1) / np.maximum(lengths, 1e-12)
    return Hinges(
        corners=np.concatenate([opposite, pairs], 1),
        stiffness=2.0 * bend[face].mean(1) * lengths**2 / np.maximum(areas.sum(0), NARROWEST**2),
        rest=np.arctan2(sine, (n0 * n1).sum(1)),
        floors=((SQUEEZED * areas) ** 2).T,
        damping=damping,
    )


def _sheet(
    rest: NDArray[np.float64], faces: Integers, garment_of: Integers, apart: NDArray[np.bool_]
) -> Sheet:
    pieces = face_components(faces, np.zeros(0, np.int64))
    garments = garment_of[np.unique(pieces, return_index=True)[1]]
    faces = faces[np.argsort(pieces, kind="stable")]
    directed, owner = edges_of(faces)
    _, first, which = np.unique(edge_keys(directed, len(rest)), return_index=True, return_inverse=True)
    edges = directed[first]
    owned = np.zeros(len(faces), np.uint8)
    np.bitwise_or.at(owned, owner[first], (8 << (first // len(faces))).astype(np.uint8))
    _, corner = np.unique(faces.ravel(), return_index=True)
    np.bitwise_or.at(owned, corner // 3, (1 << (corner % 3)).astype(np.uint8))
    return Sheet(
        faces=faces,
        starts=np.cumsum([0, *np.bincount(pieces)]),
        edges=edges,
        owned=owned,
        face_edges=which.reshape(3, -1).T,
        apart=apart[garments[:, None], garments],
        spacing=SPACING * np.quantile(np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1), 0.1),
    )
