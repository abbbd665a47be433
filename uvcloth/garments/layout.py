"""The UV layout of a garment's mesh."""

from rasterize.layout import Layout, layout_of_uvs, unwrap
from uvcloth.geometry.mesh import Mesh


def own_layout(mesh: Mesh) -> Layout:
    """A mesh's own texture coordinates as a layout of all of its faces; unwrapped where it has none."""
    if len(mesh.uvs):
        return layout_of_uvs(mesh.uvs, mesh.face_uvs)
    return layout_of_uvs(*unwrap(mesh.vertices, mesh.faces, "garment"))
