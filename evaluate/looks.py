"""All measures of motion and looks of a garment over a window, each of which is one file beside this one."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.physics.fabric import Fabric

from .after_stop import stop_scores
from .body_scores import DressedBody
from .force_balance import ForceBalance, balanced_frames, force_balance, force_scores
from .hem import Hem, find_hem, hem_scores
from .metrics import Reference, peak_accelerations
from .surface import make_surface
from .swing_bands import band_scores
from .wrinkles import WaveFilters, wave_filters, wrinkle_scores


@dataclass(frozen=True)
class Looks:
    """A garment, or several as one mesh, prepared for the measures.

    balance: None for several garments, whose forces on each other are unknown.
    """

    filters: WaveFilters
    hem: Hem
    balance: ForceBalance | None


def prepare_looks(reference: Reference, fabric: Fabric | None) -> Looks:
    """Prepare a garment of a fabric, or several as one mesh, for which it is None."""
    rest, faces = reference.rest, reference.faces
    surface = make_surface(rest, faces)
    balance = force_balance(surface, fabric) if fabric else None
    return Looks(wave_filters(surface), find_hem(rest, faces), balance)


def look_scores(
    looks: Looks, vertices: Tensor, reference: Reference, dressed: DressedBody, body: Tensor
) -> dict[str, Tensor]:
    """Every measure of (F, N, 3) on the posed body (F, V, 3), m, as its file says."""
    scores = {
        **band_scores(vertices, reference),
        **wrinkle_scores(looks.filters, vertices, reference),
        **hem_scores(looks.hem, vertices, reference),
        **stop_scores(vertices, reference),
        "peak_acceleration": peak_accelerations(vertices, reference),
    }
    frames = balanced_frames(len(vertices))
    if looks.balance is None or not len(frames):
        return scores
    skins = dressed.obstacle.skins(vertices[frames], dressed.garment, body[frames])
    distances = torch.stack([skin.distance for skin in skins])
    return {**scores, **force_scores(looks.balance, vertices, frames, distances, reference.fps)}
