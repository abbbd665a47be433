"""Outfits that are shown with wrinkles: garments on finer meshes, displaced, then cleared from the skin."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.outfit_clearing import OutfitClearing
from uvcloth.physics.surface import BodySurface
from uvcloth.wrinkles.model import WrinkledGarment, Wrinkles


@dataclass(frozen=True)
class WrinkledOutfit:
    """The garments of a rollout, some of them with wrinkles.

    body: that wears them. meshes: at rest, refined where there are wrinkles. garments: by their places in the
    outfit, those with wrinkles. lines: a sentence on each garment. clearing: of the meshes.
    """

    body: Body
    meshes: tuple[Mesh, ...]
    garments: dict[int, WrinkledGarment]
    lines: tuple[str, ...]
    clearing: OutfitClearing
    skin: BodySurface = field(repr=False)

    @classmethod
    def of(cls, wrinkles: Wrinkles, outfit: Outfit, meshes: Sequence[Mesh], quality: str) -> "WrinkledOutfit":
        """Lay out the garments that the network serves; the others stay plain, and a line says why.

        meshes: those that are shown, at rest. quality: of the cages that move the garments.
        """
        shown, garments, lines = list(meshes), dict[int, WrinkledGarment](), []
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
                    garments[place], shown[place] = wrinkled, wrinkled.mesh
                    lines.append(f"  {garment.name}: wrinkles on {len(wrinkled.mesh.vertices)} vertices")
            if reason:
                lines.append(f"  {reason}: it stays plain")
        body = outfit.body
        return cls(
            body=body,
            meshes=tuple(shown),
            garments=garments,
            lines=tuple(lines),
            clearing=OutfitClearing.of(body, shown),
            skin=BodySurface(body.mesh.vertices, body.mesh.faces),
        )

    def begin(self) -> None:
        """Forget the frames before: the next one follows nothing."""
        for garment in self.garments.values():
            garment.begin()

    def shown(self, garments: Sequence[Tensor], body_vertices: Tensor, fps: float) -> tuple[Tensor, ...]:
        """Vertices (n, 3) m of the meshes in the next frame, in the world.

        garments: (N, 3) m of the rollout. body_vertices: (V, 3) m, posed.
        """
        if not self.garments:
            return tuple(garments)
        self.skin.update(body_vertices)
        wrinkled = [
            self.garments[place].wrinkled(vertices, fps, self.skin) if place in self.garments else vertices
            for place, vertices in enumerate(garments)
        ]
        return self.clearing.cleared(wrinkled, body_vertices)
