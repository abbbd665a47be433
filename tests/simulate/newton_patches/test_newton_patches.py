"""Patches of Newton: they give the same, and they are for the version that is installed."""

import pytest
import torch
import warp as wp

from rasterize.warp_start import start_warp

pytest.importorskip("newton", reason="the `simulate` extra is not installed")

from tests.simulate.test_newton import sheet_over_a_ball
from uvcloth.errors import InputError
from uvcloth.simulate import newton_patches
from uvcloth.simulate.newton import Newton
from uvcloth.simulate.newton_patches import patches, require_newton
from uvcloth.simulate.newton_patches.bending import bending_force_hessian
from uvcloth.simulate.newton_patches.near_pairs import (
    edge_edge_contact,
    near_edge_edge_contact,
    near_vertex_triangle_contact,
    vertex_triangle_contact,
)

COUNT = 100_000

newton_bending = next(patch.original for patch in patches() if "dihedral" in patch.name)


@wp.kernel(enable_backward=False)
def bend(  # type: ignore[no-untyped-def]
    ours: bool,
    pos: wp.array[wp.vec3],  # type: ignore[valid-type]
    edges: wp.array2d[wp.int32],  # type: ignore[valid-type]
    angles: wp.array[float],  # type: ignore[valid-type]
    lengths: wp.array[float],  # type: ignore[valid-type]
    forces: wp.array[wp.vec3],  # type: ignore[valid-type]
    hessians: wp.array[wp.mat33],  # type: ignore[valid-type]
):
    """Bending of an edge on one of its corners, ours or Newton's."""
    row = wp.tid()
    force, hessian = wp.vec3(0.0), wp.mat33(0.0)
    if ours:
        force, hessian = bending_force_hessian(row, row % 4, pos, pos, edges, angles, lengths, 2.0, 0.0, 0.01)
    else:
        force, hessian = newton_bending(row, row % 4, pos, pos, edges, angles, lengths, 2.0, 0.0, 0.01)
    forces[row] = force
    hessians[row] = hessian


@wp.kernel(enable_backward=False)
def touch(  # type: ignore[no-untyped-def]
    ours: bool,
    of_edges: bool,
    pos: wp.array[wp.vec3],  # type: ignore[valid-type]
    edges: wp.array2d[wp.int32],  # type: ignore[valid-type]
    triangles: wp.array2d[wp.int32],  # type: ignore[valid-type]
    contacts: wp.array[bool],  # type: ignore[valid-type]
):
    """Contact of two edges, or of a vertex and a triangle, by our function or by Newton's."""
    row = wp.tid()
    contact, none, flat = wp.bool(False), wp.vec3(0.0), wp.mat33(0.0)
    _f0, _f1, _f2, _f3 = none, none, none, none
    _h0, _h1, _h2, _h3 = flat, flat, flat, flat
    first, second = 2 * row, 2 * row + 1
    if of_edges and ours:
        contact, _f0, _f1, _h0, _h1 = near_edge_edge_contact(
            first, second, pos, pos, edges, 0.003, 2e3, 0.01, 0.4, 1e-3, 0.002, 1e-5
        )
    elif of_edges:
        contact, _f0, _f1, _h0, _h1 = edge_edge_contact(
            first, second, pos, pos, edges, 0.003, 2e3, 0.01, 0.4, 1e-3, 0.002, 1e-5
        )
    elif ours:
        contact, _f0, _f1, _f2, _f3, _h0, _h1, _h2, _h3 = near_vertex_triangle_contact(
            4 * row, row, pos, pos, triangles, 0.003, 2e3, 0.01, 0.4, 1e-3, 0.002
        )
    else:
        contact, _f0, _f1, _f2, _f3, _h0, _h1, _h2, _h3 = vertex_triangle_contact(
            4 * row, row, pos, pos, triangles, 0.003, 2e3, 0.01, 0.4, 1e-3, 0.002
        )
    contacts[row] = contact


def test_newton_takes_four_threads_for_a_contact_on_a_cpu_too() -> None:
    threads = [patch for patch in patches() if patch.name == "NUM_THREADS_PER_COLLISION_PRIMITIVE"]
    assert [patch.original for patch in threads] == [4, 4]
    assert {patch.replacement for patch in threads} == {1}


def test_bending_of_newton_gives_the_same() -> None:
    start_warp()
    points = torch.rand(4 * COUNT, 3)
    inputs = [
        wp.from_torch(points, dtype=wp.vec3),
        wp.from_torch(torch.arange(4 * COUNT, dtype=torch.int32).view(-1, 4)),
        wp.from_torch(torch.linspace(-0.5, 0.5, COUNT)),
        wp.from_torch(torch.ones(COUNT)),
    ]
    results = []
    for ours in (True, False):
        forces, hessians = torch.zeros(COUNT, 3), torch.zeros(COUNT, 3, 3)
        outputs = [wp.from_torch(forces, dtype=wp.vec3), wp.from_torch(hessians, dtype=wp.mat33)]
        wp.launch(bend, dim=COUNT, inputs=[ours, *inputs, *outputs], device="cpu")
        results.append((forces, hessians))
    # Thin faces have large derivatives and lose digits in them.
    for mine, newtons in zip(*results, strict=True):
        off = (mine - newtons).flatten(1).norm(dim=1) / newtons.flatten(1).norm(dim=1).clamp(min=1e-3)
        assert float(off.quantile(0.99)) < 1e-3


@pytest.mark.parametrize("of_edges", [True, False])
def test_pairs_that_are_far_apart_touch_neither_for_newton_nor_for_us(of_edges: bool) -> None:
    start_warp()
    points = 0.01 * torch.rand(COUNT, 4, 3)
    points[:, : 2 if of_edges else 1, 2] += 0.02
    order = torch.arange(4 * COUNT, dtype=torch.int32)
    edges = torch.full((2 * COUNT, 4), -1, dtype=torch.int32)
    edges[:, 2:] = order.view(-1, 2)
    triangles = order.view(-1, 4)[:, 1:].contiguous()
    inputs = [
        wp.from_torch(points.view(-1, 3), dtype=wp.vec3),
        wp.from_torch(edges),
        wp.from_torch(triangles),
    ]
    for ours in (True, False):
        contacts = torch.ones(COUNT, dtype=torch.bool)
        output = wp.from_torch(contacts)
        wp.launch(touch, dim=COUNT, inputs=[ours, of_edges, *inputs, output], device="cpu")
        assert not contacts.any()


def test_a_pipeline_of_newton_pairs_every_vertex_with_every_shape() -> None:
    import newton as package

    builder = package.ModelBuilder()
    for place in range(3):
        builder.add_particle(wp.vec3(0.0, 0.0, float(place)), wp.vec3(0.0), 1.0)
    for _ in range(2):
        builder.add_shape_sphere(body=-1, radius=0.1)
    pipeline = package.CollisionPipeline(builder.finalize(device="cpu"))
    pairs = {tuple(pair) for pair in pipeline.soft_rigid_contact_pairs.numpy().tolist()}
    assert pairs == {(vertex, shape) for vertex in range(3) for shape in range(2)}
    newton_patches.keep_apart(pipeline, torch.tensor([[True, False, True]]))
    kept = [tuple(pair) for pair in pipeline.soft_rigid_contact_pairs.numpy().tolist()]
    assert sorted(kept) == [(0, 0), (0, 1), (1, 1), (1, 1), (2, 0), (2, 1)]


@pytest.mark.parametrize(("installed", "supported"), [("1.8.0", True), ("1.8.3", True), ("1.9.0", False)])
def test_another_version_of_newton_is_refused_in_one_sentence(
    installed: str, supported: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(newton_patches, "version", lambda name: installed)
    if supported:
        require_newton()
        return
    with pytest.raises(
        InputError, match=r"^Newton 1\.9\.0 is installed, .* Newton 1\.8, .*: install [^\n]*$"
    ):
        next(Newton().simulate(sheet_over_a_ball(2, height=0.14)))


def test_every_patch_says_why() -> None:
    assert all(patch.why and patch.replacement is not patch.original for patch in patches())
