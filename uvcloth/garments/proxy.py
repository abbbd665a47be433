"""Coarse garments, as games have them: a finer proxy is moved instead and carries them along."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.garments.fit import make_fitted
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import Mesh, face_normals
from uvcloth.geometry.subdivide import subdivide
from uvcloth.physics.face_contact import FaceContact

COARSE = 0.022
"""Spacing of vertices, m, from which a garment is coarse; the coarsest template, the dress, has 21 mm."""

PROXY_EDGE = 0.025
"""Longest edge of a proxy, m."""


@dataclass(frozen=True)
class ProxiedOutfit:
    """An outfit in which proxies stand for the coarse garments.

    outfit: what is rolled out. meshes: those that are shown, at rest, their faces off the skin; their
    vertices are the first ones of the garment that carries them. lines: report on the garments that are
    carried.
    """

    outfit: Outfit
    meshes: tuple[Mesh, ...]
    lines: tuple[str, ...]
    contact: FaceContact | None

    @classmethod
    def as_is(cls, outfit: Outfit) -> "ProxiedOutfit":
        """An outfit without proxies."""
        return cls(outfit, tuple(garment.mesh for garment in outfit.garments), (), None)

    @classmethod
    def of(cls, outfit: Outfit) -> "ProxiedOutfit":
        """The same outfit where none of its garments is coarse."""
        body, meshes = outfit.body, [garment.mesh for garment in outfit.garments]
        coarse = [garment.source == "file" and spacing(garment.mesh) > COARSE for garment in outfit.garments]
        if not any(coarse):
            return cls.as_is(outfit)
        contact = FaceContact(body, meshes, coarse)
        places = contact.resolve([mesh.vertices for mesh in meshes], body.mesh.vertices)
        shown = tuple(replace(mesh, vertices=place) for mesh, place in zip(meshes, places, strict=True))
        garments = tuple(
            proxy(garment, mesh, body) if is_coarse else garment
            for garment, mesh, is_coarse in zip(outfit.garments, shown, coarse, strict=True)
        )
        lines = tuple(
            f"  {garment.name}: coarse, {1000 * spacing(mesh):.0f} mm between vertices; moved by a "
            f"proxy of {len(garment.mesh.vertices)} vertices, its faces are kept off the skin"
            for garment, mesh, is_coarse in zip(garments, meshes, coarse, strict=True)
            if is_coarse
        )
        return cls(replace(outfit, garments=garments), shown, lines, contact)

    def named(self) -> list[tuple[str, Mesh]]:
        """Name and mesh of each visible garment."""
        return [(garment.name, mesh) for garment, mesh in zip(self.outfit.garments, self.meshes, strict=True)]

    def hides(self, shown: Body) -> list[Tensor]:
        """Vertices (K,) of the body that the files of garments say they hide.

        Empty for a character, whose meshes are shown instead of the fitted body.
        """
        if shown is not self.outfit.body:
            return []
        return [garment.hides for garment in self.outfit.garments if garment.hides is not None]

    def mesh_vertices(self, garments: Sequence[Tensor]) -> tuple[Tensor, ...]:
        """The vertices (N, 3) m of the meshes, taken from the garments that were rolled out."""
        return tuple(
            vertices[: len(mesh.vertices)] for vertices, mesh in zip(garments, self.meshes, strict=True)
        )

    def shown(self, garments: Sequence[Tensor], body_vertices: Tensor) -> tuple[Tensor, ...]:
        """Vertices (N, 3) m of the meshes that are shown, from the garments that were rolled out on a posed
        body (V, 3) m.
        """
        rolled = self.mesh_vertices(garments)
        return rolled if self.contact is None else self.contact.resolve(rolled, body_vertices)


def spacing(mesh: Mesh) -> float:
    """Mean length of the edges of a mesh over its area, m: dense collars and buttons hardly count."""
    corners = mesh.vertices[mesh.faces]
    lengths = (corners - corners.roll(1, 1)).norm(dim=2).mean(1)
    areas = face_normals(mesh.vertices, mesh.faces).norm(dim=1)
    return float((lengths * areas).sum() / areas.sum())


def proxy(garment: Garment, mesh: Mesh, body: Body) -> Garment:
    """Make a garment that moves as another, of its mesh with no long edges."""
    made, _ = make_fitted(garment.name, subdivide(mesh, PROXY_EDGE), body, garment.template)
    return replace(made, hides=garment.hides)
