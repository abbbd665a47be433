"""A box that walks in garments of two triangles, each corner of which is seen by a texel of its own."""

from pathlib import Path

import torch
from torch import Tensor

from rasterize.texels import Texels
from tests.small_body import small_body
from train.physxnet.prepare import Correspondences
from uvcloth.bodies.body import Body
from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.clip import clip_of_garment
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.geometry.mesh import unique_edges
from uvcloth.methods.physxnet.config import PhysXNetConfig
from uvcloth.methods.physxnet.texels import BodyTexels, GarmentDecoder, TemplateTexels

BODY: Body = small_body()
SIDE = 1.0
"""Metres: large, so that the rounding of sequence files (tens of micrometres) hardly counts."""
SHEET = torch.tensor([[0.0, 0.0, 0.12], [SIDE, 0.0, 0.12], [SIDE, SIDE, 0.12], [0.0, SIDE, 0.12]])
FACES = torch.tensor([[0, 1, 2], [0, 2, 3]])
PIXELS = torch.tensor([9, 14, 33, 50])
"""Of 8 x 8 texels those that see, of the body its vertices 1, 3, 5 and 7, of a garment its corners."""

CONFIG = PhysXNetConfig(
    size=8,
    levels=3,
    width=8,
    pose=False,
    history=0,
    frame="world",
    acceleration="plain",
    centre="channel",
    templates=("tops",),
)


def prepared(templates: tuple[str, ...], unseen: int = 0) -> Correspondences:
    """Correspondences that ray casting would find, had the garments a template.

    unseen: how many of the first corners no texel sees; they are decoded from the next one that one does.
    """
    each = torch.arange(4)
    first = torch.tensor([[1.0, 0.0, 0.0]]).repeat(4, 1)
    own = each[:, None].repeat(1, 3)
    vertices = torch.tensor([1, 3, 5, 7])
    sheet = Texels(8, 8, torch.zeros(4).long(), first, PIXELS, torch.zeros(4).long(), torch.zeros(4, 2))
    body = BodyTexels(
        sheet, vertices[:, None].repeat(1, 3), BODY.mesh.vertices[vertices], BODY.weights[vertices]
    )
    normals = torch.tensor([0.0, 0.0, 1.0]).expand(4, 3)
    seen = each[unseen:]
    template = TemplateTexels(seen, PIXELS[seen], own[seen], first[seen], SHEET[seen], normals[seen])
    chest = torch.tensor([[0.0, 1.0]]).repeat(4, 1)
    samples = (each - unseen).clamp(min=0)[:, None]
    decoder = GarmentDecoder(samples, torch.ones(4, 1), SHEET, torch.zeros(4, 3), chest, chest)
    edges = unique_edges(FACES)
    return Correspondences(
        body,
        dict.fromkeys(templates, template),
        dict.fromkeys(templates, decoder),
        dict.fromkeys(templates, edges),
    )


def walking(frames: int, fps: float, acceleration: float = 2.0) -> Tensor:
    """Transforms (frames, 2, 3, 4) of a box that speeds up along X, m/s2."""
    transforms = torch.eye(3, 4).repeat(frames, 2, 1, 1)
    seconds = torch.arange(frames) / fps
    transforms[:, :, 0, 3] = (0.5 * acceleration * seconds**2)[:, None]
    return transforms


def save_clip(
    folder: Path,
    clip: str,
    offsets: dict[str, Tensor],
    frames: int = 8,
    fps: float = 10.0,
    warm_up: int = 3,
    body: Body = BODY,
) -> None:
    """Write a clip's sequences: template -> the corners' offsets (4, 3) m from the skinned garment."""
    keep_body(body, folder)
    transforms = walking(frames, fps)
    for template, offset in offsets.items():
        sequence = clip_of_garment(
            vertices=SHEET + transforms[:, 1, None, :, 3] + offset,
            faces=FACES,
            rest=SHEET,
            transforms=transforms,
            fps=fps,
            warm_up=warm_up,
            metadata={"clip": clip, "garment": template, "body": body.name},
        )
        save_simulated(sequence, folder / f"{clip}_{template}.npz")
