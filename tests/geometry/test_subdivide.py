"""Subdivision: short edges, the same surface, joined faces, and the first vertices where they were."""

import torch
import trimesh

from uvcloth.geometry.mesh import (
    Mesh,
    boundary_edges,
    edge_lengths,
    face_normals,
    unique_edges,
    vertex_normals,
    weld,
)
from uvcloth.geometry.subdivide import loop_subdivision, subdivide


def grid(columns: int, rows: int) -> Mesh:
    """A sheet of unequal triangles, flat in x and y, whose texture coordinates are half of them."""
    x, y = torch.meshgrid(torch.linspace(0, 1, columns) ** 2, torch.linspace(0, 0.3, rows), indexing="ij")
    vertices = torch.stack([x.flatten(), y.flatten(), 0 * x.flatten()], dim=1)
    corner = (torch.arange(columns - 1)[:, None] * rows + torch.arange(rows - 1)).flatten()
    faces = torch.cat(
        [
            torch.stack([corner, corner + rows, corner + rows + 1], 1),
            torch.stack([corner + rows + 1, corner + 1, corner], 1),
        ]
    )
    return Mesh(vertices, faces, vertices[:, :2] / 2, faces)


def test_no_edge_is_long_and_the_surface_is_the_same() -> None:
    mesh = grid(6, 3)
    fine = subdivide(mesh, 0.05)
    assert float(edge_lengths(fine.vertices, unique_edges(fine.faces)).max()) <= 0.05
    assert torch.equal(fine.vertices[: len(mesh.vertices)], mesh.vertices)
    normals = face_normals(fine.vertices, fine.faces)
    assert float(normals[:, 2].min()) > 0
    torch.testing.assert_close(0.5 * normals[:, 2].sum(), torch.tensor(0.3))
    # Texture coordinates stay on the same map, at every corner.
    torch.testing.assert_close(fine.uvs[fine.face_uvs], fine.vertices[fine.faces][..., :2] / 2)


def test_faces_of_all_sizes_stay_joined() -> None:
    fine = subdivide(grid(6, 3), 0.05)
    rim = boundary_edges(fine.faces)
    # A crack would be an edge of one face inside the sheet.
    ends = fine.vertices[rim]
    sides = ((0, 0.0), (0, 1.0), (1, 0.0), (1, 0.3))
    assert torch.stack([(ends[..., axis] - at).abs().amax(1) < 1e-6 for axis, at in sides]).any(0).all()
    assert len(fine.vertices) - len(unique_edges(fine.faces)) + len(fine.faces) == 1


def test_vertices_doubled_at_a_seam_stay_together() -> None:
    mesh = grid(3, 3)
    # Every triangle by itself, as in a file that is split at all seams.
    soup = Mesh(
        mesh.vertices[mesh.faces].reshape(-1, 3),
        torch.arange(3 * len(mesh.faces)).view(-1, 3),
        torch.zeros(0, 2),
        torch.zeros(0, 3, dtype=torch.int64),
    )
    whole, split = subdivide(mesh, 0.1), subdivide(soup, 0.1)
    assert len(split.vertices[weld(split.vertices)].unique(dim=0)) == len(whole.vertices)
    assert float(vertex_normals(split.vertices, split.faces)[:, 2].min()) > 0.99


def test_a_fine_mesh_is_left_as_it_is() -> None:
    mesh = grid(4, 3)
    assert subdivide(mesh, 1.0) is mesh


def test_loop_subdivision_is_that_of_trimesh() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=1)
    cut = sphere.faces[sphere.triangles_center[:, 2] < 0.3]
    for faces in (sphere.faces, cut):
        mesh = trimesh.Trimesh(sphere.vertices, faces, process=False)
        mesh.remove_unreferenced_vertices()
        mesh.vertices *= (1.0, 1.3, 0.7)
        vertices, corners = trimesh.remesh.subdivide_loop(mesh.vertices, mesh.faces, iterations=1)
        ours, our_corners = loop_subdivision(torch.tensor(mesh.vertices), torch.tensor(mesh.faces))
        assert torch.equal(our_corners, torch.tensor(corners))
        torch.testing.assert_close(ours, torch.tensor(vertices))


def test_loop_subdivision_keeps_a_flat_corner_flat_and_inside() -> None:
    """A face with two edges on the rim: its corners follow the rim alone, so that all weights sum to one."""
    points = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    subdivided, _ = loop_subdivision(points, torch.tensor([[0, 1, 2], [0, 2, 3]]))
    torch.testing.assert_close(subdivided[:, 2], torch.ones(9))
    assert float((subdivided - 0.5).abs().max()) <= 0.5
