"""Outfits that are shown with wrinkles: garments on finer meshes, which the runtime displaces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.refined import Refined
from uvcloth.geometry.mesh import Mesh, WeldedMesh, join_meshes, neighbour_average, welded
from uvcloth.physics.layer_thickness import outfit_thickness
from uvcloth.physics.layers import Layer
from uvcloth.player.wrinkles import WrinkleMaker
from uvcloth.wrinkles.bake import wrinkle_sections, wrinkle_steps
from uvcloth.wrinkles.model import Wrinkles
from uvcloth.wrinkles.sheet import Sheet

COVER_REACH = 0.06
"""Metres within which a garment over another one covers it."""

FADING = 4
"""Times that the border of what is covered is smoothed."""


@dataclass(frozen=True)
class WrinkledSheets:
    """The garments of an outfit that a network serves, laid out.

    sheets: by the garment's place in the outfit. lines: a sentence on each garment.
    """

    wrinkles: Wrinkles
    outfit: Outfit
    sheets: Mapping[int, Sheet]
    lines: tuple[str, ...]

    @classmethod
    def of(
        cls, wrinkles: Wrinkles, outfit: Outfit, quality: str, meshes: Sequence[Mesh] | None = None
    ) -> "WrinkledSheets":
        """Lay out the garments that the network serves; the others stay plain, and a line says why.

        quality: of the cages that move the garments. meshes: those that are shown, at rest, if some are moved
        by proxies.
        """
        sheets, lines = dict[int, Sheet](), []
        for place, garment in enumerate(outfit.garments):
            reason = wrinkles.unsupported_reason(garment, quality)
            if not reason and meshes is not None and meshes[place] is not garment.mesh:
                reason = f"garment {garment.name}: is moved by a proxy, on which there are no wrinkles"
            if not reason:
                try:
                    sheets[place] = Sheet.of(garment, wrinkles.config.size)
                except InputError as error:
                    reason = str(error)
                else:
                    count = len(sheets[place].refined.mesh.vertices)
                    lines.append(f"  {garment.name}: wrinkles on {count} vertices")
            if reason:
                lines.append(f"  {reason}: it stays plain")
        return cls(wrinkles, outfit, sheets, tuple(lines))

    def sections(self) -> dict[str, NDArray[Any]]:
        """The arrays of the network and the sheets, as a baked outfit has them."""
        garments = self.outfit.garments
        free = [
            _free(sheet, [other.mesh for other in garments[place + 1 :]])
            for place, sheet in self.sheets.items()
        ]
        config, net = self.wrinkles.config, self.wrinkles.net
        return wrinkle_sections(config, net, list(self.sheets.values()), list(self.sheets), free)

    @property
    def steps(self) -> dict[str, float]:
        """Steps of these arrays in a file."""
        return wrinkle_steps(len(self.sheets))

    def refined(self) -> tuple[Garment, ...]:
        """The garments as they are shown at rest, those with wrinkles on their finer meshes."""
        return tuple(
            _on_refined(garment, self.sheets[place].refined) if place in self.sheets else garment
            for place, garment in enumerate(self.outfit.garments)
        )


class WrinkledOutfit:
    """The garments of a rollout, some of them with wrinkles, frame after frame.

    meshes: at rest, refined where there are wrinkles. lines: a sentence on each garment.
    """

    def __init__(self, wrinkles: Wrinkles, outfit: Outfit, meshes: Sequence[Mesh], quality: str) -> None:
        """Lay out the garments that the network serves, see `WrinkledSheets.of`.

        Raises InputError for a network that the runtime cannot play.
        """
        laid_out = WrinkledSheets.of(wrinkles, outfit, quality, meshes)
        self._sheets, self.lines = laid_out.sheets, laid_out.lines
        self.meshes = tuple(
            self._sheets[place].refined.mesh if place in self._sheets else mesh
            for place, mesh in enumerate(meshes)
        )
        cloth = {
            place: welded(garment.mesh.vertices, garment.mesh.faces)
            for place, garment in enumerate(outfit.garments)
            if meshes[place] is garment.mesh
        }
        self._kept = {place: mesh.kept for place, mesh in cloth.items()}
        try:
            self._maker = WrinkleMaker(_runtime_sections(laid_out, cloth)) if self._sheets else None
        except ValueError as error:
            raise InputError(f"--wrinkles: {error}") from error
        self._counts = [len(sheet.refined.mesh.vertices) for sheet in self._sheets.values()]

    @property
    def serves(self) -> bool:
        """True if there are wrinkles on any garment."""
        return bool(self._sheets)

    def begin(self) -> None:
        """Forget the frames before: the next one follows nothing."""
        if self._maker is not None:
            self._maker.begin()

    def shown(self, garments: Sequence[Tensor], body_vertices: Tensor, fps: float) -> tuple[Tensor, ...]:
        """Vertices (n, 3) m of the meshes in the next frame, in the world.

        garments: (N, 3) m of the rollout. body_vertices: (V, 3) m, posed.
        """
        if self._maker is None:
            return tuple(garments)
        points = torch.cat([garments[place][kept] for place, kept in self._kept.items()])
        made = self._maker.wrinkle(points.numpy(), body_vertices.numpy(), 1.0 / fps)
        wrinkled = dict(zip(self._sheets, torch.from_numpy(made).split(self._counts), strict=True))
        return tuple(wrinkled.get(place, vertices) for place, vertices in enumerate(garments))


def _runtime_sections(laid_out: WrinkledSheets, cloth: Mapping[int, WeldedMesh]) -> dict[str, NDArray[Any]]:
    """All that the runtime reads of wrinkles without the outfit around them.

    cloth: the garments that may have wrinkles or lie beside some, by their place in the outfit.
    """
    meshes, body = [(mesh.points, mesh.faces) for mesh in cloth.values()], laid_out.outfit.body
    joined, places = join_meshes(meshes), list(cloth)
    return {
        **laid_out.sections(),
        "wrinkles.garments": np.array([places.index(place) for place in laid_out.sheets]),
        "points.rest": joined.vertices.numpy(),
        "fine.faces": joined.faces.numpy(),
        "fine.thickness": outfit_thickness([points for points, _ in meshes], meshes).numpy(),
        "garments.starts": np.array([*joined.starts, len(joined.vertices)]),
        "skin.rest": body.mesh.vertices.numpy(),
        "skin.faces": body.mesh.faces.numpy(),
    }


def _on_refined(garment: Garment, refined: Refined) -> Garment:
    weights, smooth_weights = (
        refined.matrix.to(each) @ each[refined.kept] for each in (garment.weights, garment.smooth_weights)
    )
    return replace(garment, mesh=refined.mesh, weights=weights, smooth_weights=smooth_weights)


def _free(sheet: Sheet, over: Sequence[Mesh]) -> Tensor:
    """Share (U,) of a garment's displacements that is shown: none beneath garments over it, at rest."""
    points = sheet.mesh.points
    covered = torch.zeros(len(points), dtype=torch.bool)
    for mesh in over:
        beside = Layer(mesh.vertices, mesh.faces).beside(points, COVER_REACH)
        covered |= beside.covered & (beside.distance < 0.0)
    average = neighbour_average(sheet.mesh.faces, len(points)).float().to_sparse_csr()
    free = (~covered).float()[:, None]
    for _ in range(FADING if bool(covered.any()) else 0):
        free = torch.minimum(free, average @ free)
    return free[:, 0]
