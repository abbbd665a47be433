"""The skinned body in glTF files, with the materials of a character."""

from uvcloth.bodies.body import Body
from uvcloth.geometry.skinning import strongest
from uvcloth.rendering.render import BODY_COLOR
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf_scene import GLTF_INFLUENCES, add_influences
from uvcloth.writers.gltf_surface import add_surface


def add_body(document: Document, body: Body, skin: int, compact: bool = False) -> None:
    """Add the skinned body, with the four strongest influences of each vertex.

    compact: weights as in `add_influences`, and no list of the source vertices.
    """
    source, primitives = add_surface(document, "body", body.mesh, BODY_COLOR)
    joints, weights = strongest(body.weights, GLTF_INFLUENCES)
    influences = add_influences(document, joints[source], weights[source], compact)
    for primitive in primitives:
        primitive["attributes"] |= influences
    extras = {} if compact else {"extras": {"source_vertices": source.tolist()}}
    document.mesh("body", primitives, skin, **extras)
