"""Garments that have wrinkles: copies of the artist's objects with every edge halved, which go live.

Materials, texture coordinates, vertex groups and modifiers come along. The objects themselves stay as they
are, hidden, and are what is fitted, checked and dressed again.
"""

from typing import Any

import bmesh
import bpy
import numpy as np
from numpy.typing import NDArray

from . import surface
from .copies import copy_beside

Ints = NDArray[np.int64]


def shown(entry: Any) -> Any:
    """The object that shows a garment live: its finer copy, or itself."""
    return entry.finer or entry.part


def edges_of(mesh: Any) -> Ints:
    """Edges (E, 2) of a mesh: their vertices."""
    edges = np.empty(2 * len(mesh.edges), np.int32)
    mesh.edges.foreach_get("vertices", edges)
    return edges.reshape(-1, 2).astype(np.int64)


def ends_of_middles(edges: Ints, count: int, size: int) -> Ints | None:
    """The two vertices (M, 2) that each of the last M of `size` vertices is between, of the first `count`.

    edges: (E, 2) after every edge was halved. None where they are none of that kind.
    """
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    halves = edges[(edges[:, 0] < count) & (edges[:, 1] >= count)]
    halves = halves[np.argsort(halves[:, 1], kind="stable")]
    is_halved = size > count and np.array_equal(halves[:, 1], np.repeat(np.arange(count, size), 2))
    return halves[:, 0].reshape(-1, 2) if is_halved else None


def made(part: Any, ends: Ints) -> Any:
    """A finer copy of a garment's object, on which the runtime's vertices are noted.

    ends: (M, 2), see `ends_of_middles`, of the runtime. Raises ValueError, and leaves nothing, if the mesh is
    cut into other triangles.
    """
    count = len(part.data.vertices)
    copy = copy_beside(part, f"{part.name} wrinkles")
    _halve_edges(copy.data)
    drawn = ends_of_middles(edges_of(copy.data), count, len(copy.data.vertices))
    keys, wanted = ends @ [count, 1], np.zeros(0, np.int64) if drawn is None else drawn @ [count, 1]
    order = np.argsort(keys)
    if not np.array_equal(keys[order], np.sort(wanted)):
        remove(copy)
        raise ValueError(f"{part.name} was cut into other triangles when it was baked: triangulate it first")
    middles = count + order[np.searchsorted(keys[order], wanted)]
    surface.put_source(copy.data, np.concatenate([np.arange(count), middles]))
    return copy


def remove(copy: Any) -> None:
    """Remove a finer copy."""
    bpy.data.meshes.remove(copy.data)  # Its object goes with it.


def show(entry: Any, copy: Any) -> None:
    """Show a garment by its finer copy, and hide it."""
    entry.finer = copy
    entry.part.hide_set(True)
    entry.part.hide_render = True


def drop(context: Any, entry: Any) -> None:
    """Remove the finer copy of a garment, if there is one, and show the garment itself again."""
    if entry.finer is None:
        return
    copy, entry.finer = entry.finer, None
    remove(copy)
    if entry.part is not None:
        entry.part.hide_render = False
        if entry.part.name in context.view_layer.objects:
            entry.part.hide_set(False)


def _halve_edges(mesh: Any) -> None:
    """Cut faces into triangles, and each of these into four; all that lies on the mesh is interpolated."""
    work = bmesh.new()
    work.from_mesh(mesh)
    bmesh.ops.triangulate(work, faces=work.faces, quad_method="FIXED")
    bmesh.ops.subdivide_edges(work, edges=work.edges, cuts=1)
    work.to_mesh(mesh)
    work.free()
