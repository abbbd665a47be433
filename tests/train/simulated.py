"""Sequences without a simulator: the templates swing along with a random motion, a frame late."""

from pathlib import Path

import torch

from uvcloth.bodies.body import Body, load_body
from uvcloth.dataset.clip import clip_of_garment
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.motion.clip import Clip
from uvcloth.motion.poses import DONORS, PoseDatabase


def save_clips(folder: Path, templates: tuple[str, ...], clips: int, frames: int, warm_up: int = 3) -> None:
    """Write one sequence per clip and template; the last clip lacks the last template."""
    body = load_body()
    garments = {name: fit_template(name, body) for name in templates}
    for index in range(clips):
        motion = swaying(frames, seed=index).transforms()
        for name in templates[:-1] if index == clips - 1 else templates:
            garment = garments[name]
            late = torch.cat([motion[:1], motion[:-1]])
            sequence = clip_of_garment(
                vertices=skin(garment.mesh.vertices, garment.smooth_weights, late),
                faces=garment.mesh.faces,
                rest=garment.mesh.vertices,
                transforms=motion,
                fps=30.0,
                warm_up=warm_up,
                metadata={"clip": f"clip{index}", "garment": name, "body": "default"},
            )
            save_simulated(sequence, folder / f"clip{index}_{name}.npz")


def swaying(frames: int, seed: int) -> Clip:
    """Every joint turns to and fro about an axis of its own."""
    generator = torch.Generator().manual_seed(seed)
    skeleton = load_body().skeleton
    joints = len(skeleton.names)
    axes = 0.2 * torch.randn(joints, 3, generator=generator)
    phase = torch.rand(joints, generator=generator)
    angle = torch.sin(2 * torch.pi * (torch.arange(frames)[:, None] / 15.0 + phase))
    x, y, z = (angle[..., None] * axes).unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).view(frames, joints, 3, 3)
    return Clip("swaying", skeleton, torch.matrix_exp(cross), skeleton.heads[:1].repeat(frames, 1), 30.0)


def database_of(body: Body, frames: int = 9, held: int = 3) -> PoseDatabase:
    """Frames of one swaying motion, the last few for validation."""
    rotations = swaying(frames, seed=0).rotations
    order = torch.arange(frames)
    return PoseDatabase(
        joints=body.skeleton.names,
        rotations=rotations,
        clip_names=("swaying",),
        subjects=("ann",),
        clips=torch.zeros(frames, dtype=torch.int64),
        frames=order,
        mirrored=torch.zeros(frames, dtype=torch.bool),
        splits=(order >= frames - held).long(),
        donors=torch.full((frames, DONORS), -1),
        apart=0.01,
        body_name=body.name,
        body_hash=body.identity.shape,
    )
