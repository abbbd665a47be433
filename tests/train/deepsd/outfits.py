"""Simulated outfits without a simulator: templates that are skinned, with a bulge that the pose drives."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch

from tests.train.cropped import cropped
from tests.train.simulated import swaying
from uvcloth.bodies.body import Body, load_body, save_body
from uvcloth.dataset.bodies import BODIES
from uvcloth.dataset.clip import clip_of_garment
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.skinning import skin
from uvcloth.methods.rig import pose_vectors
from uvcloth.physics.fabric import FABRICS

BULGE = 0.02
"""Metres that the cloth moves outwards, times the sine of the sum of the pose vector."""


@dataclass(frozen=True)
class MadeUp:
    """An outfit to make up: garments' names, of the innermost first, its split, and how high of its vertices
    are kept (m), so that the files stay small, and what it is made of."""

    name: str
    garments: tuple[str, ...]
    split: str
    heights: tuple[float, float] = (-10.0, 10.0)
    fabric: str = "jersey"


def save_outfits(folder: Path, outfits: Sequence[MadeUp], frames: int = 6, warm_up: int = 2) -> Body:
    """Write the sequences of some outfits on one body, and the body."""
    body = load_body()
    save_body(body, folder / BODIES / "ann.npz")
    for seed, outfit in enumerate(outfits):
        transforms = swaying(frames, seed).transforms()
        bulge = BULGE * torch.sin(pose_vectors(body.skeleton.parents, transforms).sum(1))
        names = tuple(f"{outfit.name}_{name}" for name in outfit.garments)
        for name, template in zip(names, outfit.garments, strict=True):
            garment = cropped(fit_template(template, body), *outfit.heights)
            mesh = garment.mesh
            outwards = vertex_normals(mesh.vertices, mesh.faces)
            moved = torch.stack(
                [
                    skin(mesh.vertices + size * outwards, garment.smooth_weights, pose[None])[0]
                    for size, pose in zip(bulge, transforms, strict=True)
                ]
            )
            metadata = {
                "clip": f"clip{seed}", "garment": name, "template": template, "layers": names,
                "outfit": outfit.name, "split": outfit.split, "subject": f"person{seed}",
                "types": dict(zip(names, outfit.garments, strict=True)),
                "body": "ann", "body_hash": body.identity.shape,
                "settings": {"fabric": asdict(FABRICS[outfit.fabric])},
            }  # fmt: skip
            sequence = clip_of_garment(
                vertices=moved,
                faces=mesh.faces,
                rest=mesh.vertices,
                transforms=transforms,
                fps=30.0,
                warm_up=warm_up,
                metadata=metadata,
            )
            save_simulated(sequence, folder / f"clip{seed}_{name}.npz")
    return body
