"""The visible body: a character's own meshes instead of the surface that cloth collides with."""

from dataclasses import replace

from uvcloth.bodies.body import Body
from uvcloth.bodies.regions import face_regions


def visible_body(body: Body) -> Body:
    """The body with the mesh that pictures and files show; without an appearance, the body itself."""
    if body.appearance is None:
        return body
    mesh, weights = body.appearance.mesh, body.appearance.weights
    regions, sides = face_regions(body.skeleton, weights, mesh.faces)
    return replace(
        body, mesh=mesh, weights=weights, regions=regions, sides=sides, appearance=None, pose_shapes=None
    )
