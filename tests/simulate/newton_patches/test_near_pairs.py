"""Pairs that are told to be too far apart to matter do not: what the solver's own functions say of them."""

import pytest
import torch
import warp as wp
from torch import Tensor

from rasterize.warp_start import start_warp

pytest.importorskip("newton")

from newton._src.solvers.vbd.rigid_vbd_kernels import planar_truncation_t

from uvcloth.simulate.newton_patches.near_pairs import (
    edge_edge_contact,
    edge_edge_plane,
    near_edge_edge_contact,
    near_edge_edge_plane,
    near_vertex_triangle_contact,
    near_vertex_triangle_plane,
    vertex_triangle_contact,
    vertex_triangle_plane,
)

PAIRS = 20_000
GAMMA, RADIUS, STEP = 0.85, 0.003, 1.0 / 600.0


@wp.kernel(enable_backward=False)
def shares(  # type: ignore[no-untyped-def]
    pos: wp.array[wp.vec3],  # type: ignore[valid-type]
    moved: wp.array[wp.vec3],  # type: ignore[valid-type]
    edges: bool,
    near: bool,
    planes: wp.array[bool],  # type: ignore[valid-type]
    found: wp.array[float],  # type: ignore[valid-type]
):
    """Shares of its way that the plane between edges, or vertex and triangle, leaves each corner."""
    first = 4 * wp.tid()
    p0, p1, p2, p3 = pos[first], pos[first + 1], pos[first + 2], pos[first + 3]
    m0, m1, m2, m3 = moved[first], moved[first + 1], moved[first + 2], moved[first + 3]
    valid, n, d, epsilon = wp.bool(False), wp.vec3(0.0), wp.vec3(0.0), wp.float32(0.0)
    if edges and near:
        valid, n, d, epsilon = near_edge_edge_plane(p0, m0, p1, m1, p2, m2, p3, m3)
    elif edges:
        valid, n, d, epsilon = edge_edge_plane(p0, m0, p1, m1, p2, m2, p3, m3)
    elif near:
        valid, n, d, epsilon = near_vertex_triangle_plane(p0, m0, p1, m1, p2, m2, p3, m3)
    else:
        valid, n, d, epsilon = vertex_triangle_plane(p0, m0, p1, m1, p2, m2, p3, m3)
    planes[wp.tid()] = valid
    for corner in range(4):
        side = wp.where(corner == 0 or (edges and corner == 1), n, -n)
        share = planar_truncation_t(pos[first + corner], moved[first + corner], side, d, GAMMA, epsilon)
        found[first + corner] = wp.where(valid, share, 1.0)


@wp.kernel(enable_backward=False)
def contacts(  # type: ignore[no-untyped-def]
    pos: wp.array[wp.vec3],  # type: ignore[valid-type]
    before: wp.array[wp.vec3],  # type: ignore[valid-type]
    edges: wp.array2d[wp.int32],  # type: ignore[valid-type]
    triangles: wp.array2d[wp.int32],  # type: ignore[valid-type]
    near: bool,
    found: wp.array[wp.vec3],  # type: ignore[valid-type]
):
    """Forces of contact on the first edge of a pair, and on the four corners of a vertex and a triangle."""
    pair = wp.tid()
    first, second = 2 * pair, 2 * pair + 1
    touch, none, flat = wp.bool(False), wp.vec3(0.0), wp.mat33(0.0)
    f0, f1, f2, f3 = none, none, none, none
    _0, _1, _2, _3 = flat, flat, flat, flat
    if near:
        touch, f0, f1, _0, _1 = near_edge_edge_contact(
            first, second, pos, before, edges, RADIUS, 2e3, 0.01, 0.4, 1e-3, STEP, 1e-5
        )
    else:
        touch, f0, f1, _0, _1 = edge_edge_contact(
            first, second, pos, before, edges, RADIUS, 2e3, 0.01, 0.4, 1e-3, STEP, 1e-5
        )
    if touch:
        found[6 * pair] = f0
        found[6 * pair + 1] = f1
    if near:
        touch, f0, f1, f2, f3, _0, _1, _2, _3 = near_vertex_triangle_contact(
            4 * pair, pair, pos, before, triangles, RADIUS, 2e3, 0.01, 0.4, 1e-3, STEP
        )
    else:
        touch, f0, f1, f2, f3, _0, _1, _2, _3 = vertex_triangle_contact(
            4 * pair, pair, pos, before, triangles, RADIUS, 2e3, 0.01, 0.4, 1e-3, STEP
        )
    if touch:
        found[6 * pair + 2] = f0
        found[6 * pair + 3] = f1
        found[6 * pair + 4] = f2
        found[6 * pair + 5] = f3


def corners() -> tuple[Tensor, Tensor]:
    """Corners of each pair (PAIRS, 4, 3) m, some of them close, and how far each has moved, up to 5 mm."""
    torch.manual_seed(0)
    sides = 0.015 * torch.nn.functional.normalize(torch.randn(PAIRS, 4, 3), dim=2)
    apart = torch.zeros(PAIRS, 4, 3)
    apart[:, 0, 2] = apart[:, 1, 2] = 0.02 * torch.rand(PAIRS)
    moved = 0.005 * torch.rand(PAIRS, 4, 1) * torch.nn.functional.normalize(torch.randn(PAIRS, 4, 3), dim=2)
    return 0.5 * sides * torch.tensor([1.0, 1.0, 0.3]) + apart + torch.randn(PAIRS, 1, 3), moved


def vectors(values: Tensor) -> wp.array:
    return wp.from_torch(values.reshape(-1, 3).contiguous(), dtype=wp.vec3)


@pytest.mark.parametrize("edges", [True, False])
def test_a_pair_without_a_plane_would_not_be_held_back(edges: bool) -> None:
    start_warp()
    places, moved = corners()
    shared, planes = [], []
    for near in (True, False):
        found, valid = torch.zeros(4 * PAIRS), torch.zeros(PAIRS, dtype=torch.bool)
        inputs = [vectors(places), vectors(moved), edges, near, wp.from_torch(valid), wp.from_torch(found)]
        wp.launch(shares, dim=PAIRS, inputs=inputs, device="cpu")
        shared.append(found)
        planes.append(valid)
    assert torch.equal(*shared)
    assert 0.02 < (shared[0] < 1.0).float().mean() < 0.5
    left_out = (planes[1] & ~planes[0]).float().mean()
    assert left_out > 0.15
    assert (planes[1] | ~planes[0]).all()


def test_a_pair_that_does_not_touch_has_no_force() -> None:
    start_warp()
    places, moved = corners()
    order = torch.arange(4 * PAIRS, dtype=torch.int32)
    edges = torch.full((2 * PAIRS, 4), -1, dtype=torch.int32)
    edges[:, 2:] = order.view(-1, 2)
    triangles = order.view(-1, 4)[:, 1:].contiguous()
    forces = []
    for near in (True, False):
        found = torch.zeros(6 * PAIRS, 3)
        inputs = [vectors(places), vectors(places - moved), wp.from_torch(edges), wp.from_torch(triangles)]
        wp.launch(contacts, dim=PAIRS, inputs=[*inputs, near, vectors(found)], device="cpu")
        forces.append(found)
    assert torch.equal(*forces)
    touching = forces[0].view(PAIRS, 6, 3).abs().sum(2) > 0.0
    assert 0.01 < touching[:, :2].any(1).float().mean() < 0.5
    assert 0.01 < touching[:, 2:].any(1).float().mean() < 0.5
