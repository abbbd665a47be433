"""Outfits on cages, which the solver moves: made, and baked for the runtime."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.garments.band import holding_band
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import join_meshes
from uvcloth.geometry.skinning import skin
from uvcloth.methods.physics.bake import STEPS, baked_sections
from uvcloth.methods.physics.caged_garment import CagedGarment, caged
from uvcloth.physics.cloth.cloth import Damping, make_cloth
from uvcloth.physics.cloth.solver import HOLD, Settings, make_solver
from uvcloth.physics.layer_thickness import outfit_thickness
from uvcloth.physics.outfit_clearing import OutfitClearing
from uvcloth.player.outfit import Outfit as BakedOutfit
from uvcloth.player.sections import pack

CAGE_INTERVAL = 1.0 / 60.0
"""Seconds between two searches for contact; fine cloth is searched twice as often."""

CAGE_RENEWAL = 4
"""Frames from one search of all faces of the body for a vertex to the next."""


@dataclass(frozen=True)
class PhysicsConfig:
    """Settings of the solver on cages.

    quality: of the cages, a key of QUALITIES. buckling: m, length of the longest edges that are as stiff in
    compression as in tension: longer ones cannot buckle as fine cloth does.
    """

    quality: str = "default"
    buckling: float = 0.018
    damping: Damping = field(default_factory=Damping)
    settings: Settings = field(default_factory=lambda: Settings(renewal=CAGE_RENEWAL, interval=CAGE_INTERVAL))

    @property
    def compression(self) -> float:
        """Share of the membrane's stiffness that is left where compression begins.

        It falls with the square of the edge length, as the load does under which a strip buckles (Euler).
        """
        return min(1.0, (self.buckling / QUALITIES[self.quality]) ** 2)


@dataclass(frozen=True)
class CagedOutfit:
    """An outfit on cages, and all that the runtime needs to dress a character in it."""

    garments: tuple[CagedGarment, ...]
    baked: BakedOutfit

    def represented(self, transforms: Tensor, garments: Sequence[Tensor]) -> tuple[Tensor, ...]:
        """Garments (B, N, 3) m as cages in them carry them, not cleared. transforms: (B, J, 3, 4)."""
        pairs = zip(self.garments, garments, strict=True)
        return tuple(each.represented(transforms, worn) for each, worn in pairs)

    def skinned_cages(self, transforms: Tensor) -> Tensor:
        """Smoothly skinned cages (n, 3) m of all garments. transforms: (J, 3, 4)."""
        return torch.cat(
            [
                skin(garment.cage.vertices, garment.cage_weights, transforms[None])[0]
                for garment in self.garments
            ]
        )

    def followed(self, transforms: Tensor, cages: NDArray[np.float64]) -> list[Tensor]:
        """Points (U, 3) m of each garment as cages at (n, 3) m carry it, not cleared.

        The offsets of the cages from the skinned ones are added to the skinned garments. transforms:
        (J, 3, 4).
        """
        offsets = torch.from_numpy(cages).to(transforms) - self.skinned_cages(transforms)
        return [
            skin(garment.mesh.points, garment.weights, transforms[None])[0]
            + garment.cage.at_garment(offsets[garment.rows])
            for garment in self.garments
        ]


def make_caged_outfit(outfit: Outfit, config: PhysicsConfig) -> CagedOutfit:
    """Make cages of an outfit's garments, and the solver that moves them all as one cloth.

    Raises InputError for a garment that nothing holds up, and for cloth that the solver cannot step.
    """
    garments, sections = _caged_sections(outfit, config, rounded=False)
    return CagedOutfit(garments, BakedOutfit(pack(sections)))


def bake_outfit(
    outfit: Outfit,
    config: PhysicsConfig,
    more: Mapping[str, NDArray[Any]] | None = None,
    more_steps: Mapping[str, float] | None = None,
) -> bytes:
    """Bake an outfit for the body that it is worn on, as `uvcloth.player.outfit.Outfit` reads it, for a file.

    Positions and weights are rounded. more: further sections, of wrinkles, and the steps to round them to.
    Raises InputError as `make_caged_outfit` does, and for a body with pose shapes.
    """
    if outfit.body.pose_shapes is not None:
        raise InputError(f"body {outfit.body.name}: pose shapes cannot be baked, only blend weights")
    sections = _caged_sections(outfit, config, rounded=True)[1] | dict(more or {})
    return pack(sections, STEPS | dict(more_steps or {}), compressed=True)


def _caged_sections(
    outfit: Outfit, config: PhysicsConfig, rounded: bool
) -> tuple[tuple[CagedGarment, ...], dict[str, NDArray[Any]]]:
    """Garments with their cages, and the arrays of the baked outfit."""
    body = outfit.body
    garments = tuple(caged(outfit.garments, QUALITIES[config.quality]))
    joined = join_meshes((each.cage.vertices, each.cage.faces) for each in garments)
    clearing = OutfitClearing.of(body, [garment.mesh for garment in outfit.garments], joined)
    bands = [holding_band(garment, body) for garment in outfit.garments]
    held = torch.cat(
        [
            each.cage.at_cage(band.vertices[each.mesh.kept, None].float())[:, 0] > 0.5
            for each, band in zip(garments, bands, strict=True)
        ]
    )
    for each, garment in zip(garments, outfit.garments, strict=True):
        if not held[each.rows].any():
            raise InputError(
                f"garment {garment.name}: what holds it up falls between the vertices of its cage; hold it "
                "by more, or choose a finer quality"
            )
    mass = torch.cat(
        [torch.full((len(each.cage_weights),), band.mass) for each, band in zip(garments, bands, strict=True)]
    )
    cloth = make_cloth(
        joined.vertices.numpy(),
        joined.faces.numpy(),
        [garment.fabric for garment in outfit.garments],
        mass_factor=torch.where(held, mass, 1.0).numpy(),
        thickness=outfit_thickness(
            [each.cage.vertices for each in garments],
            [(each.mesh.points, each.mesh.faces) for each in garments],
        ).numpy(),
        fabric_of=np.repeat(np.arange(len(garments)), [len(each.cage.faces) for each in garments]),
        apart=clearing.apart.numpy(),
        compression=config.compression,
        damping=config.damping,
    )
    names = " + ".join(garment.name for garment in outfit.garments)
    solver = make_solver(
        cloth, joined.vertices.numpy(), clearing.cages_solid, config.settings, f"garment {names}"
    )
    hold = np.where(held.numpy(), HOLD, 0.0)
    return garments, baked_sections(body, garments, solver, clearing, hold, rounded)
