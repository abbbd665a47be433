"""Pictures of a method's space of garments: from one code to another (Motion-guided, Figure 9)."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from torch import Tensor

from evaluate.judge import SIMULATION, Candidate
from evaluate.progress import progress
from evaluate.report import Picture
from evaluate.show import Shown, garments_shown, method_color, png
from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.render import BODY_COLOR, Color, Surface, contact_sheet, render, three_quarter

STEPS = (1.0, 0.8, 0.6, 0.5, 0.4, 0.2, 0.0)
"""Shares a of the first code, the second having 1 - a, as in the figure."""

SIZE = (160, 240)
"""Width and height of one garment, in pixels."""


class Coded(Protocol):
    """The config of a method with codes. latent: their length."""

    @property
    def latent(self) -> int: ...


@runtime_checkable
class Generative(Protocol):
    """A method whose garments are decoded from codes that are spread like a standard normal distribution."""

    @property
    def config(self) -> Coded: ...

    def encode(self, garment: Garment, body: Body, vertices: Tensor, transforms: Tensor) -> Tensor:
        """Codes (B, Z) of garments (B, N, 3), m, on a body moved by joint transforms (B, J, 3, 4)."""
        ...

    def decode(self, garment: Garment, body: Body, codes: Tensor) -> Tensor:
        """Garments (B, N, 3) at rest, m, of codes (B, Z)."""
        ...


def interpolations(candidates: Sequence[Candidate], shown: Sequence[Shown], body: Body) -> list[Picture]:
    """A sheet for every candidate that is generative and each garment that it dresses.

    Its rows lie between the codes of the two simulated garments shown whose codes are farthest apart, and
    between two random codes.
    """
    names = [candidate.name for candidate in candidates]
    wanted = [
        (candidate.name, candidate.method, method_color(names, candidate.name), garment)
        for candidate in candidates
        for garment in garments_shown(shown).values()
        if isinstance(candidate.method, Generative)
        and not candidate.method.unsupported_reason(Outfit(body, (garment,)))
    ]
    sheets = []
    with progress("Spaces of garments", len(wanted)) as tick:
        for name, method, color, garment in wanted:
            ends = (farthest(method, garment, body, shown), random_pair(method))
            rows = [between(method, garment, body, *pair) for pair in ends]
            images = [_picture(body, garment, shape, color) for row in rows for shape in row]
            tick()
            sheet = png(contact_sheet(images, columns=len(STEPS)))
            labels = tuple(f"a = {share:g}" for share in STEPS)
            sheets.append(Picture(f"{name}, {garment.name}", sheet, labels))
    return sheets


def farthest(
    method: Generative, garment: Garment, body: Body, shown: Sequence[Shown]
) -> tuple[Tensor, Tensor]:
    """The two codes (Z,) farthest apart of the simulated garments shown."""
    windows = [window for window in shown if window.garment.name == garment.name]
    codes = torch.cat([method.encode(garment, body, w.meshes[SIMULATION], w.transforms) for w in windows])
    first, second = divmod(int(torch.cdist(codes, codes).argmax()), len(codes))
    return codes[first], codes[second]


def random_pair(method: Generative) -> tuple[Tensor, Tensor]:
    """Two codes (Z,), the same every time."""
    first, second = torch.randn(2, method.config.latent, generator=torch.Generator().manual_seed(0))
    return first, second


def between(method: Generative, garment: Garment, body: Body, first: Tensor, second: Tensor) -> Tensor:
    """Garments (STEPS, N, 3), m, between two codes (Z,)."""
    share = torch.tensor(STEPS)[:, None]
    return method.decode(garment, body, share * first + (1 - share) * second)


def _picture(body: Body, garment: Garment, shape: Tensor, color: Color) -> np.ndarray:
    """A garment (N, 3) over the body at rest."""
    surfaces = [
        Surface(body.mesh.vertices, body.mesh.faces, BODY_COLOR),
        Surface(shape, garment.mesh.faces, color),
    ]
    camera = three_quarter(body.mesh.vertices, aspect=SIZE[0] / SIZE[1])
    return render(surfaces, camera, SIZE, floor=float(body.mesh.vertices[:, 2].min()))
