"""A .glb evaluated by the rules of glTF 2.0, section 3.7, with pygltflib and numpy and nothing of ours."""

import json
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib
import pytest
from scipy.spatial.transform import Rotation

KINDS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
DTYPES = {5126: np.float32, 5125: np.uint32, 5123: np.uint16, 5121: np.uint8}

Locals = dict[int, np.ndarray]


def to_z_up(points: np.ndarray) -> np.ndarray:
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)


@dataclass(frozen=True)
class GlbReader:
    """frame: index of a key of the animation; None is the file as it stands without playing."""

    gltf: pygltflib.GLTF2

    @classmethod
    def load(cls, path: Path) -> "GlbReader":
        return cls(pygltflib.GLTF2().load(str(path)))

    def read(self, index: int) -> np.ndarray:
        accessor = self.gltf.accessors[index]
        view = self.gltf.bufferViews[accessor.bufferView]
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        count = accessor.count * KINDS[accessor.type]
        values = np.frombuffer(self.gltf.binary_blob(), DTYPES[accessor.componentType], count, start)
        largest = np.iinfo(values.dtype).max if accessor.normalized else 1
        return values.reshape(accessor.count, -1).astype(np.float64) / largest

    def channels(self) -> dict[tuple[int, str], np.ndarray]:
        """(node, path) -> the values at all keys."""
        if not self.gltf.animations:
            return {}
        animation = self.gltf.animations[0]
        return {
            (c.target.node, c.target.path): self.read(animation.samplers[c.sampler].output)
            for c in animation.channels
        }

    def times(self) -> np.ndarray:
        return self.read(self.gltf.animations[0].samplers[0].input)[:, 0]

    def node(self, name: str) -> int:
        return next(index for index, node in enumerate(self.gltf.nodes) if node.name == name)

    def mesh(self, name: str) -> Any:
        return self.gltf.meshes[self.gltf.nodes[self.node(name)].mesh]

    def source(self, name: str) -> np.ndarray:
        return np.array(self.mesh(name).extras["source_vertices"])

    def locals(self, frame: int | None) -> Locals:
        """Each node's own matrix (4, 4)."""
        animated = self.channels() if frame is not None else {}
        found = {}
        for index, node in enumerate(self.gltf.nodes):
            turn = animated.get((index, "rotation"))
            shift = animated.get((index, "translation"))
            matrix = np.eye(4)
            if node.matrix is not None:
                found[index] = np.array(node.matrix).reshape(4, 4).T
                continue
            quaternion = turn[frame] if turn is not None else (node.rotation or [0, 0, 0, 1])
            matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
            matrix[:3, :3] *= node.scale or [1, 1, 1]
            matrix[:3, 3] = shift[frame] if shift is not None else (node.translation or [0, 0, 0])
            found[index] = matrix
        return found

    def weights(self, name: str, frame: int | None) -> np.ndarray:
        mesh, track = self.mesh(name), self.channels().get((self.node(name), "weights"))
        if frame is None or track is None:
            return np.array(mesh.weights or [])
        return track.reshape(-1, len(mesh.primitives[0].targets))[frame]

    def morphed(self, name: str, weights: np.ndarray, attribute: str = "POSITION") -> np.ndarray:
        primitive = self.mesh(name).primitives[0]
        base = self.read(getattr(primitive.attributes, attribute))
        targets = [self.read(target[attribute]) for target in primitive.targets or []]
        return base + np.einsum("t,tvc->vc", weights, np.array(targets).reshape(-1, *base.shape))

    def skinned(self, name: str, points: np.ndarray, own: Locals) -> np.ndarray:
        """Points of a mesh (M, 3) on joints whose nodes have these matrices."""
        worlds: Locals = {}

        def visit(index: int, parent: np.ndarray) -> None:
            worlds[index] = parent @ own[index]
            for child in self.gltf.nodes[index].children or []:
                visit(child, worlds[index])

        for root in self.gltf.scenes[0].nodes:
            visit(root, np.eye(4))
        skin = self.gltf.skins[self.gltf.nodes[self.node(name)].skin]
        inverse_bind = self.read(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        palette = np.stack([worlds[joint] for joint in skin.joints]) @ inverse_bind
        attributes = self.mesh(name).primitives[0].attributes
        joints = self.read(attributes.JOINTS_0).astype(int)
        blended = np.einsum("vi,viab->vab", self.read(attributes.WEIGHTS_0), palette[joints])
        return np.einsum("vab,vb->va", blended[:, :3, :3], points) + blended[:, :3, 3]

    def posed(self, name: str, frame: int | None) -> np.ndarray:
        """Vertices (M, 3) of a skinned mesh, Z up."""
        points = self.morphed(name, self.weights(name, frame))
        return to_z_up(self.skinned(name, points, self.locals(frame)))


def node_script(script: str, *arguments: str, module: str) -> str:
    """What a Node script prints. Skips the test where node or the npm package is absent."""
    modules = os.environ.get("NODE_PATH", "")
    node = shutil.which("node")
    if node is None or not (Path(modules) / module).is_dir():
        pytest.skip(f"needs node, and NODE_PATH naming the folder of the npm package {module}")
    ran = subprocess.run(
        [node, "-e", script, *arguments], capture_output=True, text=True, check=True, timeout=300
    )
    return ran.stdout


def require_clean(path: Path) -> None:
    """The Khronos validator finds no error and no warning."""
    script = (
        "const v=require('gltf-validator'),fs=require('fs');"
        "v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])),{maxIssues:20})"
        ".then(r=>console.log(JSON.stringify(r.issues)));"
    )
    issues = json.loads(node_script(script, str(path), module="gltf-validator"))
    assert issues["numErrors"] == 0, issues["messages"]
    assert issues["numWarnings"] == 0, issues["messages"]
