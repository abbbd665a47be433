"""Vertices of cloth on an artist's mesh: an attribute, which a modifier below Armature reads.

The mesh, its UV maps, materials, shape keys and vertex groups stay as they are; what is below in the stack
gets the cloth. Taken off, nothing is left.
"""

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

PLACES, SOURCE = "uvcloth_places", "uvcloth_vertex"
"""Attributes of a mesh: where the cloth is, and the runtime's vertex of each vertex."""

MODIFIER, GROUP, CACHE = "uvcloth", "uvcloth", "uvcloth cache"
"""Names of the modifier, of its nodes, and of the modifier that plays a cache."""

GENERATING = {
    *("ARRAY", "BEVEL", "BOOLEAN", "BUILD", "DECIMATE", "EDGE_SPLIT", "MASK", "MIRROR", "MULTIRES", "NODES"),
    *("REMESH", "SCREW", "SKIN", "SOLIDIFY", "SUBSURF", "TRIANGULATE", "VOLUME_TO_MESH", "WELD", "WIREFRAME"),
}
"""Modifiers that make other vertices."""


def put_source(mesh: Any, vertices: Sequence[int] | NDArray[np.int64]) -> None:
    """Note the runtime's vertex of each of the V vertices of a mesh."""
    _drop_attribute(mesh, SOURCE)
    mesh.attributes.new(SOURCE, "INT", "POINT").data.foreach_set("value", np.asarray(vertices, np.int32))


def source_of(garment: Any) -> NDArray[np.int32]:
    """The runtime's vertex of each vertex of an object. Raises ValueError if it has lost them."""
    attribute = garment.data.attributes.get(SOURCE)
    if attribute is None or attribute.domain != "POINT" or attribute.data_type != "INT":
        raise ValueError(f"{garment.name} has lost its attribute {SOURCE}: open the character again")
    source = np.empty(len(attribute.data), np.int32)
    attribute.data.foreach_get("value", source)
    return source


def put_on(garment: Any) -> None:
    """Give an object the attribute and the modifier, if it has none.

    Raises ValueError for a modifier above the place of ours that makes vertices.
    """
    modifier = garment.modifiers.get(MODIFIER)
    if modifier is None:
        place = place_of_cloth(garment)
        modifier = garment.modifiers.new(MODIFIER, "NODES")
        modifier.node_group = bpy.data.node_groups.get(GROUP) or _nodes()
        garment.modifiers.move(len(garment.modifiers) - 1, place)
    if PLACES not in garment.data.attributes:
        garment.data.attributes.new(PLACES, "FLOAT_VECTOR", "POINT")


def place_of_cloth(garment: Any) -> int:
    """Place in an object's stack of modifiers for one that moves its vertices: below Armature, or first.

    Raises ValueError for a modifier above that makes vertices.
    """
    kinds = [modifier.type for modifier in garment.modifiers]
    place = max((index + 1 for index, kind in enumerate(kinds) if kind == "ARMATURE"), default=0)
    for modifier in garment.modifiers[:place]:
        if modifier.type in GENERATING:
            raise ValueError(
                f"modifier {modifier.name} of {garment.name} makes vertices before Armature: move it below"
            )
    return place


def take_off(garment: Any) -> None:
    """Take the attribute and the modifier off an object."""
    modifier = garment.modifiers.get(MODIFIER)
    if modifier is not None:
        garment.modifiers.remove(modifier)
    _drop_attribute(garment.data, PLACES)
    group = bpy.data.node_groups.get(GROUP)
    if group is not None and not group.users:
        bpy.data.node_groups.remove(group)


def move(garment: Any, vertices: NDArray[Any]) -> None:
    """Move the cloth of an object to vertices (V, 3) in its own axes."""
    places = garment.data.attributes[PLACES].data
    places.foreach_set("vector", np.ascontiguousarray(vertices, np.float32).ravel())
    garment.data.update_tag()


def places(garment: Any) -> NDArray[np.float32]:
    """Places (V, 3) to which the cloth of an object was moved last."""
    values = np.empty(3 * len(garment.data.vertices), np.float32)
    garment.data.attributes[PLACES].data.foreach_get("vector", values)
    return values.reshape(-1, 3)


def _drop_attribute(mesh: Any, name: str) -> None:
    attribute = mesh.attributes.get(name)
    if attribute is not None:
        mesh.attributes.remove(attribute)


def _nodes() -> Any:
    """The node group: every vertex goes to its attribute, and stays where the mesh has none."""
    group = bpy.data.node_groups.new(GROUP, "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    kinds = (
        "NodeGroupInput",
        "GeometryNodeInputNamedAttribute",
        "GeometryNodeSetPosition",
        "NodeGroupOutput",
    )
    start, places, moved, end = (group.nodes.new(kind) for kind in kinds)
    for column, node in enumerate((start, places, moved, end)):
        node.location = (200.0 * column, -150.0 * (node is places))
    places.data_type = "FLOAT_VECTOR"
    places.inputs["Name"].default_value = PLACES
    group.links.new(start.outputs[0], moved.inputs["Geometry"])
    group.links.new(places.outputs["Attribute"], moved.inputs["Position"])
    group.links.new(places.outputs["Exists"], moved.inputs["Selection"])
    group.links.new(moved.outputs[0], end.inputs[0])
    return group
