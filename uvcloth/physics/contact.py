"""Body contact: closest points on the posed body, and moving a garment out of it without tearing.

A posed body intersects itself (a forearm in the belly, an arm in the ribs). There the outer side of its skin
lies within another part of it, and pushing cloth out of the skin leads nowhere. For a closed surface the
winding number tells how many times a point is inside, so such skin is where the winding number just outside
is positive. It is found on patches of the body, and cloth whose closest skin belongs to such a patch, or to
one beside it, is left calm and counted apart.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import torch
import warp as wp
from torch import Tensor

from uvcloth.mesh import face_pairs, neighbour_average, weld
from uvcloth.physics import kernels

wp.config.log_level = wp.LOG_WARNING

MARGIN = 0.002
"""Metres that contact keeps between cloth and skin."""

REACH = 0.2
"""Metres within which the closest surface point is sought; deeper than any body part is thick."""

ROUNDS = 4
"""Times that a garment is moved out of the body, by less from time to time."""

SPREAD_PASSES = 10
"""Neighbour averages that spread a correction: it fades within about the square root of that many rings."""

PATCH = 0.03
"""Metres across one patch of skin; one ray tells whether a patch is swallowed by the body."""

LEAST_SHARE = 500
"""Queries that are worth a thread of their own."""


@cache
def _workers() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(thread_name_prefix="contact")


@dataclass(frozen=True)
class SurfacePoints:
    """Closest points on a body surface for N points.

    signed_distance: (N,) metres, negative inside the closest sheet; the reach where nothing is closer.
    points, normals: (N, 3) the closest point and the direction in which the signed distance grows.
    faces: (N,) int64, -1 where nothing is within reach. barycentrics: (N, 3).
    """

    signed_distance: Tensor
    points: Tensor
    normals: Tensor
    faces: Tensor
    barycentrics: Tensor


@dataclass(frozen=True)
class _Patches:
    """of_face: (F,) patch of each face. samples: (P,) one face of each. neighbours: (E, 2)."""

    of_face: Tensor
    samples: Tensor
    neighbours: Tensor


def _patches(vertices: Tensor, faces: Tensor) -> _Patches:
    cells = torch.floor(vertices[faces].mean(1) / PATCH)
    _, of_face = torch.unique(cells, dim=0, return_inverse=True)
    order = torch.arange(len(faces), device=faces.device)
    first = torch.full_like(order, len(faces))[: int(of_face.max()) + 1]
    first = first.scatter_reduce(0, of_face, order, "amin")
    beside = of_face[face_pairs(faces.cpu()).to(faces.device)]
    neighbours = torch.unique(beside[beside[:, 0] != beside[:, 1]], dim=0)
    return _Patches(of_face, first, neighbours)


class BodySurface:
    """A closed triangle mesh that moves: one tree per topology, refitted for every frame.

    vertices: (V, 3) metres at rest, faces: (F, 3); everything runs on the device of `vertices`.
    """

    def __init__(self, vertices: Tensor, faces: Tensor) -> None:
        wp.init()
        wp.load_module(kernels, device=str(vertices.device))
        self.device = vertices.device
        self._points = vertices.detach().to(torch.float32).contiguous().clone()
        self._faces = faces.to(device=self.device, dtype=torch.int32).reshape(-1).contiguous()
        self._rest = vertices.detach(), faces
        self._swallowed: Tensor | None = None
        with self._stream():
            points: Any = wp.from_torch(self._points, dtype=wp.vec3)
            indices: Any = wp.from_torch(self._faces, dtype=wp.int32)
            self._mesh = wp.Mesh(points, indices)

    def update(self, vertices: Tensor) -> None:
        """Move the surface to new vertex positions (V, 3)."""
        self._points.copy_(vertices.detach())
        self._swallowed = None
        with self._stream():
            self._mesh.refit()

    def closest(self, points: Tensor, max_distance: float = REACH) -> SurfacePoints:
        """The closest surface point of each of N points (N, 3), signed by the closest sheet."""
        points = self._input(points)
        count = len(points)
        distance = points.new_empty(count)
        closest, normal, barycentrics = (torch.zeros_like(points) for _ in range(3))
        face = torch.empty(count, dtype=torch.int32, device=self.device)
        outputs = (distance, closest, normal, face, barycentrics)
        self._launch(kernels.closest_point, count, [points, max_distance], outputs)
        return SurfacePoints(distance, closest, normal, face.long(), barycentrics)

    def winding(self, points: Tensor, directions: Tensor) -> Tensor:
        """How many times each of N points (N, 3) is inside: (N,) int64, 2 or more where parts overlap.

        Counts the signed crossings of a ray along `directions` (N, 3), which may point anywhere.
        """
        points, directions = self._input(points), self._input(directions)
        winding = torch.empty(len(points), dtype=torch.int32, device=self.device)
        self._launch(kernels.winding_number, len(points), [points, directions], (winding,))
        return winding.long()

    def corners(self, faces: Tensor) -> Tensor:
        """The corners of some of the faces (N,) where they are now: (N, 3, 3)."""
        return self._points[self._faces.view(-1, 3)[faces].long()]

    @cached_property
    def _patches(self) -> _Patches:
        return _patches(*self._rest)

    def swallowed(self) -> Tensor:
        """Faces (F,) bool at which the posed body intersects itself, a patch wide around; kept per frame."""
        if self._swallowed is None:
            patches = self._patches
            corners = self.corners(patches.samples)
            normals = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            normals = torch.nn.functional.normalize(normals, dim=1)
            inside = self.winding(corners.mean(1) + 1e-4 * normals, normals) > 0
            beside = patches.neighbours[inside[patches.neighbours].any(1)]
            self._swallowed = inside.index_fill(0, beside.reshape(-1), True)[patches.of_face]
        return self._swallowed

    def _input(self, values: Tensor) -> Tensor:
        return values.detach().to(device=self.device, dtype=torch.float32).contiguous()

    def _launch(
        self, kernel: wp.Kernel, count: int, inputs: list[Tensor | float], outputs: tuple[Tensor, ...]
    ) -> None:
        def launch(start: int, end: int) -> None:
            def array(value: Tensor | float) -> Any:
                if isinstance(value, Tensor):
                    return wp.from_torch(value[start:end], dtype=wp.vec3 if value.ndim == 2 else None)
                return value

            arguments = [self._mesh.id, *map(array, inputs), *map(array, outputs)]
            wp.launch(kernel, dim=end - start, inputs=arguments, device=self._mesh.device)

        if self.device.type == "cuda":
            with self._stream():
                launch(0, count)
            return
        # Warp runs a CPU kernel on one core and without the interpreter's lock: share it out.
        parts = max(1, min(torch.get_num_threads(), count // LEAST_SHARE))
        bounds = [count * part // parts for part in range(parts + 1)]
        list(_workers().map(launch, bounds[:-1], bounds[1:]))

    def _stream(self) -> wp.ScopedStream:
        stream = wp.stream_from_torch(self.device) if self.device.type == "cuda" else None
        return wp.ScopedStream(stream)


class Smoother:
    """Neighbour averages over a garment mesh, with vertices at the same place (UV seams) taken as one.

    vertices: (N, 3) at rest. faces: (M, 3).
    """

    def __init__(self, vertices: Tensor, faces: Tensor) -> None:
        self.owner = weld(vertices)
        self.has_seams = bool((self.owner != torch.arange(len(vertices), device=vertices.device)).any())
        average = neighbour_average(self.owner.cpu()[faces.cpu()], len(vertices))
        self.average = average.to_sparse_csr().to(vertices.device)

    def spread(self, need: Tensor, normals: Tensor) -> Tensor:
        """A smooth displacement (N, 3) that moves every vertex by at least `need` (N,) along its normal."""
        pushed = torch.nonzero(need > 0).squeeze(1)
        along, least = normals[pushed], need[pushed]
        moved = torch.zeros_like(normals).index_copy_(0, pushed, least[:, None] * along)
        for _ in range(SPREAD_PASSES):
            moved = self._neighbours(moved)
            lacking = (least - (moved[pushed] * along).sum(1)).clamp_(min=0)
            moved.index_add_(0, pushed, lacking[:, None] * along)
        return moved

    def _neighbours(self, values: Tensor) -> Tensor:
        averaged = self.average @ values
        return averaged[self.owner] if self.has_seams else averaged


@dataclass(frozen=True)
class Contacts:
    """What resolving did. Counts are vertices outside self-intersections of the body, but for in_conflict.

    inside_before, inside_after: vertices inside the body. in_conflict: vertices left calm because the body
    intersects itself there. deepest: metres that the deepest vertex is inside afterwards (0 if none).
    """

    inside_before: int
    inside_after: int
    in_conflict: int
    deepest: float


def calm_vertices(found: SurfacePoints, surface: BodySurface) -> Tensor:
    """Which garment vertices (N,) bool, given their closest points, are where the body intersects itself."""
    return surface.swallowed()[found.faces] & (found.faces >= 0)


def resolve(vertices: Tensor, surface: BodySurface, smoother: Smoother) -> tuple[Tensor, Contacts]:
    """Move garment vertices (N, 3) that are inside the body, or nearer than MARGIN, out to the margin.

    Each moves along the normal of its closest surface point, and the correction is spread smoothly over its
    neighbours, so that edges do not tear. The last round moves single vertices only. The margin is halved
    from round to round, so that cloth in a gap narrower than it comes to rest.
    """
    found = surface.closest(vertices)
    calm = calm_vertices(found, surface)
    distance, normals = found.signed_distance, found.normals
    inside_before = int(((distance < 0) & ~calm).sum())
    for turn in range(ROUNDS):
        need = torch.where(calm, 0.0, MARGIN * 0.5**turn - distance).clamp(min=0)
        if not bool(need.any()):
            break
        last = turn == ROUNDS - 1
        move = need[:, None] * normals if last else smoother.spread(need, normals)
        vertices = vertices + move
        # A move of length l changes the distance by at most l: only vertices that could have come too near
        # are looked up again, the others keep a lower bound.
        distance = distance - move.norm(dim=1)
        near = torch.nonzero(distance < MARGIN).squeeze(1)
        again = surface.closest(vertices[near])
        distance = distance.index_copy(0, near, again.signed_distance)
        normals = normals.index_copy(0, near, again.normals)
        calm = calm.index_copy(0, near, calm_vertices(again, surface))
    depth = torch.where(calm, 0.0, -distance).clamp(min=0)
    contacts = Contacts(inside_before, int((depth > 0).sum()), int(calm.sum()), float(depth.max()))
    return vertices, contacts


def inside_share(vertices: Tensor, surface: BodySurface) -> tuple[float, float]:
    """Percentages of garment vertices (N, 3) inside the body: all, and without its self-intersections."""
    inside, found = inside_vertices(vertices, surface)
    outside_conflict = inside & ~calm_vertices(found, surface)
    return 100.0 * float(inside.float().mean()), 100.0 * float(outside_conflict.float().mean())


def inside_vertices(vertices: Tensor, surface: BodySurface) -> tuple[Tensor, SurfacePoints]:
    """Which garment vertices (N, 3) have a positive winding number, (N,) bool, and their closest points."""
    found = surface.closest(vertices)
    anywhere = vertices.new_tensor([0.36, 0.48, 0.8])
    winding = surface.winding(vertices, torch.where(found.faces[:, None] < 0, anywhere, found.normals))
    return winding > 0, found
