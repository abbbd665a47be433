"""An outfit's meshes as one."""

import torch

from uvcloth.geometry.mesh import face_normals, join_meshes


def test_each_mesh_keeps_its_faces() -> None:
    triangle = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    square = torch.tensor([[0.0, 0, 0], [0, 2, 0], [0, 2, 2], [0, 0, 2]])
    parts = [(triangle, torch.tensor([[0, 1, 2]])), (square, torch.tensor([[0, 1, 2], [0, 2, 3]]))] * 2
    joined = join_meshes(parts)
    assert joined.starts == (0, 3, 7, 10)
    assert joined.sizes == (3, 4, 3, 4)
    expected = torch.cat([face_normals(*part) for part in parts])
    assert torch.equal(face_normals(joined.vertices, joined.faces), expected)
