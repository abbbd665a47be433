"""The skinned body in glTF files, with the materials of a character."""

from uvcloth.bodies.body import Body
from uvcloth.export.glb import Document
from uvcloth.export.gltf_scene import GLTF_INFLUENCES, add_influences
from uvcloth.export.gltf_surface import add_surface
from uvcloth.geometry.skinning import strongest
from uvcloth.render import BODY_COLOR


def add_body(document: Document, body: Body, skin: int) -> None:
    """Add the skinned body, with the four strongest influences of each vertex."""
    source, primitives = add_surface(document, "body", body.mesh, BODY_COLOR)
    joints, weights = strongest(body.weights, GLTF_INFLUENCES)
    influences = add_influences(document, joints[source], weights[source])
    for primitive in primitives:
        primitive["attributes"] |= influences
    document.mesh("body", primitives, skin, extras={"source_vertices": source.tolist()})
