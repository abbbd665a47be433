import struct
from pathlib import Path

import numpy as np
import torch
import trimesh

from uvcloth.geometry.skinning import skin
from uvcloth.writers.animation import Animation
from uvcloth.writers.pointcache import write_pc2


def read_pc2(path: Path) -> np.ndarray:
    data = path.read_bytes()
    signature, version, points, start, rate, samples = struct.unpack("<12siiffi", data[:32])
    assert (signature, version, start, rate) == (b"POINTCACHE2\0", 1, 0.0, 1.0)
    return np.frombuffer(data, "<f4", offset=32).reshape(samples, points, 3)


def test_caches_hold_every_vertex_in_order(animation: Animation, tmp_path: Path) -> None:
    write_pc2(animation, tmp_path / "walk.pc2")
    for name, vertices in zip(animation.names, animation.vertices, strict=True):
        np.testing.assert_array_equal(read_pc2(tmp_path / f"walk-{name}.pc2"), vertices)
    body = animation.body
    assert body is not None
    posed = skin(body.mesh.vertices, body.weights, torch.from_numpy(animation.transforms)).numpy()
    np.testing.assert_allclose(read_pc2(tmp_path / "walk-body.pc2"), posed, atol=1e-6)


def test_rest_mesh_keeps_vertex_order_and_texture_coordinates(animation: Animation, tmp_path: Path) -> None:
    write_pc2(animation, tmp_path / "walk.pc2")
    mesh = animation.meshes[0]
    lines = (tmp_path / "walk-shirt.obj").read_text().splitlines()
    vertices = np.array([line.split()[1:] for line in lines if line.startswith("v ")], float)
    np.testing.assert_allclose(vertices, mesh.vertices.numpy(), atol=1e-7)
    loaded = trimesh.load(tmp_path / "walk-shirt.obj", process=False)
    triangles = mesh.vertices[mesh.faces].numpy()
    np.testing.assert_allclose(loaded.vertices[loaded.faces], triangles, atol=1e-6)
    np.testing.assert_allclose(loaded.visual.uv[loaded.faces], mesh.uvs[mesh.face_uvs].numpy(), atol=1e-6)
