"""The smallest outfit that has all that a baked one has: a tube of cloth over two balls, on two joints."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray

from tests.physics.cloth.stepping import solver
from uvcloth.physics.fabric import Fabric
from uvcloth.player.sections import pack

ROWS, AROUND = 5, 10
RADIUS, REACH = 0.1, 0.02


def tube() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (ROWS AROUND, 3) m and faces of the cloth, hem to hem."""
    angle = np.linspace(0.0, 2 * np.pi, AROUND, endpoint=False)
    ring = 1.25 * RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
    heights = np.linspace(0.15, -0.15, ROWS)
    rest = np.concatenate([np.column_stack([ring, np.full(AROUND, height)]) for height in heights])
    row, column = map(np.ravel, np.mgrid[: ROWS - 1, :AROUND])
    a, b = AROUND * row + column, AROUND * row + (column + 1) % AROUND
    return rest, np.concatenate(
        [np.column_stack([a, a + AROUND, b]), np.column_stack([b, a + AROUND, b + AROUND])]
    )


def small_outfit() -> bytes:
    """The outfit, as `uvcloth.player.outfit.Outfit` reads it."""
    rest, faces = tube()
    balls = [trimesh.creation.icosphere(subdivisions=1, radius=RADIUS) for _ in range(2)]
    for ball, height in zip(balls, (0.102, -0.102), strict=True):
        ball.apply_translation([0.0, 0.0, height])
    body = trimesh.util.concatenate(balls)
    count, size = len(body.vertices), len(rest)
    held = torch.arange(size) < AROUND
    made = solver(torch.from_numpy(rest), torch.from_numpy(faces), Fabric(), held, balls)
    around = [sorted(ring) for ring in body.vertex_neighbors]
    rim = np.array(
        [[face[(k + 1) % 3], face[(k + 2) % 3]] for face in body.faces for k in range(3) if not face[k]]
    )
    nothing = np.zeros(0, np.int64)
    return pack(
        {
            "outfit.size": np.array([1.0]),
            "outfit.used": np.arange(count),
            "outfit.hold": 20.0 * held.numpy(),
            "outfit.shown_starts": np.array([0, size]),
            "outfit.shown": np.arange(size),
            "settings.needed": np.array([max(1.0 / (0.8 * made.stable_step), 30.0)]),
            "settings.radius": np.array([0.002]),
            "settings.self_radius": np.array([0.002]),
            "settings.self_margin": np.array([0.004]),
            "settings.reach": np.array([REACH]),
            "settings.interval": np.array([1 / 60]),
            "settings.renewal": np.array([4.0]),
            "settings.hinge_interval": np.array([1.0]),
            "skeleton.parents": np.array([-1, 0]),
            "skeleton.heads": np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.0]]),
            "caps.tips": np.array([count]),
            "caps.rim_starts": np.array([0, len(rim)]),
            "caps.rims": rim,
            **_skin("body", np.asarray(body.vertices)),
            **_skin("cages", rest),
            **_skin("points", rest),
            "follow.starts": np.arange(size + 1),
            "follow.cage": np.arange(size),
            "follow.weights": np.ones(size),
            **_opening(body, around, rim),
            "fine.rest": rest,
            "fine.faces": faces,
            "fine.touches": np.full(size, 3),
            "fine.thickness": np.zeros(size),
            "skin.rest": np.asarray(body.vertices),
            "skin.faces": np.asarray(body.faces),
            "garments.starts": np.array([0, size]),
            "layers.outer": nothing,
            "layers.inner": nothing,
            "layers.touches": np.full(size, 3),
            "covered.corners": body.faces[:3],
            "covered.weights": np.full((3, 3), 1 / 3),
            **made.cloth.sections(),
            **made.body.sections(),
        }
    )


def small_motion(frames: int = 12) -> NDArray[np.float64]:
    """Transforms (F, 2, 3, 4) from rest: both joints rise, the second turns about its head."""
    made = np.tile(np.eye(3, 4), (frames, 2, 1, 1))
    angle = 0.06 * np.arange(frames)
    made[:, 1, 1:, 1] = np.column_stack([np.cos(angle), np.sin(angle)])
    made[:, 1, 1:, 2] = np.column_stack([-np.sin(angle), np.cos(angle)])
    made[:, :, 2, 3] = 0.01 * np.arange(frames)[:, None]
    return made


def _skin(name: str, vertices: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Vertices (V, 3) m that follow both joints, the lower ones the second."""
    share = np.clip(0.5 - 5.0 * vertices[:, 2], 0.0, 1.0)
    return {
        f"{name}.rest": vertices,
        f"{name}.starts": 2 * np.arange(len(vertices) + 1),
        f"{name}.joints": np.tile([0, 1], len(vertices)),
        f"{name}.weights": np.column_stack([1.0 - share, share]).ravel(),
    }


def _opening(body: trimesh.Trimesh, around: list[list[int]], rim: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """The balls pushed apart, where a pose presses them into each other."""
    count, half = len(body.vertices), len(body.vertices) // 2
    rings = [
        [np.roll(face, -k)[1:] for face in body.faces for k in range(3) if face[k] == v] for v in range(count)
    ]
    spread = [[vertex, *ring] for vertex, ring in enumerate(around)]
    total = count + 1
    return {
        "opening.starts": np.array([0, half, count]),
        "opening.points": np.arange(count),
        "opening.want": np.full(count, 0.003),
        "opening.core": np.full(count, 1e-4),
        "opening.slope": np.array([0.5]),
        "opening.allowed": np.full((2, total), 0.02),
        "opening.ring_starts": np.cumsum([0, *map(len, rings), 0]),
        "opening.rings": np.concatenate(rings),
        "opening.spread_starts": np.cumsum([0, *map(len, spread), 0]),
        "opening.spread_vertices": np.concatenate(spread),
        "opening.spread_lengths": np.concatenate([0.05 * (np.arange(len(each)) > 0) for each in spread]),
        "opening.tips": np.array([count]),
        "opening.rim_starts": np.array([0, len(rim)]),
        "opening.rims": rim[:, 0],
    }


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(small_outfit())
