"""Baked files: skinned garments of a character in glTF 2.0 binary, and what the runtime plays them by.

docs/runtime_file.md is the schema of the extension.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from uvcloth.bodies.body import Body
from uvcloth.characters.joints import OwnJoints
from uvcloth.garments.garment import Garment
from uvcloth.geometry.skinning import strongest
from uvcloth.player.baked import EXTENSION, FABRIC, VERSION, ClothSkin
from uvcloth.rendering.render import GARMENT_COLORS
from uvcloth.writers.glb import Document, index_type
from uvcloth.writers.gltf_body import add_body
from uvcloth.writers.gltf_nodes import animate_nodes
from uvcloth.writers.gltf_scene import GLTF_INFLUENCES, TO_Y_UP, add_influences, add_skeleton
from uvcloth.writers.gltf_surface import add_surface


def add_own_body(document: Document, body: Body) -> ClothSkin:
    """Add a body of ours and its skeleton; garments share its skin."""
    first = len(document.nodes)
    skin, _ = add_skeleton(document, body.skeleton)
    add_body(document, body, skin, compact=True)
    count = len(body.skeleton.names)
    axes = np.eye(4)
    axes[:3, :3] = TO_Y_UP.T
    inverse_bind = np.tile(np.eye(4), (count, 1, 1))
    inverse_bind[:, :3, 3] = -(body.skeleton.heads.numpy() @ TO_Y_UP.T)
    return ClothSkin(skin, tuple(range(first, first + count)), body.skeleton.names, axes, inverse_bind)


def add_cloth_skin(document: Document, joints: OwnJoints) -> ClothSkin:
    """Add a skin for garments to the document of a character's file, on joints that it has."""
    columns = joints.inverse_bind.swapaxes(1, 2).reshape(-1, 16)
    document.skins.append(
        {
            "name": EXTENSION,
            "inverseBindMatrices": document.array(columns, "MAT4"),
            "joints": list(joints.nodes),
        }
    )
    return ClothSkin(len(document.skins) - 1, joints.nodes, joints.names, joints.axes, joints.inverse_bind)


def add_cloth(document: Document, skin: ClothSkin, garments: Sequence[Garment], content: bytes) -> None:
    """Add skinned garments, the innermost first, and the extension with the runtime's bytes.

    The weights of the garments are of the skin's joints, in their order.
    """
    # What `add_surface` turns to Y up then has the axes and the unit of the scene.
    to_scene = TO_Y_UP.T @ np.linalg.inv(skin.axes)[:3, :3]
    entries = []
    for index, garment in enumerate(garments):
        points = garment.mesh.vertices.new_tensor(garment.mesh.vertices.numpy() @ to_scene.T)
        color = GARMENT_COLORS[index % len(GARMENT_COLORS)]
        mesh = replace(garment.mesh, vertices=points)
        source, primitives = add_surface(document, garment.name, mesh, color)
        joints, weights = strongest(garment.smooth_weights, GLTF_INFLUENCES)
        influences = add_influences(document, joints[source], weights[source], compact=True)
        for primitive in primitives:
            primitive["attributes"] |= influences
        node = document.mesh(garment.name, primitives, skin.skin)
        vertices = document.array(source, "SCALAR", index_type(len(source)))
        fabric = [getattr(garment.fabric, name) for name in FABRIC]
        entries.append({"node": node, "vertices": vertices, "fabric": fabric})
    extension = {
        "version": VERSION,
        "bufferView": document.content(content),
        "skin": skin.skin,
        "axes": skin.axes.T.ravel().tolist(),
        "joints": list(skin.names),
        "garments": entries,
    }
    document.extend(EXTENSION, extension)


def animate_cloth(document: Document, skin: ClothSkin, transforms: np.ndarray, fps: float) -> None:
    """Move the joints by transforms (F, J, 3, 4) from rest, metres, Z up."""
    times = np.arange(len(transforms), dtype=np.float32) / np.float32(fps)
    time = document.array(times, "SCALAR", bounds=True)
    animate_nodes(document, skin.nodes, skin.worlds(transforms), time)
