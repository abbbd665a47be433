"""Outfits that are shown with wrinkles: garments on finer meshes, displaced, and kept off each other."""

from collections.abc import Sequence

from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.outfit_clearing import FOLLOWING, OutfitClearing
from uvcloth.physics.surface import BodySurface
from uvcloth.player.clearing import ClearingMemory
from uvcloth.wrinkles.model import WrinkledGarment, Wrinkles


class WrinkledOutfit:
    """The garments of a rollout, some of them with wrinkles, frame after frame.

    meshes: at rest, refined where there are wrinkles. lines: a sentence on each garment.
    """

    def __init__(self, wrinkles: Wrinkles, outfit: Outfit, meshes: Sequence[Mesh], quality: str) -> None:
        """Lay out the garments that the network serves; the others stay plain, and a line says why.

        meshes: those that are shown, at rest. quality: of the cages that move the garments.
        """
        visible, self._garments, lines = list(meshes), dict[int, WrinkledGarment](), []
        for place, garment in enumerate(outfit.garments):
            reason = wrinkles.unsupported_reason(garment, quality)
            if not reason and meshes[place] is not garment.mesh:
                reason = f"garment {garment.name}: is moved by a proxy, on which there are no wrinkles"
            if not reason:
                try:
                    wrinkled = WrinkledGarment(wrinkles, garment)
                except InputError as error:
                    reason = str(error)
                else:
                    self._garments[place], visible[place] = wrinkled, wrinkled.mesh
                    lines.append(f"  {garment.name}: wrinkles on {len(wrinkled.mesh.vertices)} vertices")
            if reason:
                lines.append(f"  {reason}: it stays plain")
        body = outfit.body
        self.meshes, self.lines = tuple(visible), tuple(lines)
        # A garment keeps off the skin by itself.
        self._clearing = OutfitClearing.of(body, visible) if len(visible) > 1 else None
        self._cleared: ClearingMemory | None = None
        self._skin = BodySurface(body.mesh.vertices, body.mesh.faces)

    def begin(self) -> None:
        """Forget the frames before: the next one follows nothing."""
        self._cleared = None
        for garment in self._garments.values():
            garment.begin()

    def shown(self, garments: Sequence[Tensor], body_vertices: Tensor, fps: float) -> tuple[Tensor, ...]:
        """Vertices (n, 3) m of the meshes in the next frame, in the world.

        garments: (N, 3) m of the rollout. body_vertices: (V, 3) m, posed.
        """
        if not self._garments:
            return tuple(garments)
        self._skin.update(body_vertices)
        wrinkled = [
            self._garments[place].wrinkled(vertices, fps, self._skin) if place in self._garments else vertices
            for place, vertices in enumerate(garments)
        ]
        if self._clearing is None:
            return tuple(wrinkled)
        points = [vertices[mesh.kept] for vertices, mesh in zip(wrinkled, self._clearing.meshes, strict=True)]
        collider = self._clearing.collider(body_vertices)
        self._cleared, finished = self._clearing.clear(
            points, collider, body_vertices, self._cleared or self._clearing.start(), FOLLOWING
        )
        return finished
