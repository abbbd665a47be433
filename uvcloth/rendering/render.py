"""Pictures of bodies and clothes by ray casting with Embree: no display and no graphics driver needed.

A studio: a soft key light over the camera's left shoulder, a bright dome, a floor that fades into the
backdrop. How much of either light reaches a point is measured with rays at the vertices that are seen (and on
a grid of the floor) and interpolated, so the pictures are free of noise and the same on every run.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.geometry.mesh import join_meshes, vertex_normals
from uvcloth.rendering.lighting import (
    DOME,
    FINE,
    FLOOR_REACH,
    KEY,
    Quality,
    VertexLight,
    floor_light,
    normalize,
)

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

RIM = 0.10
"""Strength of the rim light."""

EDGE_CONTRAST = 0.03
"""Difference of neighbouring pixels, of [0, 1], above which they are drawn with more rays."""

FRAMING = 1.06
"""Half the picture over what has to be in it."""


@dataclass(frozen=True)
class Surface:
    """A mesh to draw. vertices: (V, 3) metres, Z up. faces: (F, 3) int64. color: sRGB in [0, 1], one for all
    or one for each vertex (V, 3)."""

    vertices: Tensor
    faces: Tensor
    color: Color | Tensor


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


def three_quarter(
    points: Tensor, turn: float = 30.0, rise: float = 8.0, aspect: float = 0.75, framing: float = FRAMING
) -> Camera:
    """A camera that holds all points (..., 3) with a margin, from in front (-Y) and the body's left.

    turn: degrees around the body, 0 in front, 180 behind. rise: degrees above the horizon. aspect: width of
    the picture over its height. framing: half the picture over what has to be in it.
    """
    points = points.reshape(-1, 3).double()
    right, away, up = _view_axes(turn, rise)
    target = (points.amin(0) + points.amax(0)) / 2
    across, along, down = ((points - target) @ axis for axis in (right, away, up))
    half_height = np.tan(np.radians(Camera.view / 2)) / framing
    reach = torch.maximum(down.abs(), across.abs() / aspect)
    x, y, z = (target + (along + reach / half_height).max() * away).tolist()
    return Camera((x, y, z), tuple(target.tolist()))


def filled_size(
    points: Tensor, size: tuple[int, int], turn: float = 30.0, rise: float = 8.0
) -> tuple[int, int]:
    """Width and height, both even, of a picture of as many pixels as `size` that points (..., 3) m fill.

    turn, rise: of the `three_quarter` camera. It is at most twice as wide as high, or as high as wide.
    """
    points = points.reshape(-1, 3).double()
    right, _, up = _view_axes(turn, rise)
    width, height = (float((points @ axis).max() - (points @ axis).min()) for axis in (right, up))
    aspect = min(max(width / max(height, 1e-9), 0.5), 2.0)
    high = (size[0] * size[1] / aspect) ** 0.5
    return 2 * round(aspect * high / 2), 2 * round(high / 2)


def _view_axes(turn: float, rise: float) -> tuple[Tensor, Tensor, Tensor]:
    """Unit vectors (3,) to the right of a picture, towards its camera, and up; degrees."""
    turned, risen = np.radians(turn), np.radians(rise)
    right = torch.tensor([np.cos(turned), np.sin(turned), 0.0], dtype=torch.float64)
    level = torch.tensor([np.sin(turned), -np.cos(turned), 0.0], dtype=torch.float64)
    away = level * np.cos(risen) + torch.tensor([0.0, 0.0, np.sin(risen)], dtype=torch.float64)
    return right, away, torch.linalg.cross(away, right)


def render(
    surfaces: Sequence[Surface],
    camera: Camera,
    size: tuple[int, int] = (480, 640),
    floor: float = 0.0,
    quality: Quality = FINE,
) -> np.ndarray:
    """Draw one picture, (height, width, 3) uint8 sRGB, of surfaces over a floor at height `floor`.

    size: (width, height) in pixels. Raises InputError if a vertex is not a finite number.
    """
    scene = _build(surfaces, camera, floor, quality)
    width, height = size
    image = _shade(scene, camera, size, *_pixel_centres(width, height)).reshape(height, width, 3)
    rows, columns = np.nonzero(_edges(image))
    x, y = _samples(rows, columns, quality)
    image[rows, columns] = _shade(scene, camera, size, x, y).reshape(*x.shape, 3).mean(1)
    return (_encode(image) * 255.0 + 0.5).astype(np.uint8)


def render_over(
    photograph: np.ndarray,
    surfaces: Sequence[Surface],
    occluders: Sequence[Surface],
    camera: Camera,
    quality: Quality = FINE,
) -> np.ndarray:
    """Draw surfaces into a photograph (height, width, 3) uint8, where no occluder is in front of them.

    The camera is that of the photograph, which shows the occluders already. Raises InputError if a vertex is
    not a finite number.
    """
    from scipy.ndimage import binary_dilation

    size = photograph.shape[1], photograph.shape[0]
    drawn = torch.cat([surface.vertices for surface in surfaces]).numpy()
    scene = _build([*surfaces, *occluders], camera, float(drawn[:, 2].min()), quality)
    faces = sum(len(surface.faces) for surface in surfaces)
    left, right, top, bottom = (
        np.clip(_extent(drawn, camera, size), 0, np.repeat(size, 2)).astype(int).tolist()
    )
    part = _decode(photograph[top : bottom + 1, left : right + 1] / np.float32(255))
    picture = photograph.copy()
    if not part.size:
        return picture

    def shaded(x: np.ndarray, y: np.ndarray, below: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Colours (R, 3) over those of the photograph below, and where a surface is seen (R,)."""
        origins, directions = _rays(camera, size, x + left, y + top)
        hits = scene.embree.run(origins, directions, output=True)
        visible = (hits["primID"] >= 0) & (hits["primID"] < faces)
        colors, (u, v) = below.reshape(-1, 3).copy(), (hits[name][visible] for name in "uv")
        colors[visible] = _shade_mesh(scene, hits["primID"][visible], u, v, directions[visible])
        return colors, visible

    colors, visible = shaded(*_pixel_centres(*part.shape[1::-1]), part)
    image, near = colors.reshape(part.shape), binary_dilation(visible.reshape(part.shape[:2]))
    rows, columns = np.nonzero(_edges(image) & near)
    x, y = _samples(rows, columns, quality)
    below = np.repeat(part[rows, columns][:, None], x.shape[1], axis=1)
    image[rows, columns] = shaded(x, y, below)[0].reshape(below.shape).mean(1)
    cells = picture[top : bottom + 1, left : right + 1]
    cells[near] = (_encode(image[near]) * 255.0 + 0.5).astype(np.uint8)
    return picture


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


def project(points: np.ndarray, camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """Pixel positions x and y of points (V, 3) in a picture (width, height), and their depth, m: (3, V)."""
    eye, axes = _axes(camera)
    right, up, forward = ((points - eye) @ axes.T).T
    scale = np.where(forward > 0, forward, np.nan) * _pixel_width(camera, size[1])
    return np.stack([size[0] / 2 + right / scale, size[1] / 2 - up / scale, forward])


def draw_line(
    picture: np.ndarray, start: Sequence[int], end: Sequence[int], color: tuple[int, int, int]
) -> None:
    """Draw a line between two pixels, row and column, into a picture (h, w, 3) uint8; the rest is cut off."""
    from skimage.draw import line_aa

    rows, columns, opacity = line_aa(*start, *end)  # type: ignore[no-untyped-call]
    inside = (rows >= 0) & (rows < picture.shape[0]) & (columns >= 0) & (columns < picture.shape[1])
    rows, columns, share = rows[inside], columns[inside], opacity[inside, None]
    picture[rows, columns] = (1 - share) * picture[rows, columns] + share * np.array(color)


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

    points, normals, colors: (V, 3). light: of each kind that reaches a vertex. key_direction: unit, towards
    the light. floor_light: (G, G), 1 where the floor is open, around centre (2,).
    """

    embree: Any
    faces: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    light: VertexLight
    key_direction: np.ndarray
    floor: float
    centre: np.ndarray
    floor_light: np.ndarray


def _build(surfaces: Sequence[Surface], camera: Camera, floor: float, quality: Quality) -> _Scene:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    drawn = join_meshes((each.vertices.detach().cpu().float(), each.faces.cpu()) for each in surfaces)
    vertices, faces = drawn.vertices, drawn.faces
    if not torch.isfinite(vertices).all():
        raise InputError("a picture cannot be drawn: a vertex is not a finite number")
    colors = np.concatenate(
        [
            np.broadcast_to(np.asarray(surface.color, np.float32), (len(surface.vertices), 3))
            for surface in surfaces
        ]
    )
    points, normals = vertices.numpy(), vertex_normals(vertices, faces).numpy()
    embree = EmbreeScene()
    TriangleMesh(embree, points, faces.numpy().astype(np.int32))
    to_key = normalize(KEY_DIRECTION @ _camera_ground(camera))
    centre = (points[:, :2].min(0) + points[:, :2].max(0)) / 2
    return _Scene(
        embree=embree,
        faces=faces.numpy(),
        points=points,
        normals=normals,
        colors=_decode(colors),
        light=VertexLight(embree, points, normals, to_key, quality),
        key_direction=to_key,
        floor=floor,
        centre=centre,
        floor_light=floor_light(embree, centre, floor, to_key, quality),
    )


def _camera_ground(camera: Camera) -> np.ndarray:
    """Axes of the camera on the floor: its right, its back along the floor, and up, as rows (3, 3)."""
    back = np.array(camera.eye) - np.array(camera.target)
    back = normalize(np.array([back[0], back[1], 0.0]))
    return np.stack([np.array([-back[1], back[0], 0.0]), back, [0.0, 0.0, 1.0]]).astype(np.float32)


def _shade(scene: _Scene, camera: Camera, size: tuple[int, int], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Linear colours (R, 3) at pixel positions x, y (any shape, R values)."""
    origins, directions = _rays(camera, size, x, y)
    left, right, top, bottom = _extent(scene.points, camera, size)
    # The floor needs no rays, and most of a picture is floor.
    aimed = np.nonzero(((x > left) & (x < right) & (y > top) & (y < bottom)).ravel())[0]
    hits = scene.embree.run(origins[aimed], directions[aimed], output=True)
    nearest = np.full(len(origins), np.inf, np.float32)
    nearest[aimed] = np.where(hits["primID"] >= 0, hits["tfar"], np.inf)
    with np.errstate(divide="ignore"):
        to_floor = (scene.floor - origins[:, 2]) / directions[:, 2]
    on_floor = (to_floor > 0) & (to_floor < nearest)
    on_mesh = np.isfinite(nearest[aimed]) & ~on_floor[aimed]
    colors = np.tile(_decode(BACKDROP_COLOR), (len(origins), 1))
    u, v = hits["u"][on_mesh], hits["v"][on_mesh]
    colors[aimed[on_mesh]] = _shade_mesh(scene, hits["primID"][on_mesh], u, v, directions[aimed[on_mesh]])
    reached = origins[on_floor, :2] + to_floor[on_floor, None] * directions[on_floor, :2]
    colors[on_floor] = _shade_floor(scene, reached)
    return colors


def _shade_mesh(
    scene: _Scene, faces: np.ndarray, u: np.ndarray, v: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    corners = scene.faces[faces]
    weights = np.stack([1 - u - v, u, v], axis=1)

    def interpolated(values: np.ndarray) -> np.ndarray:
        return np.einsum("rc,rc...->r...", weights, values)

    normals = normalize(interpolated(scene.normals[corners]))
    facing = -(normals * directions).sum(1)
    # Shading normals of grazing triangles may point slightly away; only clearly turned ones show the inside.
    inside = facing < -0.15
    normals = np.where(inside[:, None], -normals, normals)
    dome, key = (interpolated(share) for share in scene.light.at(corners, inside))
    lambert = np.clip(normals @ scene.key_direction, 0, 1)
    light = KEY * lambert * key + DOME * dome
    rim = RIM * (1 - np.abs(facing)).clip(0, 1) ** 3 * dome
    return interpolated(scene.colors[corners]) * light[:, None] + rim[:, None]


def _shade_floor(scene: _Scene, points: np.ndarray) -> np.ndarray:
    from scipy.ndimage import map_coordinates

    away = points - scene.centre
    grid = ((away + FLOOR_REACH) / (2 * FLOOR_REACH) * (len(scene.floor_light) - 1)).T[::-1]
    light = map_coordinates(scene.floor_light, grid, order=1, mode="nearest")
    far = np.clip((np.linalg.norm(away, axis=1) - 0.6) / (FLOOR_REACH - 0.6), 0, 1)[:, None]
    far = far * far * (3 - 2 * far)
    return _decode(FLOOR_COLOR) * (1 - far) * light[:, None] + _decode(BACKDROP_COLOR) * far


def _pixel_centres(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
    return columns + 0.5, rows + 0.5


def _axes(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Place of the eye (3,), and the picture's right, up and forward as rows (3, 3)."""
    eye, target = np.array(camera.eye, np.float32), np.array(camera.target, np.float32)
    forward = normalize(target - eye)
    right = normalize(np.array([forward[1], -forward[0], 0.0], np.float32))
    return eye, np.stack([right, np.cross(right, forward), forward])


def _samples(rows: np.ndarray, columns: np.ndarray, quality: Quality) -> tuple[np.ndarray, np.ndarray]:
    """Positions x and y (P, S) spread evenly over each of P pixels."""
    steps = (np.arange(quality.edge_samples) + 0.5) / quality.edge_samples
    dy, dx = (offset.ravel() for offset in np.meshgrid(steps, steps, indexing="ij"))
    return columns[:, None] + dx, rows[:, None] + dy


def _pixel_width(camera: Camera, height: int) -> np.float32:
    """Width of a pixel of a picture, at the distance one."""
    return np.float32(2 * np.tan(np.radians(camera.view / 2)) / height)


def _rays(
    camera: Camera, size: tuple[int, int], x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions (R, 3) through pixel positions x, y (any shape, R values)."""
    eye, (right, up, forward) = _axes(camera)
    scale = _pixel_width(camera, size[1])
    across = ((x - size[0] / 2) * scale).astype(np.float32).ravel()
    down = ((y - size[1] / 2) * scale).astype(np.float32).ravel()
    directions = normalize(forward + across[:, None] * right - down[:, None] * up)
    return np.tile(eye, (len(directions), 1)), directions


def _extent(points: np.ndarray, camera: Camera, size: tuple[int, int]) -> tuple[float, float, float, float]:
    """Pixel positions left, right, top, bottom between which points (V, 3) are seen."""
    x, y, forward = project(points, camera, size)
    if forward.min() <= 1e-3:
        return (-np.inf, np.inf, -np.inf, np.inf)
    return (x.min() - 1, x.max() + 1, y.min() - 1, y.max() + 1)


def _edges(image: np.ndarray) -> np.ndarray:
    """Pixels that differ visibly from a neighbour: (H, W) bool."""
    values = _encode(image)
    edges = np.zeros(values.shape[:2], bool)
    for channel in np.moveaxis(values, 2, 0):
        down = np.abs(np.diff(channel, axis=0)) > EDGE_CONTRAST
        across = np.abs(np.diff(channel, axis=1)) > EDGE_CONTRAST
        edges[1:] |= down
        edges[:-1] |= down
        edges[:, 1:] |= across
        edges[:, :-1] |= across
    return edges


def _decode(srgb: np.ndarray) -> np.ndarray:
    return srgb.astype(np.float32) ** 2.2


def _encode(linear: np.ndarray) -> np.ndarray:
    return np.clip(linear, 0, 1) ** np.float32(1 / 2.2)
