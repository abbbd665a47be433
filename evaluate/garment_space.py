"""Pictures of a method's latent space: garments between two codes (Motion-guided, Figure 9)."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Garment
from uvcloth.methods.capabilities import GarmentSpace, garment_space
from uvcloth.rendering.render import BODY_COLOR, Color, Surface, contact_sheet, render, three_quarter

from .candidates import SIMULATION, Candidate
from .progress import progress
from .report import Picture
from .show import Shown, method_color, png

BLEND_SHARES = (1.0, 0.8, 0.6, 0.5, 0.4, 0.2, 0.0)
"""Shares a of the first code, the second having 1 - a, as in the figure."""

PICTURE_SIZE = (160, 240)
"""Width and height of one garment, in pixels."""


def interpolations(candidates: Sequence[Candidate], shown: Sequence[Shown], body: Body) -> list[Picture]:
    """A sheet for every candidate and each garment, worn alone, of which it has a space.

    First row: between the codes of the two shown simulated garments that are farthest apart. Second row:
    between two random codes.
    """
    names = [candidate.name for candidate in candidates]
    alone = [window for window in shown if len(window.outfit.garments) == 1]
    spaces = [
        (candidate.name, garment, space)
        for candidate in candidates
        for garment in {window.outfit_name: window.outfit.garments[0] for window in alone}.values()
        if (space := garment_space(candidate.method, garment, body))
    ]
    sheets = []
    with progress("Spaces of garments", len(spaces)) as tick:
        for name, garment, space in spaces:
            windows = [window for window in alone if window.outfit_name == garment.name]
            color = method_color(names, name)
            rows = [between(space, *ends) for ends in (farthest(space, windows), random_pair(space))]
            images = [_picture(body, garment, shape, color) for row in rows for shape in row]
            tick()
            sheet = png(contact_sheet(images, columns=len(BLEND_SHARES)))
            labels = tuple(f"a = {share:g}" for share in BLEND_SHARES)
            sheets.append(Picture(f"{name}, {garment.name}", sheet, labels))
    return sheets


def farthest(space: GarmentSpace, windows: Sequence[Shown]) -> tuple[Tensor, Tensor]:
    """The two codes (Z,) farthest apart of the simulated garments of some windows, all of one garment."""
    codes = torch.cat([space.encode(window.meshes[SIMULATION], window.transforms) for window in windows])
    first, second = divmod(int(torch.cdist(codes, codes).argmax()), len(codes))
    return codes[first], codes[second]


def random_pair(space: GarmentSpace) -> tuple[Tensor, Tensor]:
    """Two codes (Z,), the same every time."""
    first, second = torch.randn(2, space.size, generator=torch.Generator().manual_seed(0))
    return first, second


def between(space: GarmentSpace, first: Tensor, second: Tensor) -> Tensor:
    """Garments (BLEND_SHARES, N, 3), m, between two codes (Z,)."""
    share = torch.tensor(BLEND_SHARES)[:, None]
    return space.decode(share * first + (1 - share) * second)


def _picture(body: Body, garment: Garment, shape: Tensor, color: Color) -> np.ndarray:
    """A garment (N, 3) over the body at rest."""
    surfaces = [
        Surface(body.mesh.vertices, body.mesh.faces, BODY_COLOR),
        Surface(shape, garment.mesh.faces, color),
    ]
    camera = three_quarter(body.mesh.vertices, aspect=PICTURE_SIZE[0] / PICTURE_SIZE[1])
    return render(surfaces, camera, PICTURE_SIZE, floor=float(body.mesh.vertices[:, 2].min()))
