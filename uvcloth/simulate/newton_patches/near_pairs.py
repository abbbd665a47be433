# mypy: ignore-errors
"""Self-contact of the pairs that are near enough to matter; all others are skipped.

Stand-ins for functions of SolverVBD that take the same arguments and give the same results. Cloth meets
itself in few places, but each vertex has some faces and each edge some edges of its own neighbourhood within
the distance in which self-contact is watched, and the solver looks at all of them for every color of every
iteration. The gap of two shapes along any axis is a lower bound of their distance; the axis between their
middles gives one that is cheap and mostly sufficient.
"""

import warp as wp
from newton._src.solvers.vbd import particle_vbd_kernels

wp.set_module_options({"enable_backward": False})

SHARE = wp.constant(0.9)
"""Share of the gap that a pair may close unhindered: the solver's plane leaves each side at least 0.05."""

SLACK = wp.constant(2.0e-5)
"""m that rounding may be wrong by."""

edge_edge_plane = particle_vbd_kernels.create_edge_edge_division_plane_closest_pt
vertex_triangle_plane = particle_vbd_kernels.create_vertex_triangle_division_plane_closest_pt
edge_edge_contact = particle_vbd_kernels.evaluate_edge_edge_contact_2_vertices
vertex_triangle_contact = particle_vbd_kernels.evaluate_vertex_triangle_collision_force_hessian_4_vertices


@wp.func
def edges_gap(a_0: wp.vec3, a_1: wp.vec3, b_0: wp.vec3, b_1: wp.vec3):
    """Metres between two edges, seen along the axis between their middles; negative where they overlap."""
    axis = a_0 + a_1 - b_0 - b_1
    side = wp.min(wp.dot(axis, a_0 - b_0), wp.dot(axis, a_1 - b_0))
    return (side - wp.max(wp.dot(axis, b_1 - b_0), 0.0)) / wp.length(axis)


@wp.func
def vertex_triangle_gap(v: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """The same for a vertex and a triangle."""
    axis = v - (a + b + c) / 3.0
    side = wp.max(wp.dot(axis, a - v), wp.max(wp.dot(axis, b - v), wp.dot(axis, c - v)))
    return -side / wp.length(axis)


@wp.func
def near_edge_edge_plane(
    a_0: wp.vec3,
    moved_a_0: wp.vec3,
    a_1: wp.vec3,
    moved_a_1: wp.vec3,
    b_0: wp.vec3,
    moved_b_0: wp.vec3,
    b_1: wp.vec3,
    moved_b_1: wp.vec3,
):
    """Plane that keeps two edges apart; none where both together move less than their gap."""
    travel = wp.max(wp.length(moved_a_0), wp.length(moved_a_1))
    travel += wp.max(wp.length(moved_b_0), wp.length(moved_b_1))
    if travel < SHARE * edges_gap(a_0, a_1, b_0, b_1) - SLACK:
        return False, wp.vec3(0.0), a_0, 0.0
    return edge_edge_plane(a_0, moved_a_0, a_1, moved_a_1, b_0, moved_b_0, b_1, moved_b_1)


@wp.func
def near_vertex_triangle_plane(
    v: wp.vec3,
    moved_v: wp.vec3,
    a: wp.vec3,
    moved_a: wp.vec3,
    b: wp.vec3,
    moved_b: wp.vec3,
    c: wp.vec3,
    moved_c: wp.vec3,
):
    """Plane that keeps a vertex and a triangle apart; none where both together move less than their gap."""
    travel = wp.max(wp.length(moved_a), wp.max(wp.length(moved_b), wp.length(moved_c)))
    travel += wp.length(moved_v)
    if travel < SHARE * vertex_triangle_gap(v, a, b, c) - SLACK:
        return False, wp.vec3(0.0), v, 0.0
    return vertex_triangle_plane(v, moved_v, a, moved_a, b, moved_b, c, moved_c)


@wp.func
def near_edge_edge_contact(
    first: int,
    second: int,
    pos: wp.array[wp.vec3],
    pos_anchor: wp.array[wp.vec3],
    edge_indices: wp.array2d[wp.int32],
    radius: float,
    stiffness: float,
    damping: float,
    friction: float,
    friction_epsilon: float,
    dt: float,
    parallel_epsilon: float,
):
    """Forces (N) and Hessians (N/m) of two edges on the ends of the first; none outside the radius (m)."""
    a_0 = pos[edge_indices[first, 2]]
    a_1 = pos[edge_indices[first, 3]]
    b_0 = pos[edge_indices[second, 2]]
    b_1 = pos[edge_indices[second, 3]]
    if edges_gap(a_0, a_1, b_0, b_1) > radius + SLACK:
        return False, wp.vec3(0.0), wp.vec3(0.0), wp.mat33(0.0), wp.mat33(0.0)
    return edge_edge_contact(
        first, second, pos, pos_anchor, edge_indices, radius, stiffness, damping, friction, friction_epsilon,
        dt, parallel_epsilon,
    )  # fmt: skip


@wp.func
def near_vertex_triangle_contact(
    v: int,
    triangle: int,
    pos: wp.array[wp.vec3],
    pos_anchor: wp.array[wp.vec3],
    tri_indices: wp.array2d[wp.int32],
    radius: float,
    stiffness: float,
    damping: float,
    friction: float,
    friction_epsilon: float,
    dt: float,
):
    """Forces (N) and Hessians (N/m) on the corners and the vertex; none outside the radius (m)."""
    a = pos[tri_indices[triangle, 0]]
    b = pos[tri_indices[triangle, 1]]
    c = pos[tri_indices[triangle, 2]]
    if vertex_triangle_gap(pos[v], a, b, c) > radius + SLACK:
        none, flat = wp.vec3(0.0), wp.mat33(0.0)
        return False, none, none, none, none, flat, flat, flat, flat
    return vertex_triangle_contact(
        v, triangle, pos, pos_anchor, tri_indices, radius, stiffness, damping, friction, friction_epsilon, dt
    )
