"""The file read back with pygltflib and evaluated by the specification's rules, and the Khronos validator."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pygltflib
import pytest
import torch
from scipy.spatial.transform import Rotation

from uvcloth.export.animation import Animation
from uvcloth.export.gltf import write_glb
from uvcloth.export.gltf_scene import split_seams
from uvcloth.skinning import skin

KINDS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
DTYPES = {5126: np.float32, 5125: np.uint32, 5123: np.uint16}


@pytest.fixture(scope="module")
def glb(animation: Animation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("glb") / "walk.glb"
    write_glb(animation, path)
    return path


def read(gltf: pygltflib.GLTF2, index: int) -> np.ndarray:
    accessor = gltf.accessors[index]
    view = gltf.bufferViews[accessor.bufferView]
    start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
    count = accessor.count * KINDS[accessor.type]
    values = np.frombuffer(gltf.binary_blob(), DTYPES[accessor.componentType], count, start)
    return values.reshape(accessor.count, -1).astype(np.float64)


def to_z_up(points: np.ndarray) -> np.ndarray:
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)


def channels(gltf: pygltflib.GLTF2) -> dict[tuple[int, str], np.ndarray]:
    animation = gltf.animations[0]
    return {
        (channel.target.node, channel.target.path): read(gltf, animation.samplers[channel.sampler].output)
        for channel in animation.channels
    }


def test_garment_frames_are_the_vertices(glb: Path, animation: Animation) -> None:
    gltf = pygltflib.GLTF2().load(str(glb))
    animated = channels(gltf)
    for index, name in enumerate(animation.names):
        node = next(i for i, node in enumerate(gltf.nodes) if node.name == name)
        mesh = gltf.meshes[gltf.nodes[node].mesh]
        primitive = mesh.primitives[0]
        source = np.array(mesh.extras["source_vertices"])
        count = len(animation.meshes[index].vertices)
        np.testing.assert_array_equal(source[:count], np.arange(count))
        weights = animated[node, "weights"].reshape(len(animation), -1)
        for attribute in ("POSITION", "NORMAL"):
            base = read(gltf, getattr(primitive.attributes, attribute))
            targets = np.stack([read(gltf, target[attribute]) for target in primitive.targets])
            values = to_z_up(base + np.einsum("ft,tvc->fvc", weights, targets))
            if attribute == "POSITION":
                assert np.abs(values - animation.vertices[index][:, source]).max() < 1e-5
            else:
                a, b, c = (animation.vertices[index][:, corner] for corner in animation.meshes[index].faces.T)
                flat = np.cross(b - a, c - a)
                corners = read(gltf, primitive.indices).astype(int).reshape(-1, 3)
                agreement = (values[:, corners[:, 0]] * flat).sum(-1) / np.linalg.norm(flat, axis=-1)
                assert np.median(agreement) > 0.98


def test_texture_coordinates_and_faces_survive(glb: Path, animation: Animation) -> None:
    gltf = pygltflib.GLTF2().load(str(glb))
    for index, mesh in enumerate(animation.meshes):
        primitive = gltf.meshes[index].primitives[0]
        source = np.array(gltf.meshes[index].extras["source_vertices"])
        corners = read(gltf, primitive.indices).astype(int).reshape(-1, 3)
        np.testing.assert_array_equal(source[corners], mesh.faces.numpy())
        uvs = read(gltf, primitive.attributes.TEXCOORD_0)[corners]
        uvs[..., 1] = 1 - uvs[..., 1]
        np.testing.assert_allclose(uvs, mesh.uvs[mesh.face_uvs].numpy(), atol=1e-6)


def test_seam_vertices_follow_the_mesh_s_own(animation: Animation) -> None:
    mesh = animation.meshes[0]
    source, _, uvs = split_seams(mesh)
    corners = torch.stack([mesh.faces.ravel(), mesh.face_uvs.ravel()], dim=1)
    assert len(source) == len(corners.unique(dim=0)) > len(mesh.vertices)
    assert len(uvs) == len(source)


def posed_by_skin(gltf: pygltflib.GLTF2, frame: int) -> np.ndarray:
    """The skinned mesh at a key, by the rules of glTF 2.0 section 3.7.3: (M, 3), Y up."""
    animated = channels(gltf)
    worlds: dict[int, np.ndarray] = {}

    def visit(index: int, parent: np.ndarray) -> None:
        node, local = gltf.nodes[index], np.eye(4)
        if (index, "rotation") in animated:
            local[:3, :3] = Rotation.from_quat(animated[index, "rotation"][frame]).as_matrix()
        shift = animated.get((index, "translation"))
        local[:3, 3] = shift[frame] if shift is not None else (node.translation or [0, 0, 0])
        worlds[index] = parent @ local
        for child in node.children or []:
            visit(child, worlds[index])

    for root in gltf.scenes[0].nodes:
        visit(root, np.eye(4))
    skin_node = next(node for node in gltf.nodes if node.skin is not None)
    rig = gltf.skins[skin_node.skin]
    inverse_bind = read(gltf, rig.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    palette = np.stack([worlds[joint] for joint in rig.joints]) @ inverse_bind
    attributes = gltf.meshes[skin_node.mesh].primitives[0].attributes
    joints = read(gltf, attributes.JOINTS_0).astype(int)
    blended = np.einsum("vi,viab->vab", read(gltf, attributes.WEIGHTS_0), palette[joints])
    points = read(gltf, attributes.POSITION)
    return np.einsum("vab,vb->va", blended[:, :3, :3], points) + blended[:, :3, 3]


def test_body_follows_its_joints(glb: Path, animation: Animation) -> None:
    gltf = pygltflib.GLTF2().load(str(glb))
    body = animation.body
    assert body is not None
    node = next(node for node in gltf.nodes if node.skin is not None)
    source = np.array(gltf.meshes[node.mesh].extras["source_vertices"])
    four = body.weights.topk(4, dim=1)
    pruned = torch.zeros_like(body.weights).scatter(1, four.indices, four.values)
    pruned /= pruned.sum(1, keepdim=True)
    for frame in (0, 13, len(animation) - 1):
        written = to_z_up(posed_by_skin(gltf, frame))
        transforms = torch.from_numpy(animation.transforms[frame : frame + 1])
        expected = skin(body.mesh.vertices, pruned, transforms)[0].numpy()
        assert np.abs(written - expected[source]).max() < 1e-5
        full = skin(body.mesh.vertices, body.weights, transforms)[0].numpy()
        error = np.linalg.norm(written - full[source], axis=1)
        print(f"frame {frame}: mean {error.mean() * 1e3:.3f} mm, max {error.max() * 1e3:.2f} mm")
        assert error.mean() < 2e-4


def test_khronos_validator_finds_nothing(glb: Path) -> None:
    modules = os.environ.get("NODE_PATH", "")
    node = shutil.which("node")
    if node is None or not (Path(modules) / "gltf-validator").is_dir():
        pytest.skip("needs node, and NODE_PATH naming the folder of the npm package gltf-validator")
    script = (
        "const v=require('gltf-validator'),fs=require('fs');"
        "v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])),{maxIssues:20})"
        ".then(r=>console.log(JSON.stringify(r.issues)));"
    )
    ran = subprocess.run(
        [node, "-e", script, str(glb)], capture_output=True, text=True, check=True, timeout=120
    )
    issues = json.loads(ran.stdout)
    assert issues["numErrors"] == 0, issues["messages"]
    assert issues["numWarnings"] == 0, issues["messages"]
