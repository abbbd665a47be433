"""Registration: our body's surface moved onto a character's, so that each vertex keeps its place on the body.

Non-rigid ICP (Amberg et al. 2007) with displacements instead of affine maps. In each iteration, every vertex
is matched with the closest point of the character that belongs to the same limb, faces the same way, is
not on a border, beyond which there is no surface (Turk and Levoy 1994), and is near the vertex also when seen
from there. Then the displacements D minimize sum w |D - (closest - start)|^2 + stiffness |L D|^2 over the
mesh, with L its Laplacian. The stiffness falls from iteration to iteration.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from torch import Tensor

from rasterize.gather import gather
from rasterize.raycast import closest_points
from uvcloth.characters.shape import SkinnedSurface
from uvcloth.geometry.mesh import (
    boundary_edges,
    edge_keys,
    laplacian,
    neighbour_average,
    unit_face_normals,
    vertex_normals,
    weld,
)

Array = NDArray[np.float64]

STIFFNESS = (300.0, 100.0, 30.0, 10.0, 4.0, 2.0, 1.0, 0.5, 0.3, 0.3)
"""Stiffness of each iteration."""

REACH = (0.12, 0.12, 0.1, 0.08, 0.06, 0.05, 0.04, 0.04, 0.03, 0.03)
"""Greatest distance of a match in each iteration, as a share of the body's height."""

HOLD = 1e-3
"""Weight of zero displacement, which keeps the rough shape where a vertex has no match."""

TOLERANCE, ITERATIONS = 3e-3, 120
"""Relative residual at which conjugate gradients stop, and their most steps."""

FACING = 0.4
"""Least cosine between the normals of a vertex and its match."""

ASIDE, LEAST_ASIDE = 0.7, 0.01
"""How far from a vertex the point closest to its match may be, over the match's distance, and m of any."""

ON_BORDER = 1e-3
"""Barycentric coordinate below which a match is on the side opposite to that corner."""

LEAST_LIMB = 0.15
"""Least weight of a limb in a face for it to hold matches of that limb."""

LIFTS, SPREADING = 3, 6
"""Times that the surface is lifted over the character's own vertices, and passes that spread each lift."""


@dataclass(frozen=True)
class Matches:
    """Closest points of N vertices on a surface: hit (N,) bool, points (N, 3) m, weights (N, J) there.

    A vertex without a match (not hit) keeps its own point and weights.
    """

    hit: Tensor
    points: Tensor
    weights: Tensor


def limbs_of(names: tuple[str, ...]) -> Tensor:
    """Limb of each joint (J,): 0 trunk and head, 1 and 2 the arms, 3 and 4 the legs, left before right."""

    def limb(name: str) -> int:
        side = 1 if name.startswith("L") and name != "LowerBack" else 2
        if name.endswith(("Leg", "Foot", "ToeBase")):
            return side + 2
        return side if name.endswith(("Arm", "Hand", "Thumb", "FingerBase", "HandFinger1")) else 0

    return torch.tensor([limb(name) for name in names])


def register(start: SkinnedSurface, target: SkinnedSurface, limbs: Tensor) -> Tensor:
    """Move a surface that lies near a target onto it: vertices (V, 3) m.

    Both have weights of the same joints; limbs: (J,) from `limbs_of`.
    """
    height = float(start.vertices[:, 2].max() - start.vertices[:, 2].min())
    count = len(start.vertices)
    operator = _sparse(laplacian(start.faces, count))
    bending = csr_array(operator.T @ operator)
    displacement: Array = np.zeros((count, 3))
    for stiffness, reach in zip(STIFFNESS, REACH, strict=True):
        vertices = start.vertices + torch.from_numpy(displacement).float()
        matches = match(SkinnedSurface(vertices, start.faces, start.weights), target, limbs, reach * height)
        hit = matches.hit.double().numpy()
        weight = hit + HOLD
        wanted = (matches.points - start.vertices).double().numpy() * hit[:, None]
        displacement = _solved(csr_array(stiffness * bending + diags_array(weight)), wanted, displacement)
    return start.vertices + torch.from_numpy(displacement).float()


def match(surface: SkinnedSurface, target: SkinnedSurface, limbs: Tensor, reach: float) -> Matches:
    """Find the closest point of the target for each vertex, on the limb that faces its way, off borders.

    reach: greatest distance of a match, m.
    """
    count = len(surface.vertices)
    normals = vertex_normals(surface.vertices, surface.faces)
    facing = unit_face_normals(target.vertices, target.faces)
    own_limb = _by_limb(surface.weights, limbs).argmax(1)
    face_limbs = _by_limb(target.weights, limbs)[target.faces].mean(1)
    border = _border_sides(target)
    hit = torch.zeros(count, dtype=torch.bool)
    points, weights = surface.vertices.clone(), surface.weights.clone()
    for limb in limbs.unique().tolist():
        rows = torch.nonzero(own_limb == limb).squeeze(1)
        faces = torch.nonzero(face_limbs[:, limb] > LEAST_LIMB).squeeze(1)
        if not len(rows) or not len(faces):
            continue
        hits = closest_points(surface.vertices[rows], target.vertices, target.faces[faces])
        met = faces[hits.face]
        beyond = (border[met] & (hits.barycentrics < ON_BORDER)).any(1)
        good = (hits.distance < reach) & ((facing[met] * normals[rows]).sum(1) > FACING) & ~beyond
        there = gather(target.vertices, target.faces[met], hits.barycentrics)
        back = closest_points(there, surface.vertices, surface.faces)
        aside = (back.interpolate(surface.vertices, surface.faces) - surface.vertices[rows]).norm(dim=1)
        good &= aside <= (ASIDE * hits.distance).clamp(min=LEAST_ASIDE)
        matched = rows[good]
        corners, barycentrics = target.faces[met[good]], hits.barycentrics[good]
        hit[matched] = True
        points[matched] = there[good]
        weights[matched] = gather(target.weights, corners, barycentrics)
    return Matches(hit, points, weights)


def lifted(surface: SkinnedSurface, points: Tensor, most: float) -> Tensor:
    """Vertices (V, 3) of a surface, lifted along its normals until points (P, 3) m are hardly above it.

    most: greatest distance, m, of a point that lifts the surface; farther points are not part of the body.
    """
    vertices = surface.vertices
    average = neighbour_average(surface.faces, len(vertices))
    for _ in range(LIFTS):
        normals = vertex_normals(vertices, surface.faces)
        hits = closest_points(points, vertices, surface.faces)
        corners = surface.faces[hits.face]
        away = points - gather(vertices, corners, hits.barycentrics)
        above = (away * gather(normals, corners, hits.barycentrics)).sum(1)
        counts = (above > 0) & (hits.distance < most) & (above > 0.5 * hits.distance)
        lift = torch.zeros(len(vertices))
        lift = lift.scatter_reduce(0, corners[counts].reshape(-1), above[counts].repeat_interleave(3), "amax")
        spread = lift
        for _ in range(SPREADING):
            spread = torch.maximum(lift, torch.mv(average, spread))
        vertices = vertices + spread[:, None] * normals
    return vertices


def _border_sides(surface: SkinnedSurface) -> Tensor:
    """Mask (F, 3) of the sides of faces that are borders, each at the corner opposite to it."""
    faces = weld(surface.vertices)[surface.faces]
    sides = torch.stack([faces[:, [1, 2]], faces[:, [2, 0]], faces[:, [0, 1]]], dim=1)
    return torch.isin(edge_keys(sides.reshape(-1, 2)), edge_keys(boundary_edges(faces))).view(-1, 3)


def _by_limb(weights: Tensor, limbs: Tensor) -> Tensor:
    """Weights (V, J) summed over the joints of each limb: (V, 5)."""
    return torch.zeros(len(weights), int(limbs.max()) + 1).index_add(1, limbs, weights)


def _solved(system: csr_array, wanted: Array, start: Array) -> Array:
    """Solve a symmetric system (V, V) for displacements (V, 3) by conjugate gradients, all axes at once."""
    scale = 1.0 / system.diagonal()[:, None]
    solution = start
    residual = wanted - system @ solution
    step = scale * residual
    energy = (residual * step).sum(0)
    goal = TOLERANCE**2 * (wanted * scale * wanted).sum(0) + 1e-20
    for _ in range(ITERATIONS):
        if (energy <= goal).all():
            break
        image = system @ step
        length = energy / np.maximum((step * image).sum(0), 1e-30)
        solution, residual = solution + length * step, residual - length * image
        fresh = (residual * scale * residual).sum(0)
        step = scale * residual + fresh / np.maximum(energy, 1e-30) * step
        energy = fresh
    return solution


def _sparse(matrix: Tensor) -> csr_array:
    rows, columns = matrix.indices().numpy()
    values: Array = matrix.values().double().numpy()
    return csr_array((values, (rows, columns)), shape=tuple(matrix.shape))
