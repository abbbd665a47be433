"""Pictures of bodies and clothes by ray casting with Embree: no display and no graphics driver needed.

A studio: a soft key light over the camera's left shoulder, a bright dome, a floor that fades into the
backdrop. How much of either light reaches a point is measured with rays at the vertices (and on a grid of the
floor) and interpolated, so the pictures are free of noise and the same on every run.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rasterize.errors import InputError
from uvcloth.geometry.mesh import join_meshes, vertex_normals

Color = tuple[float, float, float]

BODY_COLOR: Color = (0.80, 0.78, 0.76)
GARMENT_COLORS: tuple[Color, ...] = (
    (0.20, 0.47, 0.62),
    (0.79, 0.42, 0.30),
    (0.55, 0.45, 0.68),
    (0.36, 0.56, 0.40),
)

BACKDROP_COLOR = np.array([0.86, 0.87, 0.88], np.float32)
FLOOR_COLOR = np.array([0.74, 0.74, 0.75], np.float32)
KEY_DIRECTION = np.array([-0.55, 0.65, 1.0], np.float32)
"""Towards the key light: left of, behind and above the camera."""

KEY_SPREAD = 0.22
"""Radius of the key light over its distance: how soft its shadows are."""

KEY, DOME, BOUNCE, RIM = 0.72, 0.50, 0.35, 0.10
"""Strengths of the key light, of the dome, of the dome from below as a share of it, and of the rim light."""

INNER_SIDE_SHADE = 0.45
"""Share of the light on the inner side of cloth."""

DOME_RAYS, KEY_RAYS = 24, 8
"""Shadow rays per point."""

FLOOR_GRID, FLOOR_REACH = 80, 2.2
"""Points along a side of the floor's grid, and metres from its centre to a side."""

SHADOW_RAY_START = 1e-3
"""Metres above the surface from where shadow rays start."""

EDGE_CONTRAST = 0.03
"""Difference of neighbouring pixels, of [0, 1], above which they are drawn with more rays."""

EDGE_SAMPLES = 4
"""Rays along each side of such a pixel."""

FRAMING = 1.22
"""Half the picture over what has to be in it."""


@dataclass(frozen=True)
class Surface:
    """A mesh to draw. vertices: (V, 3) metres, Z up. faces: (F, 3) int64. color: sRGB in [0, 1]."""

    vertices: Tensor
    faces: Tensor
    color: Color


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    eye and target: world positions in metres. view: vertical field of view in degrees.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    view: float = 28.0

    def following(self, point: Tensor) -> "Camera":
        """Camera moved so that its view is centred on a point (3,), m."""
        x, y, z = point.tolist()
        right, back, up = (eye - target for eye, target in zip(self.eye, self.target, strict=True))
        return replace(self, eye=(x + right, y + back, z + up), target=(x, y, z))


def three_quarter(points: Tensor, turn: float = 30.0, rise: float = 8.0, aspect: float = 0.75) -> Camera:
    """A camera that holds all points (..., 3) with a margin, from in front (-Y) and the body's left.

    turn: degrees around the body, 0 in front, 180 behind. rise: degrees above the horizon. aspect: width of
    the picture over its height.
    """
    points = points.reshape(-1, 3).double()
    target = (points.amin(0) + points.amax(0)) / 2
    turned, risen = np.radians(turn), np.radians(rise)
    right = torch.tensor([np.cos(turned), np.sin(turned), 0.0], dtype=torch.float64)
    level = torch.tensor([np.sin(turned), -np.cos(turned), 0.0], dtype=torch.float64)
    away = level * np.cos(risen) + torch.tensor([0.0, 0.0, np.sin(risen)], dtype=torch.float64)
    up = torch.linalg.cross(away, right)
    across, along, down = ((points - target) @ axis for axis in (right, away, up))
    half_height = np.tan(np.radians(Camera.view / 2)) / FRAMING
    reach = torch.maximum(down.abs(), across.abs() / aspect)
    x, y, z = (target + (along + reach / half_height).max() * away).tolist()
    return Camera((x, y, z), tuple(target.tolist()))


def render(
    surfaces: Sequence[Surface], camera: Camera, size: tuple[int, int] = (480, 640), floor: float = 0.0
) -> np.ndarray:
    """Draw one picture, (height, width, 3) uint8 sRGB, of surfaces over a floor at height `floor`.

    size: (width, height) in pixels. Raises InputError if a vertex is not a finite number.
    """
    scene = _build(surfaces, camera, floor)
    width, height = size
    image = _shade(scene, *_rays(camera, size, *_pixel_centres(width, height))).reshape(height, width, 3)
    rows, columns = np.nonzero(_edges(image))
    steps = (np.arange(EDGE_SAMPLES) + 0.5) / EDGE_SAMPLES
    dy, dx = (offset.ravel() for offset in np.meshgrid(steps, steps, indexing="ij"))
    fine = _shade(scene, *_rays(camera, size, columns[:, None] + dx, rows[:, None] + dy))
    image[rows, columns] = fine.reshape(len(rows), EDGE_SAMPLES**2, 3).mean(1)
    return (_encode(image) * 255.0 + 0.5).astype(np.uint8)


def render_frames(
    frames: Iterable[Sequence[Surface]],
    camera: Camera | None = None,
    size: tuple[int, int] = (480, 640),
    floor: float = 0.0,
) -> Iterator[np.ndarray]:
    """Yield a picture of each frame: (height, width, 3) uint8.

    Without a camera a three-quarter view is fitted to the first frame and follows its first surface.
    """
    follow = camera is None
    for surfaces in frames:
        body = surfaces[0].vertices
        if camera is None:
            everything = torch.cat([surface.vertices for surface in surfaces])
            camera = three_quarter(everything, aspect=size[0] / size[1])
        if follow:
            camera = camera.following((body.amin(0) + body.amax(0)) / 2)
        yield render(surfaces, camera, size, floor)


def contact_sheet(images: Sequence[np.ndarray], columns: int, gap: int = 6) -> np.ndarray:
    """Arrange equal-sized pictures (h, w, 3) uint8 row by row on one white sheet, `gap` pixels apart."""
    height, width = images[0].shape[:2]
    rows = -(-len(images) // columns)
    sheet = np.full((rows * (height + gap) - gap, columns * (width + gap) - gap, 3), 255, np.uint8)
    for index, image in enumerate(images):
        y, x = (index // columns) * (height + gap), (index % columns) * (width + gap)
        sheet[y : y + height, x : x + width] = image
    return sheet


@dataclass(frozen=True)
class _Scene:
    """Scene for ray casting, in linear light.

    normals, colors: (V, 3). dome, key: share of each light that reaches a vertex (V,).
    key_direction: unit, towards the light. floor_light: (G, G), 1 where the
    floor is open, around centre (2,).
    """

    embree: Any
    faces: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    dome: np.ndarray
    key: np.ndarray
    key_direction: np.ndarray
    floor: float
    centre: np.ndarray
    floor_light: np.ndarray


def _build(surfaces: Sequence[Surface], camera: Camera, floor: float) -> _Scene:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    drawn = join_meshes((each.vertices.detach().cpu().float(), each.faces.cpu()) for each in surfaces)
    vertices, faces = drawn.vertices, drawn.faces
    if not torch.isfinite(vertices).all():
        raise InputError("a picture cannot be drawn: a vertex is not a finite number")
    colors = np.concatenate(
        [np.tile(np.array(surface.color, np.float32), (len(surface.vertices), 1)) for surface in surfaces]
    )
    points, normals = vertices.numpy(), vertex_normals(vertices, faces).numpy()
    embree = EmbreeScene()
    TriangleMesh(embree, points, faces.numpy().astype(np.int32))
    to_key = _normalize(KEY_DIRECTION @ _camera_ground(camera))
    dome, key = _received(embree, points, normals, to_key)
    centre = (points[:, :2].min(0) + points[:, :2].max(0)) / 2
    return _Scene(
        embree=embree,
        faces=faces.numpy(),
        normals=normals,
        colors=_decode(colors),
        dome=dome,
        key=key,
        key_direction=to_key,
        floor=floor,
        centre=centre,
        floor_light=_floor_light(embree, centre, floor, to_key),
    )


def _camera_ground(camera: Camera) -> np.ndarray:
    """Axes of the camera on the floor: its right, its back along the floor, and up, as rows (3, 3)."""
    back = np.array(camera.eye) - np.array(camera.target)
    back = _normalize(np.array([back[0], back[1], 0.0]))
    return np.stack([np.array([-back[1], back[0], 0.0]), back, [0.0, 0.0, 1.0]]).astype(np.float32)


def _floor_light(embree: Any, centre: np.ndarray, floor: float, to_key: np.ndarray) -> np.ndarray:
    """Light on a grid of the floor, 1 where nothing shades it: (FLOOR_GRID, FLOOR_GRID)."""
    from scipy.ndimage import gaussian_filter

    steps = np.linspace(-FLOOR_REACH, FLOOR_REACH, FLOOR_GRID, dtype=np.float32)
    x, y = np.meshgrid(steps, steps)
    tiles = np.stack([x + centre[0], y + centre[1], np.full_like(x, floor)], -1).reshape(-1, 3)
    up = np.tile(np.array([0, 0, 1], np.float32), (len(tiles), 1))
    dome, key = _received(embree, tiles, up, to_key)
    light = (KEY * to_key[2] * key + DOME * dome) / (KEY * to_key[2] + DOME)
    return gaussian_filter(light.reshape(FLOOR_GRID, FLOOR_GRID), 1.2)


def _received(
    embree: Any, points: np.ndarray, normals: np.ndarray, to_key: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Shares (P,) of the dome's light (cosine-weighted, dimmer from below) and of the key light."""
    # A normal plus points on the unit sphere is a cosine-weighted hemisphere.
    domewards = _normalize(normals[:, None] + 0.999 * _sphere(DOME_RAYS))
    keywards = _normalize(to_key + KEY_SPREAD * _sphere(KEY_RAYS))
    directions = np.concatenate(
        [domewards, np.broadcast_to(keywards, (len(points), KEY_RAYS, 3))], axis=1, dtype=np.float32
    )
    origins = np.repeat(points + SHADOW_RAY_START * normals, DOME_RAYS + KEY_RAYS, axis=0)
    arrives = embree.run(origins, directions.reshape(-1, 3), query="OCCLUDED") < 0
    arrives = arrives.reshape(len(points), -1)
    brightness = np.where(domewards[..., 2] > 0, np.float32(1), np.float32(BOUNCE))
    dome = (arrives[:, :DOME_RAYS] * brightness).mean(1)
    return dome, arrives[:, DOME_RAYS:].mean(1, dtype=np.float32)


def _shade(scene: _Scene, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Linear colours (R, 3) along rays (R, 3)."""
    hits = scene.embree.run(origins, directions, output=True)
    with np.errstate(divide="ignore"):
        to_floor = (scene.floor - origins[:, 2]) / directions[:, 2]
    hit = hits["primID"] >= 0
    on_floor = (to_floor > 0) & (~hit | (to_floor < hits["tfar"]))
    on_mesh = hit & ~on_floor
    colors = np.tile(_decode(BACKDROP_COLOR), (len(origins), 1))
    u, v = hits["u"][on_mesh], hits["v"][on_mesh]
    colors[on_mesh] = _shade_mesh(scene, hits["primID"][on_mesh], u, v, directions[on_mesh])
    reached = origins[on_floor, :2] + to_floor[on_floor, None] * directions[on_floor, :2]
    colors[on_floor] = _shade_floor(scene, reached)
    return colors


def _shade_mesh(
    scene: _Scene, faces: np.ndarray, u: np.ndarray, v: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    corners = scene.faces[faces]
    weights = np.stack([1 - u - v, u, v], axis=1)

    def interpolated(values: np.ndarray) -> np.ndarray:
        return np.einsum("rc,rc...->r...", weights, values[corners])

    normals = _normalize(interpolated(scene.normals))
    facing = -(normals * directions).sum(1)
    # Shading normals of grazing triangles may point slightly away; only clearly turned ones show the inside.
    inside = facing < -0.15
    normals = np.where(inside[:, None], -normals, normals)
    lambert = np.clip(normals @ scene.key_direction, 0, 1)
    light = KEY * lambert * interpolated(scene.key) * ~inside + DOME * interpolated(scene.dome)
    light = light * np.where(inside, INNER_SIDE_SHADE, 1.0)
    rim = RIM * (1 - np.abs(facing)).clip(0, 1) ** 3 * interpolated(scene.dome)
    return interpolated(scene.colors) * light[:, None] + rim[:, None]


def _shade_floor(scene: _Scene, points: np.ndarray) -> np.ndarray:
    from scipy.ndimage import map_coordinates

    away = points - scene.centre
    grid = ((away + FLOOR_REACH) / (2 * FLOOR_REACH) * (FLOOR_GRID - 1)).T[::-1]
    light = map_coordinates(scene.floor_light, grid, order=1, mode="nearest")
    far = np.clip((np.linalg.norm(away, axis=1) - 0.6) / (FLOOR_REACH - 0.6), 0, 1)[:, None]
    far = far * far * (3 - 2 * far)
    return _decode(FLOOR_COLOR) * (1 - far) * light[:, None] + _decode(BACKDROP_COLOR) * far


def _pixel_centres(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
    return columns + 0.5, rows + 0.5


def _rays(
    camera: Camera, size: tuple[int, int], x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions (R, 3) through pixel positions x, y (any shape, R values)."""
    eye, target = np.array(camera.eye, np.float32), np.array(camera.target, np.float32)
    forward = _normalize(target - eye)
    right = _normalize(np.array([forward[1], -forward[0], 0.0], np.float32))
    up = np.cross(right, forward)
    scale = np.float32(2 * np.tan(np.radians(camera.view / 2)) / size[1])
    across = ((x - size[0] / 2) * scale).astype(np.float32).ravel()
    down = ((y - size[1] / 2) * scale).astype(np.float32).ravel()
    directions = _normalize(forward + across[:, None] * right - down[:, None] * up)
    return np.tile(eye, (len(directions), 1)), directions


def _edges(image: np.ndarray) -> np.ndarray:
    """Pixels that differ visibly from a neighbour: (H, W) bool."""
    seen = _encode(image)
    edges = np.zeros(seen.shape[:2], bool)
    for channel in np.moveaxis(seen, 2, 0):
        down = np.abs(np.diff(channel, axis=0)) > EDGE_CONTRAST
        across = np.abs(np.diff(channel, axis=1)) > EDGE_CONTRAST
        edges[1:] |= down
        edges[:-1] |= down
        edges[:, 1:] |= across
        edges[:, :-1] |= across
    return edges


def _sphere(count: int) -> np.ndarray:
    """Points spread evenly over the unit sphere (a Fibonacci lattice): (count, 3)."""
    index = np.arange(count) + 0.5
    z = 1 - 2 * index / count
    angle = index * np.pi * (1 + np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1).astype(np.float32)


def _normalize(vectors: np.ndarray) -> np.ndarray:
    length = np.sqrt(np.einsum("...c,...c->...", vectors, vectors))
    return vectors / np.maximum(length, 1e-12)[..., None]


def _decode(srgb: np.ndarray) -> np.ndarray:
    return srgb.astype(np.float32) ** 2.2


def _encode(linear: np.ndarray) -> np.ndarray:
    return np.clip(linear, 0, 1) ** np.float32(1 / 2.2)
