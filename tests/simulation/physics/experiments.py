"""What engines make of scenes whose outcome physics knows: one experiment and its figures a function."""

import itertools
import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import torch
import trimesh
from scipy.special import j0
from torch import Tensor

from tests.simulation.physics.scenes import FPS, G, disc, play, scene, sheet, turned_about_y, turning_points
from uvcloth.bodies.body import load_body
from uvcloth.garments.joined import join
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import face_pairs, hinges
from uvcloth.physics.fabric import Fabric
from uvcloth.physics.measures import hinge_angles

LIMP = Fabric(drag=0.0, bend=1e-7)
"""Cloth without air that hardly resists bending."""

ROPE = 2.4048 / 2
"""First zero of the Bessel function J0, halved: a hanging rope's first mode has this times sqrt(g / L)."""

SUPPORT, DISC = 0.09, 0.15
"""Radii of Cusick's drape test, m."""

CHORD = 41.5
"""Degrees below the horizontal, of the line from the edge to the tip, at which Peirce reads the overhang."""


@dataclass(frozen=True)
class Swing:
    """low, high: (s, m) first and second turning point of the rim. motion: (F, N, 3) at fps, and its mesh."""

    low: tuple[float, float]
    high: tuple[float, float]
    motion: Tensor
    rest: Tensor
    faces: Tensor
    fps: float


def swing(engine: Any, seconds: float = 0.8, fps: float = FPS) -> Swing:
    """A sheet of 0.3 m, held along one edge and let go from level."""
    rest, faces = sheet(0.3, 0.3, 12, 12)
    motion = play(engine, scene(rest, faces, seconds, held=rest[:, 0] < 1e-6, fps=fps))
    low, high = turning_points(motion[:, rest[:, 0] > 0.3 - 1e-6, 2].mean(1), fps)
    return Swing(low, high, motion, rest, faces, fps)


def energy(found: Swing, fabric: Fabric) -> Tensor:
    """Height, speed, stretch and bend of the sheet after each frame but first and last: (F - 2,) J/kg.

    Stretch is that of Saint Venant and Kirchhoff, bend that of the hinges, both of the fabric.
    """
    motion, rest, faces = found.motion, found.rest, found.faces
    areas, strain = _strain(motion, rest, faces)
    shear = fabric.stretch / (2.0 * (1.0 + fabric.poisson))
    spread = fabric.stretch * fabric.poisson / (1.0 - fabric.poisson**2)
    trace = strain.diagonal(dim1=-2, dim2=-1).sum(-1)
    stretch = (areas * (shear * strain.square().sum((-2, -1)) + 0.5 * spread * trace.square())).sum(-1)
    bend = (
        0.5 * fabric.bend * (_slenderness(rest, faces) * hinge_angles(motion, hinges(faces)).square()).sum(-1)
    )
    masses = (
        fabric.density
        / 3.0
        * rest.new_zeros(len(rest)).index_add(0, faces.reshape(-1), areas.repeat_interleave(3))
    )
    speed = (motion[2:] - motion[:-2]) * found.fps / 2.0
    carried = (masses * (G * motion[1:-1, :, 2] + 0.5 * speed.square().sum(-1))).sum(-1)
    return (carried + (stretch + bend)[1:-1]) / masses.sum()


def _slenderness(rest: Tensor, faces: Tensor) -> Tensor:
    """Of each hinge (P,) the square of its length over the area of its two faces, at rest."""
    first, second = faces[face_pairs(faces)].unbind(1)
    shared = (first[:, :, None] == second[:, None, :]).any(2)
    start, end = rest[first[shared].reshape(-1, 2)].unbind(1)
    areas, _ = _strain(rest[None], rest, faces)
    return (end - start).square().sum(1) / areas[face_pairs(faces)].sum(1)


def _strain(motion: Tensor, rest: Tensor, faces: Tensor) -> tuple[Tensor, Tensor]:
    """Areas (M,) m2 of a level sheet's faces, and their Green strain (F, M, 2, 2)."""
    flat = torch.stack([rest[faces[:, 1]] - rest[faces[:, 0]], rest[faces[:, 2]] - rest[faces[:, 0]]], -1)[
        :, :2
    ]
    sides = torch.stack(
        [motion[:, faces[:, 1]] - motion[:, faces[:, 0]], motion[:, faces[:, 2]] - motion[:, faces[:, 0]]], -1
    )
    gradient = sides @ torch.linalg.inv(flat)
    strain = 0.5 * (gradient.transpose(-1, -2) @ gradient - torch.eye(2))
    return 0.5 * torch.linalg.det(flat).abs(), strain


def rope_period(engine: Any, length: float = 0.5) -> tuple[float, float]:
    """Period (s) of a hanging strip in a rope's first mode, and what share of the swing is left at 2 s.

    It would pass through the middle again just after that, and tremble there.
    """
    rest, faces = sheet(length, 0.054, 28, 4)
    below = rest[:, 0]
    mode = j0(2 * ROPE * torch.sqrt((length - below) / length).double().numpy())
    hanging = torch.stack([0.03 * torch.from_numpy(mode).float(), rest[:, 1], -below], dim=1)
    made = scene(hanging, faces, 2.0, held=below < 1e-6)
    end = play(replace(engine, fabric=LIMP), made)[:, below > length - 1e-6, 0].mean(1)
    crossed = torch.nonzero(end[1:] * end[:-1] < 0).squeeze(1)
    times = (crossed + end[crossed] / (end[crossed] - end[crossed + 1])) / FPS
    return 2 * float(times[-1] - times[0]) / (len(times) - 1), float(end[-25:].abs().max()) / 0.03


def rope_theory(length: float = 0.5) -> float:
    return 2 * math.pi / (ROPE * math.sqrt(G / length))


def sag(engine: Any, length: float, edge: float = 0.018, seconds: float = 1.0) -> float:
    """By what share of its length a strip of the engine's fabric hangs longer, over the second half."""
    rest, faces = sheet(length, 2 * edge, round(length / edge) + 1, 3)
    hanging = torch.stack([torch.zeros(len(rest)), rest[:, 1], -rest[:, 0]], dim=1)
    moved = play(engine, scene(hanging, faces, seconds, held=rest[:, 0] < 1e-6))
    end = -moved[len(moved) // 2 :, rest[:, 0] > length - 1e-6, 2].mean()
    return float(end) / length - 1.0


def sag_theory(fabric: Fabric, length: float) -> float:
    """The end of a strip of weight w sinks by w L^2 / 2 k."""
    return fabric.density * G * length / (2.0 * fabric.stretch)


def slide(engine: Any, beside: float) -> tuple[float, float]:
    """How far (m) a sheet slides on an incline in the first and in the second half second.

    beside: degrees that the incline is steeper than the angle of the fabric's friction.
    """
    degrees = friction_angle(engine.fabric) + beside
    rest, faces = sheet(0.1, 0.1, 7, 7)
    board = trimesh.creation.box([3.0, 1.0, 0.1]).subdivide().subdivide().subdivide()
    board.apply_translation([0.0, 0.0, -0.05 - 0.004])
    board.vertices = turned_about_y(torch.from_numpy(board.vertices).float(), degrees).numpy()
    moved = play(engine, scene(turned_about_y(rest, degrees), faces, 1.0, obstacles=[board])).mean(1)
    stops = moved[:: round(0.5 * FPS)]
    return tuple((stops[1:] - stops[:-1]).norm(dim=1).tolist())


def slide_theory(fabric: Fabric, beside: float) -> tuple[float, float]:
    angle = math.radians(friction_angle(fabric) + beside)
    pull = max(0.0, G * (math.sin(angle) - fabric.friction * math.cos(angle)))
    return 0.5 * pull * 0.5**2, 0.5 * pull * (1.0**2 - 0.5**2)


def friction_angle(fabric: Fabric) -> float:
    """Degrees."""
    return math.degrees(math.atan(fabric.friction))


def drape(engine: Any, rings: int = 10, seconds: float = 1.5) -> float:
    """Cusick's drape coefficient of the engine's fabric in air thick enough that it comes to rest.

    Share of the ring outside of the support that the shadow of the disc covers. The disc is clamped over its
    support, as in the apparatus (a ring of the mesh lies on its edge only if their number is a multiple of
    five), and starts uneven by 0.2 mm, or it could not choose its folds.
    """
    rest, faces = disc(DISC, rings)
    held = rest.norm(dim=1) < SUPPORT + 1e-4
    uneven = 2e-4 * torch.randn(len(rest), generator=torch.Generator().manual_seed(0))
    rest[:, 2] = torch.where(held, 0.0, uneven)
    thick = replace(engine, fabric=replace(engine.fabric, drag=20.0))
    moved = play(thick, scene(rest, faces, seconds, held=held))
    x, y = moved[-10:, -6 * rings :, :2].mean(0).unbind(-1)
    shadow = 0.5 * float((x * y.roll(-1) - y * x.roll(-1)).sum())
    return (shadow - math.pi * SUPPORT**2) / (math.pi * (DISC**2 - SUPPORT**2))


def bending_length(fabric: Fabric) -> float:
    """Peirce's bending length (m): the cube root of rigidity over weight per area."""
    return (fabric.bend / (fabric.density * G)) ** (1.0 / 3.0)


def cantilever(engine: Any, edges: int = 8, seconds: float = 2.0) -> tuple[float, float]:
    """Bending length (m) as Peirce reads it off an overhanging strip, and the angle of its chord, degrees.

    The strip overhangs by twice the fabric's bending length, where the chord should be CHORD below the
    horizontal. The overhang begins half an edge behind the last vertex that is held: from there on it bends.
    """
    length = 2.0 * bending_length(engine.fabric)
    edge = length / (edges + 0.5)
    rest, faces = sheet(edge * (edges + 3), 2 * edge, edges + 4, 3)
    held = rest[:, 0] < 3.5 * edge
    thick = replace(engine, fabric=replace(engine.fabric, drag=20.0))
    moved = play(thick, scene(rest, faces, seconds, held=held))
    tip = moved[-10:, rest[:, 0] > rest[:, 0].max() - 1e-6].mean((0, 1))
    angle = math.atan2(-float(tip[2]), float(tip[0]) - 2.5 * edge)
    return length * (math.cos(angle / 2.0) / (8.0 * math.tan(angle))) ** (1.0 / 3.0), math.degrees(angle)


@dataclass(frozen=True)
class Hem:
    """Swing of a skirt's hem after a stop.

    periods: (s), from each crossing of the middle to the next but one. extremes: (m), of each half swing.
    motion: (F, N, 3) m.
    """

    periods: tuple[float, ...]
    extremes: tuple[float, ...]
    motion: Tensor


STOP = 1.4
"""Seconds after which the waist of `skirt_swing` stands still."""


def skirt_swing(engine: Any, seconds: float = 4.5) -> Hem:
    """Skirt of the dress, its waist held, carried sideways at 1 m/s and stopped, with no body in it."""
    rest, faces = dress_skirt()
    time = torch.arange(round(seconds * FPS) + 1) / FPS
    speed = _smooth((time - 0.6) / 0.3) - _smooth((time - (STOP - 0.1)) / 0.1)
    way = torch.cumsum(speed, 0) / FPS
    held = scene(rest, faces, seconds, held=rest[:, 2] > rest[:, 2].max() - 0.07)
    held = replace(held, mass_factor=torch.where(held.band, 30.0, 1.0))
    carried = torch.stack([way, torch.zeros_like(way), torch.zeros_like(way)], 1)
    motion = play(engine, replace(held, skinned=held.skinned + carried[:, None]))
    hem = rest[:, 2] < rest[:, 2].quantile(0.06)
    swing = (motion[:, hem, 0] - rest[hem, 0]).mean(1) - way
    swing = swing[round((STOP + 0.05) * FPS) :]
    swing = swing - swing[-round(FPS) :].median()
    crossed = torch.nonzero(swing[1:] * swing[:-1] < 0).squeeze(1)
    times = (crossed + swing[crossed] / (swing[crossed] - swing[crossed + 1])) / FPS
    halves = [swing[a + 1 : b + 1] for a, b in itertools.pairwise(crossed.tolist())]
    return Hem(
        tuple((times[2:] - times[:-2]).tolist()),
        tuple(float(half[half.abs().argmax()]) for half in halves),
        motion,
    )


@cache
def dress_skirt() -> tuple[Tensor, Tensor]:
    """The dress that ships from a hand's breadth over its waist down: vertices (N, 3) m, faces."""
    cloth = join(fit_template("dress", load_body()), load_body())
    vertices = cloth.garment.mesh.vertices[cloth.kept]
    below = vertices[:, 2] < _waist(vertices) + 0.06
    used, faces = cloth.faces[below[cloth.faces].all(1)].unique(return_inverse=True)
    return vertices[used], faces


def _waist(vertices: Tensor) -> float:
    """Height at which a dress is narrowest from side to side."""
    low, high = vertices[:, 2].aminmax()
    heights = torch.linspace(float(low) + 0.3, float(high) - 0.25, 40)
    widths = [vertices[(vertices[:, 2] - height).abs() < 0.02, 0] for height in heights]
    return float(heights[torch.stack([x.max() - x.min() for x in widths]).argmin()])


def _smooth(share: Tensor) -> Tensor:
    share = share.clamp(0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)
