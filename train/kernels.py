# mypy: ignore-errors
"""Warp kernels of training, CPU and CUDA alike: closest points and rays on triangle meshes."""

import warp as wp

wp.set_module_options({"enable_backward": False})

OBLIQUE_DIRECTION = wp.constant(wp.vec3(0.36, 0.48, 0.8))
"""A direction along no edge or axis."""

ON_SURFACE = wp.constant(1.0e-5)
"""Metres within which a point lies on the surface: no ray from it tells which side."""

RAY_ADVANCE = wp.constant(1.0e-6)
"""Metres behind a hit from where a ray goes on: sheets of caps and creases are that close together."""

FAR = wp.constant(10.0)
"""Metres: farther than anything."""

OPPOSING_COSINE = wp.constant(0.0)
"""Greatest cosine between the normals of two surfaces that face each other."""


@wp.func
def crossings(mesh: wp.uint64, start: wp.vec3, direction: wp.vec3):
    """Signed crossings of a ray with a mesh: exits minus entries."""
    origin = start
    # These calls make variables, which Warp would take as constants.
    count = int(0)  # noqa: UP018, RUF046
    hits = int(0)  # noqa: UP018, RUF046
    searching = bool(True)  # noqa: UP018
    while searching and hits < 64:
        hit = wp.mesh_query_ray(mesh, origin, direction, FAR)
        if hit.result:
            count += wp.where(wp.dot(hit.normal, direction) > 0.0, 1, -1)
            hits += 1
            origin = origin + direction * (hit.t + RAY_ADVANCE)
        else:
            searching = False
    return count


@wp.func
def signed_closest(mesh: wp.uint64, point: wp.vec3, reach: float, side: float):
    """Signed distance, place, outward direction, face (-1 beyond the reach) and barycentrics (u, v).

    side: negative inside and positive outside, where that is known; zero where rays have to decide.

    Posed surfaces fold into themselves, where the nearest sheet may face either way. The ray away from it
    crosses few others and shows whether the point is inside; where sheet and ray disagree, the majority of
    three rays decides: one that meets an edge of two sheets may miss them.
    """
    distance = reach
    place = point
    direction = wp.vec3(0.0)
    face = int(-1)  # noqa: UP018, RUF046
    u = float(0.0)  # noqa: UP018
    v = float(0.0)  # noqa: UP018
    query = wp.mesh_query_point_no_sign(mesh, point, reach)
    if query.result:
        place = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        away = point - place
        length = wp.length(away)
        direction = wp.mesh_eval_face_normal(mesh, query.face)
        if length > ON_SURFACE:
            away *= 1.0 / length
            inside = side < 0.0
            if side == 0.0:
                inside = crossings(mesh, point, away) > 0
                if inside != (wp.dot(direction, away) < 0.0):
                    there = crossings(mesh, point, OBLIQUE_DIRECTION) > 0
                    back = crossings(mesh, point, -OBLIQUE_DIRECTION) > 0
                    inside = (there and back) or (inside and (there or back))
            direction = wp.where(inside, -away, away)
        distance = wp.where(wp.dot(point - place, direction) < 0.0, -length, length)
        face = query.face
        u = query.u
        v = query.v
    return distance, place, direction, face, u, v


@wp.func
def nearest_touched(
    parts: wp.array(dtype=wp.uint64), touched: int, point: wp.vec3, reach: float, exact: float
):
    """The closed part that a point is deepest in or nearest to, of those that it may touch (a bit each).

    Returns its signed distance, outward direction and offset (product of the closest point with that),
    and the room between it and the nearest part that faces it, negative where they overlap; FAR where there
    is none. Parts that the point is outside of and farther from than `exact` count as that far away.
    """
    least = reach
    outward = wp.vec3(0.0)
    offset = float(0.0)  # noqa: UP018
    room = float(FAR)
    for part in range(parts.shape[0]):
        if (touched >> part) & 1 == 1:
            mesh = parts[part]
            near = wp.min(reach, exact)
            separation, place, direction, face, _u, _v = signed_closest(mesh, point, near, 0.0)
            if face < 0 and near < reach:
                # Farther away, it counts only with the point inside. The ray leads away from the part, which
                # makes it cheap, and out of the body's plane of symmetry, where it would meet edges.
                away = wp.normalize(point - wp.mesh_get_point(mesh, 0)) + OBLIQUE_DIRECTION
                if crossings(mesh, point, wp.normalize(away)) > 0:
                    separation, place, direction, face, _u, _v = signed_closest(mesh, point, reach, 0.0)
                else:
                    least = wp.min(least, near)
            if wp.dot(outward, direction) < OPPOSING_COSINE:
                room = wp.min(room, least + separation)
            if face >= 0 and separation < least:
                least = separation
                outward = direction
                offset = wp.dot(direction, place)
    return least, outward, offset, room


@wp.kernel
def closest_touched(
    share: int,
    parts: wp.array(dtype=wp.uint64),
    touches: wp.array(dtype=int),
    points: wp.array(dtype=wp.vec3),
    reach: wp.array(dtype=float),
    exact: float,
    narrow: float,
    distance: wp.array(dtype=float),
    normal: wp.array(dtype=wp.vec3),
    offset: wp.array(dtype=float),
    gap: wp.array(dtype=float),
):
    """The result of `nearest_touched` for each point. narrow: least room that need not be exact."""
    i = share + wp.tid()
    least, outward, plane, room = nearest_touched(parts, touches[i], points[i], reach[i], exact)
    if least < narrow - exact:
        # So deep in one part, even one that is farther away may leave too little room.
        least, outward, plane, room = nearest_touched(parts, touches[i], points[i], reach[i], FAR)
    distance[i] = least
    normal[i] = outward
    offset[i] = plane
    gap[i] = room


@wp.kernel
def beside_sheet(
    share: int,
    mesh: wp.uint64,
    normals: wp.array(dtype=wp.vec3),
    points: wp.array(dtype=wp.vec3),
    reach: float,
    steepest: float,
    face: wp.array(dtype=int),
    distance: wp.array(dtype=float),
    normal: wp.array(dtype=wp.vec3),
):
    """Find the face of an open sheet that covers each point, -1 if none does, by the normals of its vertices.

    steepest: least cosine between the normal at the closest place and the way to a point that it covers.
    distance: along that normal.
    """
    i = share + wp.tid()
    face[i] = -1
    query = wp.mesh_query_point_no_sign(mesh, points[i], reach)
    if query.result:
        away = points[i] - wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        direction = query.u * normals[wp.mesh_get_index(mesh, 3 * query.face)]
        direction += query.v * normals[wp.mesh_get_index(mesh, 3 * query.face + 1)]
        direction += (1.0 - query.u - query.v) * normals[wp.mesh_get_index(mesh, 3 * query.face + 2)]
        direction = wp.normalize(direction)
        along = wp.dot(away, direction)
        if wp.abs(along) >= steepest * wp.length(away):
            face[i] = query.face
            distance[i] = along
            normal[i] = direction


@wp.kernel
def closest_in_batch(
    share: int,
    meshes: wp.array(dtype=wp.uint64),
    each: int,
    points: wp.array(dtype=wp.vec3),
    cached: wp.array(dtype=wp.vec3),
    clearance: wp.array(dtype=float),
    near: float,
    reach: float,
    corners: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    offset: wp.array(dtype=float),
):
    """Find for each point the plane through the closest point of its mesh, if that is near.

    each: points per mesh. corners: normals of the vertices of all meshes, or none. With them, the plane is at
    the nearest corner of the closest face, across its normal; without them, at the closest point, across the
    way to it.

    cached, clearance: position of a point at its last search, and its signed distance then, within reach.
    """
    i = share + wp.tid()
    point = points[i]
    travel = wp.length(point - cached[i])
    if clearance[i] - travel > near:
        return
    limit = wp.min(reach, wp.abs(clearance[i]) + travel + ON_SURFACE)
    # No way shorter than the distance to the surface leads through it.
    side = wp.where(wp.abs(clearance[i]) > travel + ON_SURFACE, clearance[i], 0.0)
    mesh = meshes[i // each]
    cached[i] = point
    separation, place, direction, face, _u, _v = signed_closest(mesh, point, limit, side)
    clearance[i] = separation
    if separation < near and face >= 0:
        if corners.shape[0] > 0:
            nearest = FAR
            start = (i // each) * (corners.shape[0] // meshes.shape[0])
            for k in range(3):
                corner = wp.mesh_get_point(mesh, 3 * face + k)
                if wp.length(point - corner) < nearest:
                    nearest = wp.length(point - corner)
                    place = corner
                    direction = corners[start + wp.mesh_get_index(mesh, 3 * face + k)]
        normal[i] = direction
        offset[i] = wp.dot(direction, place)
