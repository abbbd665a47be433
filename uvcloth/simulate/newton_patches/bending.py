# mypy: ignore-errors
"""Force and Hessian of bending over an edge, in closed form."""

import warp as wp

wp.set_module_options({"enable_backward": False})

LEAST = wp.constant(1.0e-6)
"""m of an edge, and m2 of twice a face, below which they do not bend."""


@wp.func
def bending_force_hessian(
    edge: int,
    corner: int,
    pos: wp.array[wp.vec3],
    pos_anchor: wp.array[wp.vec3],
    edge_indices: wp.array2d[wp.int32],
    edge_rest_angle: wp.array[float],
    edge_rest_length: wp.array[float],
    stiffness: float,
    damping: float,
    dt: float,
):
    """Force (N) and Hessian (N/m) of an edge's bending on one of its four corners.

    A stand-in for the function of SolverVBD that takes the same arguments, which finds the angle's
    derivatives by products of matrices and for all corners; this one has no damping. The gradient of the
    angle between two faces: Bridson et al. 2003, "Simulation of clothing with folds and wrinkles", section
    4; the Hessian leaves out the angle's second derivatives, as the solver's does.
    """
    first = edge_indices[edge, 0]
    second = edge_indices[edge, 1]
    if first == -1 or second == -1:
        return wp.vec3(0.0), wp.mat33(0.0)
    tip_0 = pos[first]
    tip_1 = pos[second]
    start = pos[edge_indices[edge, 2]]
    end = pos[edge_indices[edge, 3]]
    along = end - start
    normal_0 = wp.cross(start - tip_0, end - tip_0)
    normal_1 = wp.cross(end - tip_1, start - tip_1)
    square_0 = wp.dot(normal_0, normal_0)
    square_1 = wp.dot(normal_1, normal_1)
    length = wp.length(along)
    if square_0 < LEAST * LEAST or square_1 < LEAST * LEAST or length < LEAST:
        return wp.vec3(0.0), wp.mat33(0.0)
    angle = wp.atan2(wp.dot(wp.cross(normal_0, normal_1), along) / length, wp.dot(normal_0, normal_1))
    over_0 = normal_0 / square_0
    over_1 = normal_1 / square_1
    gradient = wp.vec3(0.0)
    if corner == 0:
        gradient = -length * over_0
    elif corner == 1:
        gradient = -length * over_1
    elif corner == 2:
        gradient = (wp.dot(end - tip_0, along) * over_0 + wp.dot(end - tip_1, along) * over_1) / length
    else:
        gradient = -(wp.dot(start - tip_0, along) * over_0 + wp.dot(start - tip_1, along) * over_1) / length
    rigidity = stiffness * edge_rest_length[edge]
    return -rigidity * (angle - edge_rest_angle[edge]) * gradient, rigidity * wp.outer(gradient, gradient)
