"""Characters made up of our own body: foreign names, axes, unit and bind pose, in any number of meshes."""

import json
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from torch import Tensor

from tests.motion.families import FAMILIES
from tests.motion.layouts import ROLES
from tests.small_gltf import write_glb
from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.rotations import from_euler
from uvcloth.geometry.skeleton import Skeleton, joint_transforms
from uvcloth.geometry.skinning import skin, strongest
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf_scene import TO_Y_UP, add_influences, add_skeleton
from uvcloth.writers.gltf_surface import add_surface

MIXAMO = {
    "LHipJoint": "mixamorig:LeftHelper", "RHipJoint": "mixamorig:RightHelper", "LowerBack": "mixamorig:Spine",
    "Spine": "mixamorig:Spine1", "Spine1": "mixamorig:Spine2", "Neck1": "mixamorig:NeckHelper",
    "LThumb": "mixamorig:LeftHandThumb1", "RThumb": "mixamorig:RightHandThumb1",
    "LeftFingerBase": "mixamorig:LeftPalm", "RightFingerBase": "mixamorig:RightPalm",
    "LeftHandFinger1": "mixamorig:LeftHandMiddle1", "RightHandFinger1": "mixamorig:RightHandMiddle1",
}  # fmt: skip


@dataclass(frozen=True)
class Piece:
    """A mesh of a character: faces (F, 3) of the body's, moved off the skin by `off` metres.

    textured: with texture coordinates, a projection; without, the mesh is unwrapped, which takes seconds.
    """

    name: str
    material: str
    faces: Tensor
    off: float = 0.0
    textured: bool = True


def with_box(body: Body, joint: str, centre: Sequence[float], size: Sequence[float]) -> Body:
    """The body with a box in its mesh, of 768 faces that a joint moves; sizes in metres."""
    box = trimesh.creation.box(extents=size).subdivide().subdivide().subdivide()
    vertices = torch.tensor(box.vertices, dtype=torch.float32) + torch.tensor(centre)
    weights = torch.zeros(len(vertices), len(body.skeleton.names))
    weights[:, body.skeleton.names.index(joint)] = 1.0
    faces = torch.tensor(box.faces.copy()) + len(body.mesh.vertices)
    faces = torch.cat([body.mesh.faces, faces])
    mesh = Mesh(torch.cat([body.mesh.vertices, vertices]), faces, torch.zeros(0, 2), faces)
    return replace(body, mesh=mesh, weights=torch.cat([body.weights, weights]))


def t_posed(body: Body, degrees: float = 40.0) -> Body:
    """The body with its arms raised by so many degrees, as its rest pose."""
    names, parents = body.skeleton.names, body.skeleton.parents
    turns = [torch.eye(3)] * len(names)
    for joint, parent in enumerate(parents):
        turns[joint] = turns[parent] if parent >= 0 else turns[joint]
        if names[joint] in ("LeftArm", "RightArm"):
            angle = -degrees if names[joint] == "LeftArm" else degrees
            turns[joint] = from_euler("y", torch.tensor([angle * torch.pi / 180]))
            turns[joint] = turns[joint].reshape(3, 3)
    transforms = joint_transforms(body.skeleton, torch.stack(turns)[None], body.skeleton.heads[:1])
    heads = (transforms[0, :, :, :3] @ body.skeleton.heads[..., None]).squeeze(-1) + transforms[0, ..., 3]
    vertices = skin(body.mesh.vertices, body.weights, transforms)[0]
    return replace(
        body,
        mesh=replace(body.mesh, vertices=vertices),
        skeleton=replace(body.skeleton, heads=heads),
    )


def write_character(
    path: Path,
    body: Body,
    pieces: Sequence[Piece],
    names: Mapping[str, str] = MIXAMO,
    unit: float = 0.01,
    skinned: bool = True,
) -> None:
    """Write pieces of a body as a character, modelled Z up in units of metres; the scene is Y up."""
    # What the exporter turns to Y up then stands Z up in the file, below a node that turns it.
    turned = torch.from_numpy(np.linalg.inv(TO_Y_UP).T.astype(np.float32)) / unit
    document = Document()
    renamed = tuple(names.get(name, f"mixamorig:{name}") for name in body.skeleton.names)
    first = add_skeleton(document, Skeleton(renamed, body.skeleton.parents, body.skeleton.heads @ turned))[1]
    matrix = np.eye(4)
    matrix[:3, :3] = unit * TO_Y_UP
    document.nodes.append({"name": "Armature", "matrix": matrix.T.ravel().tolist(), "children": [first]})
    document.roots[:] = [len(document.nodes) - 1]
    normals = torch.nn.functional.normalize(body.mesh.vertices - body.mesh.vertices.mean(0), dim=1)
    for piece in pieces:
        used, faces = piece.faces.unique(return_inverse=True)
        vertices = (body.mesh.vertices + piece.off * normals)[used] @ turned
        mesh = Mesh(vertices, faces, _projected(vertices) if piece.textured else torch.zeros(0, 2), faces)
        source, (primitive,) = add_surface(document, piece.material, mesh, (0.5, 0.5, 0.5))
        joints, weights = strongest(body.weights[used], 4)
        primitive["attributes"] |= add_influences(document, joints[source], weights[source])
        document.mesh(piece.name, [primitive], 0 if skinned else None)
    if not skinned:
        document.skins.clear()
    document.write(path)


def _projected(vertices: Tensor) -> Tensor:
    """Texture coordinates (V, 2) of vertices (V, 3) seen from the front."""
    low, high = vertices.amin(0), vertices.amax(0)
    return ((vertices - low) / (high - low))[:, [0, 2]]


def rewritten(path: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """Change the JSON of a .glb in place."""
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    written, binary = json.loads(content[20 : 20 + length]), content[28 + length :]
    change(written)
    return write_glb(path, written, binary)


def vrm_table(version: str, names: Mapping[str, str]) -> Callable[[dict[str, Any]], None]:
    """A change that says which node is which human bone, as VRM 0.x or 1.0 files do.

    names: of the nodes, by joint of our body.
    """
    bones = FAMILIES["VRM"].names()
    human = {names[joint]: bones[role] for joint, role in ROLES.items() if role in bones}

    def change(written: dict[str, Any]) -> None:
        named = {node.get("name", ""): index for index, node in enumerate(written["nodes"])}
        nodes = {bone: named[name] for name, bone in human.items()}
        table: Any = {bone: {"node": node} for bone, node in nodes.items()}
        if version == "VRM":
            table = [{"bone": bone, "node": node} for bone, node in reversed(nodes.items())]
        written["extensions"] = {version: {"humanoid": {"humanBones": table}}}

    return change
