"""Forces that no cloth balances: gravity, elasticity, drag and inertia of patches that nothing touches.

By Newton's second law they sum to zero, so that the rest needs no truth to compare with. At a vertex of a
fine mesh it says little: one millimetre along an edge, which nobody sees and a packed sequence changes, is a
force of a hundred times its weight. Forces inside a patch cancel, and what is left of a patch is what the eye
misses: support, weight or momentum. (HOOD, Grigorev et al. 2023, reports the gradient at vertices.)
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.units import GRAVITY
from uvcloth.physics.energies import ClothEnergies, cloth_energies
from uvcloth.physics.fabric import Fabric

from .surface import GarmentSurface

PATCH = 0.08
"""Standard deviation of a patch, metres: forces of waves shorter than twice that are averaged out."""

TOUCHING_DISTANCE = 0.009
"""Metres from the skin within which the body may push cloth."""

MOST_TOUCHING = 0.05
"""Largest share of a patch that touches the body."""

MOST_FORCE = 3.0 * GRAVITY
"""Unbalanced force per mass, m/s2, above which no cloth can take a frame, in the middle of its patches."""

BALANCED_FRAMES = 20
"""Most frames of a window that are measured, evenly spaced: forces are slow to compute."""

LEAST_MASS = 1e-9
"""Kilograms by which the force at a vertex without faces is divided."""


@dataclass(frozen=True)
class ForceBalance:
    """The forces of a garment, on its welded surface. average: over patches."""

    surface: GarmentSurface
    energies: ClothEnergies
    average: Callable[[Tensor], Tensor]

    def unbalanced(self, before: Tensor, now: Tensor, after: Tensor, seconds: float) -> Tensor:
        """Unbalanced force per mass of patches, m/s2: positions (B, n, 3) m, `seconds` apart -> (B, n, 3).

        Gradient of all energies over mass. Drag is that on the way from `before` to `now`.
        """
        with torch.enable_grad():
            shifted = now.detach().requires_grad_()
            cloth = self.energies
            energy = cloth.membrane(shifted) + cloth.hinges(shifted) + cloth.gravity(shifted)
            energy = energy + cloth.air(shifted, before, seconds)
            (gradient,) = torch.autograd.grad(energy.sum(), shifted)
        acceleration = (after - 2.0 * now + before) / seconds**2
        return self.average(gradient / cloth.masses.clamp(min=LEAST_MASS)[:, None] + acceleration)


def force_balance(surface: GarmentSurface, fabric: Fabric) -> ForceBalance:
    """The balance of a garment of a fabric."""
    energies = cloth_energies(surface.mesh.points, surface.mesh.faces, fabric)
    return ForceBalance(surface, energies, surface.diffusion(PATCH))


def balanced_frames(count: int) -> Tensor:
    """The frames of a window of `count` whose forces are measured: (S,) int64, without the first and last."""
    most = max(count - 2, 0)
    return torch.linspace(1, max(count - 2, 1), min(BALANCED_FRAMES, most)).round().long()


def force_scores(
    balance: ForceBalance, vertices: Tensor, frames: Tensor, distances: Tensor, fps: float
) -> dict[str, Tensor]:
    """Unbalanced force per mass of the patches of (F, N, 3) that nothing touches, m/s2, in frames (S,).

    distances: (S, N) m of the vertices from the skin. force_median, force_99: (S,) median and 99th percentile
    over patches, not a number where no patch is free. force_frame: (S,) the frames.
    """
    kept = balance.surface.mesh.kept
    before, now, after = (vertices[frames + step][:, kept] for step in (-1, 0, 1))
    force = balance.unbalanced(before, now, after, 1.0 / fps).norm(dim=2)
    touching = (distances[:, kept] < TOUCHING_DISTANCE).double()[..., None]
    free = balance.average(touching)[..., 0] < MOST_TOUCHING
    quantiles = torch.tensor([0.5, 0.99]).double()
    median, high = force.masked_fill(~free, torch.nan).nanquantile(quantiles, dim=1)
    return {"force_median": median, "force_99": high, "force_frame": frames.double()}
