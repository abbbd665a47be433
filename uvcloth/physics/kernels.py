# mypy: ignore-errors
"""Warp kernels for contact: closest points and winding numbers on a triangle mesh, CPU and CUDA alike."""

import warp as wp


@wp.kernel
def closest_point(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    reach: float,
    distance: wp.array(dtype=float),
    closest: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    face: wp.array(dtype=int),
    barycentrics: wp.array(dtype=wp.vec3),
):
    """The surface point closest to each point, signed by the side of its sheet; face -1 beyond the reach."""
    i = wp.tid()
    point = points[i]
    distance[i] = reach
    closest[i] = point
    face[i] = -1
    query = wp.mesh_query_point_sign_normal(mesh, point, reach)
    if query.result:
        surface = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        away = point - surface
        length = wp.length(away)
        direction = wp.mesh_eval_face_normal(mesh, query.face)
        if length > 1.0e-5:
            direction = away * (query.sign / length)
        distance[i] = query.sign * length
        closest[i] = surface
        normal[i] = direction
        face[i] = query.face
        barycentrics[i] = wp.vec3(query.u, query.v, 1.0 - query.u - query.v)


@wp.kernel
def winding_number(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    winding: wp.array(dtype=int),
):
    """Signed crossings of a ray from each point: times left the mesh less times entered."""
    i = wp.tid()
    origin = points[i]
    direction = wp.normalize(directions[i])
    # Warp tells a variable from a constant by these calls.
    count = int(0)  # noqa: UP018, RUF046
    crossings = int(0)  # noqa: UP018, RUF046
    searching = bool(True)  # noqa: UP018
    while searching and crossings < 64:
        hit = wp.mesh_query_ray(mesh, origin, direction, 10.0)
        if hit.result:
            count += wp.where(wp.dot(hit.normal, direction) > 0.0, 1, -1)
            crossings += 1
            origin = origin + direction * (hit.t + 1.0e-5)
        else:
            searching = False
    winding[i] = count
