"""Small scenes whose outcome physics knows: sheets and strips that are held, dropped or laid on something."""

import math
from collections.abc import Sequence

import torch
import trimesh
from scipy.spatial import Delaunay
from torch import Tensor

from uvcloth.simulation.engine import Engine, Scene

FPS = 30.0
G = 9.81
RIGID = 1000.0
"""Times heavier than the rest: what is held so hardly moves under what hangs from it."""


def sheet(length: float, width: float, rows: int, columns: int) -> tuple[Tensor, Tensor]:
    """A level sheet, X along its length: vertices (rows * columns, 3) m, faces with alternating diagonals."""
    x, y = torch.meshgrid(torch.linspace(0, length, rows), torch.linspace(0, width, columns), indexing="ij")
    vertices = torch.stack([x, y, torch.zeros_like(x)], -1).reshape(-1, 3)
    a = (torch.arange(rows - 1)[:, None] * columns + torch.arange(columns - 1)).reshape(-1)
    b, c, d = a + columns, a + columns + 1, a + 1
    even = ((a // columns + a % columns) % 2 == 0)[:, None]
    first = torch.where(even, torch.stack([a, b, c], 1), torch.stack([a, b, d], 1))
    second = torch.where(even, torch.stack([a, c, d], 1), torch.stack([b, c, d], 1))
    return vertices, torch.cat([first, second])


def disc(radius: float, rings: int) -> tuple[Tensor, Tensor]:
    """A level disc of even triangles: vertices (1 + 3 rings (rings + 1), 3) m, the rim last; faces."""
    circles = [torch.zeros(1, 2)]
    for ring in range(1, rings + 1):
        angle = 2 * math.pi * torch.arange(6 * ring) / (6 * ring)
        circles.append(radius * ring / rings * torch.stack([angle.cos(), angle.sin()], 1))
    flat = torch.cat(circles)
    faces = torch.from_numpy(Delaunay(flat.numpy()).simplices).long()
    a, b, c = flat[faces].unbind(1)
    upwards = torch.linalg.det(torch.stack([b - a, c - a], 1)) > 0
    return torch.cat([flat, torch.zeros(len(flat), 1)], 1), torch.where(
        upwards[:, None], faces, faces.flip(1)
    )


def scene(
    vertices: Tensor,
    faces: Tensor,
    seconds: float,
    held: Tensor | None = None,
    obstacles: Sequence[trimesh.Trimesh] = (),
    fps: float = FPS,
) -> Scene:
    """Cloth that starts at rest, held at some vertices (N,) bool, among things that stand still."""
    frames, count = round(seconds * fps) + 1, len(vertices)
    held = torch.zeros(count, dtype=torch.bool) if held is None else held
    starts = [0]
    for mesh in obstacles:
        starts.append(starts[-1] + len(mesh.vertices))
    points = [torch.from_numpy(mesh.vertices).float() for mesh in obstacles]
    surface = torch.cat(points) if points else torch.zeros(0, 3)
    parts = [torch.from_numpy(m.faces).long() + s for m, s in zip(obstacles, starts, strict=False)]
    return Scene(
        rest=vertices,
        faces=faces,
        band=held,
        mass_factor=torch.where(held, RIGID, 1.0),
        inner_thickness=torch.zeros(count),
        skinned=vertices.expand(frames, -1, -1),
        collider=surface.expand(frames, -1, -1),
        collider_parts=tuple(parts),
        touches=torch.ones(len(parts), count, dtype=torch.bool),
        fps=fps,
    )


def play(engine: Engine, made: Scene) -> Tensor:
    """The cloth at every frame: (F, N, 3)."""
    return torch.stack([frame.vertices for frame in engine.simulate(made)])


def turned_about_y(points: Tensor, degrees: float) -> Tensor:
    """Points (N, 3), turned so that +X goes down by some degrees."""
    angle = math.radians(degrees)
    turn = torch.tensor(
        [[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]]
    )
    return points @ turn.T


def turning_points(heights: Tensor, fps: float = FPS) -> tuple[tuple[float, float], tuple[float, float]]:
    """First minimum of heights (F,) and the maximum after it, each as (seconds, metres), by parabolas."""
    low = int(torch.nonzero(heights[1:] > heights[:-1])[0])
    high = low + int(torch.nonzero(heights[low + 1 :] < heights[low:-1])[0])
    return _vertex(heights, low, fps), _vertex(heights, high, fps)


def _vertex(heights: Tensor, at: int, fps: float) -> tuple[float, float]:
    before, here, after = (float(heights[at + step]) for step in (-1, 0, 1))
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend else 0.0
    return (at + shift) / fps, here - 0.25 * (before - after) * shift
