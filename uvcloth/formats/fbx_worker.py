"""An FBX file as glTF 2.0, run as `python fbx_worker.py FILE.fbx` beside the program that asks.

Never imported: ufbx 0.0.5, a binding of a C library, ends the process where it counts references wrongly.
Writes a .glb to standard output: the nodes, the triangles with their first set of texture coordinates, a skin
for each mesh on the same joints, the base colours of materials with their textures, and each animation
sampled at the rate of the file. The root node turns and scales to glTF's axes and metre. Morph targets stay
at zero. A file that cannot be converted leaves its reason in the last line of standard error.
"""

import ctypes
import json
import os
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import ufbx

MOST_SAMPLES = 20_000_000
"""Most frames times joints of all animations of a file."""

RATES = (24.0, 120.0)
"""Least and greatest frames per second at which an animation is sampled."""

MOST_INFLUENCES = 8
"""Joints that move a vertex, the strongest ones."""

PICTURES = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}
"""Kinds of pictures by their first bytes."""

REFERENCES = 1 << 40
"""More references than a conversion uses up."""


class GltfBuilder:
    """A glTF document that grows, and its binary chunk."""

    def __init__(self) -> None:
        self.lists: dict[str, list[dict[str, Any]]] = {}
        self.binary = bytearray()

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Append an entry to a top-level list; its index."""
        entries = self.lists.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def view(self, content: bytes) -> int:
        """Append bytes as a buffer view; its index."""
        start = len(self.binary)
        self.binary += content + bytes(-len(content) % 4)
        return self.add("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(content)})

    def array(self, values: np.ndarray, kind: str) -> int:
        """Append an array (count, width) of float32, uint16 or uint32 as an accessor; its index."""
        code = {"float32": 5126, "uint16": 5123, "uint32": 5125}[values.dtype.name]
        entry = {"bufferView": self.view(values.tobytes()), "componentType": code}
        return self.add("accessors", {**entry, "count": len(values), "type": kind})

    def glb(self) -> bytes:
        """The bytes of the .glb."""
        buffers = [{"byteLength": len(self.binary)}] if self.binary else []
        document = {"asset": {"version": "2.0"}, "buffers": buffers, **self.lists}
        text = json.dumps({key: value for key, value in document.items() if value}).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self.binary), 0x004E4942) + self.binary
        return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def main(path: Path) -> None:
    """Convert."""
    scene = _keep(
        ufbx.load_file(
            str(path),
            target_axes=ufbx.axes_right_handed_y_up,
            target_unit_meters=1.0,
            geometry_transform_handling=ufbx.GeometryTransformHandling.HELPER_NODES,
            inherit_mode_handling=ufbx.InheritModeHandling.COMPENSATE,
        )
    )
    for thing in (None, True, False, *_each(scene.elements)):
        _keep(thing)
    document = GltfBuilder()
    nodes = _each(scene.nodes)
    number = {node.typed_id: index for index, node in enumerate(nodes)}
    for node in nodes:
        children = [number[child.typed_id] for child in _each(node.children)]
        entry = {"name": node.name, **_transform(node.local_transform)}
        document.add("nodes", {**entry, "children": children} if children else entry)
    document.add("scenes", {"nodes": [index for index, node in enumerate(nodes) if node.parent is None]})
    joints = _joints(scene, nodes, number)
    for material in _each(scene.materials):
        document.add("materials", _material(document, path, material))
    _add_meshes(document, scene, nodes, number, joints)
    if joints and "skins" not in document.lists:
        document.add("skins", {"joints": joints})
    for stack in _each(scene.anim_stacks):
        _add_animation(document, scene, stack, nodes, number, joints)
    sys.stdout.buffer.write(document.glb())
    sys.stdout.flush()


def _keep(thing: Any) -> Any:
    """The thing, never freed: the binding gives its elements, lists and constants without a new reference."""
    ctypes.c_ssize_t.from_address(id(thing)).value += REFERENCES
    return thing


def _each(things: Any) -> list[Any]:
    return [things[index] for index in range(len(things))]


def _array(things: Any) -> np.ndarray:
    """A list of numbers of the binding as an array."""
    return np.array(_keep(things))


def _matrix(matrix: Any) -> np.ndarray:
    """A matrix of the binding as (4, 4)."""
    return np.vstack([np.array([matrix.c0, matrix.c1, matrix.c2, matrix.c3]).T, [0.0, 0.0, 0.0, 1.0]])


def _transform(transform: Any) -> dict[str, list[float]]:
    return {
        "translation": list(transform.translation),
        "rotation": list(transform.rotation),
        "scale": list(transform.scale),
    }


def _joints(scene: Any, nodes: list[Any], number: dict[int, int]) -> list[int]:
    """Nodes that are bones or move vertices, and all nodes between them and their common ancestor.

    In a file without bones they are the nodes that show nothing, as motion studios export.
    """
    bones = {number[node.typed_id] for node in nodes if node.bone is not None}
    bones |= {number[cluster.bone_node.typed_id] for cluster in _clusters(scene)}
    if not bones:
        shown = ("mesh", "light", "camera")
        bones = {
            index
            for index, node in enumerate(nodes)
            if not node.is_root and all(getattr(node, kind) is None for kind in shown)
        }
    ways = [_way(nodes[bone], number) for bone in bones]
    if not ways:
        return []
    shared = 0
    while all(len(way) > shared and way[shared] == ways[0][shared] for way in ways):
        shared += 1
    top = max(shared - 1, 0)
    return sorted({node for way in ways for node in way[top:]})


def _way(node: Any, number: dict[int, int]) -> list[int]:
    """Nodes from the root to a node."""
    way = [number[node.typed_id]]
    while node.parent is not None:
        node = node.parent
        way.append(number[node.typed_id])
    return way[::-1]


def _clusters(scene: Any) -> Iterator[Any]:
    for deformer in _each(scene.skin_deformers):
        for cluster in _each(deformer.clusters):
            if cluster.bone_node is not None:
                yield cluster


def _material(document: GltfBuilder, path: Path, material: Any) -> dict[str, Any]:
    base = material.pbr.base_color
    rough: dict[str, Any] = {"baseColorFactor": list(base.value_vec4)}
    texture = base.texture
    if texture is not None:
        image = _image(path, texture.content, texture.relative_filename or texture.filename)
        if isinstance(image, bytes):
            kind = next((kind for start, kind in PICTURES.items() if image.startswith(start)), "image/other")
            source = document.add("images", {"bufferView": document.view(image), "mimeType": kind})
        else:
            source = document.add("images", {"uri": quote(image)})
        rough["baseColorFactor"] = [1.0, 1.0, 1.0, 1.0]
        rough["baseColorTexture"] = {"index": document.add("textures", {"source": source})}
    return {"name": material.name, "pbrMetallicRoughness": rough}


def _image(path: Path, content: bytes, name: str) -> bytes | str:
    """The picture of a texture: its bytes in the file, or its name beside the file."""
    if content:
        return bytes(content)
    name = name.replace("\\", "/")
    beside = name.rpartition("/")[2]
    return name if ".." not in name and (path.parent / name).is_file() else beside


def _add_meshes(
    document: GltfBuilder, scene: Any, nodes: list[Any], number: dict[int, int], joints: list[int]
) -> None:
    """Add the mesh of every node that has one, and its skin."""
    materials = {material.element_id: index for index, material in enumerate(_each(scene.materials))}
    place = {joint: index for index, joint in enumerate(joints)}
    bound = {
        place[number[cluster.bone_node.typed_id]]: _matrix(cluster.bind_to_world)
        for cluster in _clusters(scene)
    }
    world = [bound.get(index, _matrix(nodes[joint].node_to_world)) for index, joint in enumerate(joints)]
    for index, node in enumerate(nodes):
        mesh = node.mesh
        if mesh is None or not mesh.num_triangles:
            continue
        skins = _each(mesh.skin_deformers)
        clusters = [each for each in _each(skins[0].clusters) if each.bone_node is not None] if skins else []
        owners = [place[number[cluster.bone_node.typed_id]] for cluster in clusters]
        influences = _influences(mesh.num_vertices, clusters, owners) if clusters else []
        used = [materials[material.element_id] for material in _each(node.materials)]
        entry = document.lists["nodes"][index]
        entry["mesh"] = document.add("meshes", _mesh(document, mesh, used, influences))
        if clusters:
            to_world = world[owners[0]] @ _matrix(clusters[0].geometry_to_bone)
            inverse = np.linalg.inv(np.stack(world)) @ to_world
            values = inverse.swapaxes(1, 2).reshape(-1, 16).astype(np.float32)
            skin = {"joints": joints, "inverseBindMatrices": document.array(values, "MAT4")}
            entry["skin"] = document.add("skins", skin)


def _mesh(
    document: GltfBuilder, mesh: Any, materials: list[int], influences: list[tuple[np.ndarray, np.ndarray]]
) -> dict[str, Any]:
    """A mesh of one primitive for each material; a vertex on a seam of the texture is doubled."""
    ranges = _array(mesh.faces).astype(np.int64).reshape(-1, 2)
    corners = _array(mesh.vertex_indices).astype(np.int64)
    points = _array(mesh.vertices).reshape(-1, 3)
    kinds = _array(mesh.face_material) if len(mesh.face_material) else np.zeros(len(ranges), np.int64)
    # A polygon of n corners is n - 2 triangles around its first corner.
    turns = np.maximum(ranges[:, 1] - 2, 0)
    of = np.repeat(np.arange(len(ranges)), turns)
    step = np.arange(len(of)) - np.repeat(np.cumsum(turns) - turns, turns)
    first = ranges[of, 0]
    triangles = np.stack([first, first + step + 1, first + step + 2], axis=1)
    keys, uvs = corners[:, None], None
    if mesh.vertex_uv.exists:
        uv_of = _array(mesh.vertex_uv.indices).astype(np.int64)
        uvs = _array(mesh.vertex_uv.values).reshape(-1, 2)
        keys = np.stack([corners, uv_of], axis=1)
    unique, copy = np.unique(keys, axis=0, return_inverse=True)
    copy = copy.reshape(-1)
    source = unique[:, 0]
    attributes = {"POSITION": document.array(points[source].astype(np.float32), "VEC3")}
    if uvs is not None:
        attributes["TEXCOORD_0"] = document.array(
            (uvs[unique[:, 1]] * [1, -1] + [0, 1]).astype(np.float32), "VEC2"
        )
    for index, (joints, weights) in enumerate(influences):
        attributes[f"JOINTS_{index}"] = document.array(joints[source].astype(np.uint16), "VEC4")
        attributes[f"WEIGHTS_{index}"] = document.array(weights[source].astype(np.float32), "VEC4")
    primitives = []
    for kind in np.unique(kinds[of]):
        faces = copy[triangles[kinds[of] == kind]].reshape(-1, 1).astype(np.uint32)
        primitive: dict[str, Any] = {"attributes": attributes, "indices": document.array(faces, "SCALAR")}
        if kind < len(materials):
            primitive["material"] = materials[kind]
        primitives.append(primitive)
    return {"name": mesh.name, "primitives": primitives}


def _influences(vertices: int, clusters: list[Any], owners: list[int]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The strongest joints and weights of each vertex, in sets of four: (V, 4) and (V, 4)."""
    vertex = np.concatenate([_array(cluster.vertices).astype(np.int64).reshape(-1) for cluster in clusters])
    weight = np.concatenate([_array(cluster.weights).astype(np.float64).reshape(-1) for cluster in clusters])
    joint = np.repeat(owners, [cluster.num_weights for cluster in clusters])
    valid = (weight > 0) & (vertex < vertices)
    vertex, weight, joint = vertex[valid], weight[valid], joint[valid]
    order = np.lexsort((-weight, vertex))
    vertex, weight, joint = vertex[order], weight[order], joint[order]
    rank = np.arange(len(vertex)) - np.searchsorted(vertex, vertex)
    sets = []
    for start in range(0, min(int(rank.max(initial=0)) + 1, MOST_INFLUENCES), 4):
        rows = (rank >= start) & (rank < start + 4)
        joints, weights = np.zeros((vertices, 4)), np.zeros((vertices, 4))
        joints[vertex[rows], rank[rows] - start] = joint[rows]
        weights[vertex[rows], rank[rows] - start] = weight[rows]
        sets.append((joints, weights))
    return sets


def _add_animation(
    document: GltfBuilder, scene: Any, stack: Any, nodes: list[Any], number: dict[int, int], joints: list[int]
) -> None:
    """Add an animation: the transforms of the joints and of their ancestors at the rate of the file."""
    moving = sorted({node for joint in joints for node in _way(nodes[joint], number)})
    anim = _keep(stack.anim)
    rate = min(max(scene.settings.frames_per_second, RATES[0]), RATES[1])
    begin, end = stack.time_begin, stack.time_end
    if not (np.isfinite([begin, end]).all() and end > begin):
        return
    if (end - begin) * rate * len(moving) > MOST_SAMPLES:
        sys.exit(f"its animation {stack.name} lasts {end - begin:.0f} s, which is too long")
    times = np.arange(int((end - begin) * rate + 1e-3) + 1) / rate
    keys = document.array(times.astype(np.float32)[:, None], "SCALAR")
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for index in moving:
        sampled = [nodes[index].evaluate_transform(anim, begin + time) for time in times]
        for path, kind in (("translation", "VEC3"), ("rotation", "VEC4"), ("scale", "VEC3")):
            values = np.array([getattr(transform, path) for transform in sampled], dtype=np.float32)
            channels.append({"sampler": len(samplers), "target": {"node": index, "path": path}})
            samplers.append({"input": keys, "output": document.array(values, kind)})
    document.add("animations", {"name": stack.name, "channels": channels, "samplers": samplers})


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]))
    except ufbx.UfbxError as error:
        print(error, file=sys.stderr, flush=True)
        os._exit(1)
    # Without the end of the interpreter, which would free what the binding freed.
    os._exit(0)
