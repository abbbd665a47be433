"""Light of a dome and of a soft key light that reaches points of a scene, measured with shadow rays."""

from dataclasses import dataclass
from typing import Any

import numpy as np

KEY_SPREAD = 0.22
"""Radius of the key light over its distance: how soft its shadows are."""

KEY, DOME, BOUNCE = 0.72, 0.50, 0.35
"""Strengths of the key light, of the dome, and of the dome from below as a share of it."""

FLOOR_REACH = 2.2
"""Metres from the centre of the floor's grid to a side."""

FLOOR_BLUR = 0.066
"""Metres over which the light on the floor's grid is smoothed."""

SHADOW_RAY_START = 1e-3
"""Metres above the surface from where shadow rays start."""

COVERED = 0.02
"""Metres between a point and what lies over it, below which it is covered."""


@dataclass(frozen=True)
class Quality:
    """Numbers of rays: of the dome and of the key light at each point, along a side of the floor's grid, and
    along each side of a pixel on an edge."""

    dome_rays: int
    key_rays: int
    floor_grid: int
    edge_samples: int


FINE = Quality(dome_rays=24, key_rays=8, floor_grid=80, edge_samples=4)
COARSE = Quality(dome_rays=8, key_rays=4, floor_grid=40, edge_samples=2)


class VertexLight:
    """Shares of the dome's and of the key's light on both sides of the vertices, measured when first seen.

    A covered vertex of a face takes the light of the others: skin beside a hem would show the dark of the
    skin below it, as far as its faces reach.
    """

    def __init__(
        self, embree: Any, points: np.ndarray, normals: np.ndarray, to_key: np.ndarray, quality: Quality
    ) -> None:
        self._embree, self._to_key, self._quality = embree, to_key, quality
        self._points, self._normals = np.concatenate([points, points]), np.concatenate([normals, -normals])
        self._known = np.zeros(len(self._points), bool)
        self._covered = np.zeros(len(self._points), bool)
        self._dome, self._key = np.zeros((2, len(self._points)), np.float32)

    def at(self, corners: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shares of the dome and of the key at `corners` (H, 3), vertex indices; inside: (H,) which side."""
        corners = corners + len(self._points) // 2 * inside[:, None]
        visible = np.zeros_like(self._known)
        visible[corners] = True
        fresh = np.nonzero(visible & ~self._known)[0]
        if len(fresh):
            points, normals = self._points[fresh], self._normals[fresh]
            self._dome[fresh], self._key[fresh] = _received(
                self._embree, points, normals, self._to_key, self._quality
            )
            self._covered[fresh] = _are_covered(self._embree, points, normals)
            self._known[fresh] = True
        open_corners = ~self._covered[corners]
        weights = np.where(open_corners.any(1, keepdims=True), open_corners, True).astype(np.float32)
        weights /= weights.sum(1, keepdims=True)

        def filled(light: np.ndarray) -> np.ndarray:
            mean = np.einsum("hc,hc->h", weights, light[corners])[:, None]
            return np.where(weights > 0, light[corners], mean)

        return filled(self._dome), filled(self._key)


def floor_light(
    embree: Any, centre: np.ndarray, floor: float, to_key: np.ndarray, quality: Quality
) -> np.ndarray:
    """Light on a grid of the floor, 1 where nothing shades it: (G, G)."""
    from scipy.ndimage import gaussian_filter

    grid = quality.floor_grid
    steps = np.linspace(-FLOOR_REACH, FLOOR_REACH, grid, dtype=np.float32)
    x, y = np.meshgrid(steps, steps)
    tiles = np.stack([x + centre[0], y + centre[1], np.full_like(x, floor)], -1).reshape(-1, 3)
    up = np.tile(np.array([0, 0, 1], np.float32), (len(tiles), 1))
    dome, key = _received(embree, tiles, up, to_key, quality)
    light = (KEY * to_key[2] * key + DOME * dome) / (KEY * to_key[2] + DOME)
    return gaussian_filter(light.reshape(grid, grid), FLOOR_BLUR / (steps[1] - steps[0]))


def _received(
    embree: Any, points: np.ndarray, normals: np.ndarray, to_key: np.ndarray, quality: Quality
) -> tuple[np.ndarray, np.ndarray]:
    """Shares (P,) of the dome's light (cosine-weighted, dimmer from below) and of the key light."""
    domes, keys = quality.dome_rays, quality.key_rays
    # A normal plus points on the unit sphere is a cosine-weighted hemisphere.
    domewards = normalize(normals[:, None] + 0.999 * sphere(domes))
    keywards = normalize(to_key + KEY_SPREAD * sphere(keys))
    directions = np.concatenate(
        [domewards, np.broadcast_to(keywards, (len(points), keys, 3))], axis=1, dtype=np.float32
    )
    origins = np.repeat(points + SHADOW_RAY_START * normals, domes + keys, axis=0)
    arrives = embree.run(origins, directions.reshape(-1, 3), query="OCCLUDED") < 0
    arrives = arrives.reshape(len(points), -1)
    brightness = np.where(domewards[..., 2] > 0, np.float32(1), np.float32(BOUNCE))
    dome = (arrives[:, :domes] * brightness).mean(1)
    return dome, arrives[:, domes:].mean(1, dtype=np.float32)


def _are_covered(embree: Any, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Mask (P,) of the points over which something lies."""
    hits = embree.run(points + SHADOW_RAY_START * normals, normals, output=True)
    return (hits["primID"] >= 0) & (hits["tfar"] < COVERED)


def normalize(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) of length one; zero stays zero."""
    length = np.sqrt(np.einsum("...c,...c->...", vectors, vectors))
    return vectors / np.maximum(length, 1e-12)[..., None]


def sphere(count: int) -> np.ndarray:
    """Points spread evenly over the unit sphere (a Fibonacci lattice): (count, 3)."""
    index = np.arange(count) + 0.5
    z = 1 - 2 * index / count
    angle = index * np.pi * (1 + np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1).astype(np.float32)
