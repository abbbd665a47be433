# mypy: ignore-errors
"""Warp kernels, CPU and CUDA alike: closest points on triangle meshes, and edge lengths."""

import warp as wp

wp.set_module_options({"enable_backward": False})

DOUBTFUL = wp.constant(0.003)
"""Metres inside from which on the sign is checked: it is wrong now and then far from a sharp edge."""

ANYWHERE = wp.constant(wp.vec3(0.36, 0.48, 0.8))
"""Where rays go that tell whether a point is inside: along no edge or axis."""

FAR = wp.constant(10.0)
"""Metres: farther than anything."""

FACING = wp.constant(0.0)
"""Cosine between the normals of two surfaces that face each other, at most."""


@wp.func
def crossings(mesh: wp.uint64, start: wp.vec3, direction: wp.vec3):
    """Signed crossings of a ray: times the mesh is left less times it is entered."""
    origin = start
    # Warp tells a variable from a constant by these calls.
    count = int(0)  # noqa: UP018, RUF046
    found = int(0)  # noqa: UP018, RUF046
    searching = bool(True)  # noqa: UP018
    while searching and found < 64:
        hit = wp.mesh_query_ray(mesh, origin, direction, FAR)
        if hit.result:
            count += wp.where(wp.dot(hit.normal, direction) > 0.0, 1, -1)
            found += 1
            origin = origin + direction * (hit.t + 1.0e-5)
        else:
            searching = False
    return count


@wp.func
def signed_closest(mesh: wp.uint64, point: wp.vec3, reach: float):
    """Signed distance, place, outward direction, face (-1 beyond the reach) and barycentrics (u, v)."""
    distance = reach
    place = point
    direction = wp.vec3(0.0)
    face = int(-1)  # noqa: UP018, RUF046
    u = float(0.0)  # noqa: UP018
    v = float(0.0)  # noqa: UP018
    query = wp.mesh_query_point_sign_normal(mesh, point, reach)
    if query.result:
        place = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        away = point - place
        length = wp.length(away)
        sign = query.sign
        direction = wp.mesh_eval_face_normal(mesh, query.face)
        if length > 1.0e-5:
            direction = away * (sign / length)
        if sign < 0.0 and length > DOUBTFUL and crossings(mesh, point, ANYWHERE) <= 0:
            sign = 1.0
            direction = -direction
        distance = sign * length
        face = query.face
        u = query.u
        v = query.v
    return distance, place, direction, face, u, v


@wp.kernel
def closest_point(
    share: int,
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
    i = share + wp.tid()
    found, place, direction, index, u, v = signed_closest(mesh, points[i], reach)
    distance[i] = found
    closest[i] = place
    normal[i] = direction
    face[i] = index
    barycentrics[i] = wp.vec3(u, v, 1.0 - u - v)


@wp.kernel
def closest_touched(
    share: int,
    parts: wp.array(dtype=wp.uint64),
    touches: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    reach: wp.array(dtype=float),
    distance: wp.array(dtype=float),
    normal: wp.array(dtype=wp.vec3),
    bound: wp.array(dtype=float),
    gap: wp.array(dtype=float),
):
    """The closed part that a point is deepest in or nearest to, of those that it may touch (a bit each).

    bound: product of the closest point with its normal. gap: room between that part and the nearest one that
    faces it, negative where they overlap; FAR where there is none.
    """
    i = share + wp.tid()
    point = points[i]
    least = reach[i]
    outward = wp.vec3(0.0)
    plane = float(0.0)  # noqa: UP018
    room = float(FAR)
    for part in range(parts.shape[0]):
        if (touches[i] >> part) & 1 == 1:
            found, place, direction, face, _u, _v = signed_closest(parts[part], point, reach[i])
            if wp.dot(outward, direction) < FACING:
                room = wp.min(room, least + found)
            if face >= 0 and found < least:
                least = found
                outward = direction
                plane = wp.dot(direction, place)
    distance[i] = least
    normal[i] = outward
    bound[i] = plane
    gap[i] = room


@wp.kernel
def even_edges(
    share: int,
    now: wp.array(dtype=wp.vec3),
    before: wp.array(dtype=wp.vec3),
    first: wp.array(dtype=int),
    neighbours: wp.array(dtype=int),
    lengths: wp.array(dtype=float),
    normals: wp.array(dtype=wp.vec3),
    bounds: wp.array(dtype=float),
    step: float,
    momentum: float,
):
    """Half of what each edge lacks moves either end, averaged; the new place replaces the one before.

    A vertex stays on the outer side of its plane, given by a normal and the least product with it.
    """
    i = share + wp.tid()
    place = now[i]
    pull = wp.vec3(0.0)
    begin = first[i]
    end = first[i + 1]
    for k in range(begin, end):
        edge = now[neighbours[k]] - place
        pull += edge * (1.0 - lengths[k] / wp.max(wp.length(edge), 1.0e-9))
    moved = place + pull * (0.5 * step / wp.max(float(end - begin), 1.0))
    moved = before[i] + momentum * (moved - before[i])
    depth = bounds[i] - wp.dot(normals[i], moved)
    if depth > 0.0:
        moved += depth * normals[i]
    before[i] = moved
