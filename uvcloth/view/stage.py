"""Meshes of the live view: a body and its garments in a viser scene, moved frame after frame."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.bodies.visible import visible_body
from uvcloth.geometry.mesh import Mesh
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS, Color
from uvcloth.view.heat import COLORS, bands

CELL = 1.0
"""Metres between two thick lines of the floor."""

FADING = 15.0
"""Metres from the camera to where the floor is not drawn."""


class BodyNode:
    """A body whose vertices are sent for every frame, as those of its garments are.

    A browser would move joints at once and cloth later, so that a figure would leave its clothes.
    """

    def __init__(self, scene: Any, name: str, body: Body) -> None:
        self._body = body
        self._node = scene.add_mesh_simple(
            name, body.mesh.vertices.numpy(), body.mesh.faces.numpy(), color=BODY_COLOR
        )

    def move(self, transforms: Tensor) -> None:
        """Pose the body by joint transforms (J, 3, 4)."""
        self._node.vertices = posed_skin(self._body, transforms[None])[0].numpy()


class GarmentNode:
    """A garment in its colour, or with a heat map as one mesh per band of values."""

    def __init__(self, scene: Any, name: str, mesh: Mesh, color: Color) -> None:
        self._scene, self._name, self.faces = scene, name, mesh.faces
        self._colors = (tuple(round(255 * channel) for channel in color), *COLORS)
        self._nodes: list[Any] = [None] * len(self._colors)

    def move(self, vertices: Tensor, values: Tensor | None = None, largest: float = 1.0) -> None:
        """Place vertices (N, 3) m; with values (N,) as a heat map from zero to the largest."""
        nothing = self.faces[:0]
        if values is None:
            parts = [self.faces, *[nothing] * len(COLORS)]
        else:
            parts = [nothing, *bands(values, self.faces, largest)]
        for index, faces in enumerate(parts):
            self._draw(index, vertices, faces)

    def _draw(self, index: int, vertices: Tensor, faces: Tensor) -> None:
        """Draw some of the faces in the colour of that index."""
        node = self._nodes[index]
        if not len(faces):
            if node is not None:
                node.visible = False
            return
        if index:
            used, faces = faces.unique(return_inverse=True)
            vertices = vertices[used]
        if node is None:
            self._nodes[index] = self._scene.add_mesh_simple(
                f"{self._name}/{index}",
                vertices.numpy(),
                faces.numpy(),
                color=self._colors[index],
                side="double",
            )
            return
        node.vertices = vertices.numpy().astype(np.float32)
        if index:
            node.faces = faces.numpy().astype(np.uint32)
        node.visible = True


class Floor:
    """A grid without end, which stands still in the world while the camera follows a figure over it."""

    def __init__(self, scene: Any) -> None:
        self._node = scene.add_grid(
            "/floor",
            infinite_grid=True,
            cell_size=CELL / 4,
            section_size=CELL,
            fade_distance=FADING,
        )

    def move(self, place: Tensor) -> None:
        """Have the figure at a place (3,) m of the floor."""
        self._node.position = tuple((-place.remainder(CELL)).tolist())


class Actor:
    """A body in its garments, at a place of its own beside others: `aside` metres along x."""

    def __init__(self, scene: Any, name: str, body: Body, meshes: Sequence[Mesh], aside: float = 0.0) -> None:
        self._root = scene.add_frame(f"/{name}", show_axes=False, position=(aside, 0.0, 0.0))
        self._body = BodyNode(scene, f"/{name}/body", visible_body(body))
        self._garments = [
            GarmentNode(scene, f"/{name}/garment_{index}", mesh, GARMENT_COLORS[index % len(GARMENT_COLORS)])
            for index, mesh in enumerate(meshes)
        ]

    def move(
        self,
        transforms: Tensor,
        garments: Sequence[Tensor],
        values: Sequence[Tensor] | None = None,
        largest: float = 1.0,
    ) -> None:
        """Show a frame: joint transforms (J, 3, 4), garments (N, 3) m, and maybe values (N,) of each."""
        self._body.move(transforms)
        for index, (node, vertices) in enumerate(zip(self._garments, garments, strict=True)):
            node.move(vertices, None if values is None else values[index], largest)

    def remove(self) -> None:
        """Take everything out of the scene."""
        self._root.remove()
