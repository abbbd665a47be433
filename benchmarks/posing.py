"""Posing the default body: our batched LBS beside Anny's own forward pass, in one run.

PYTHONPATH=. python benchmarks/posing.py [--batch 32]
"""

from dataclasses import dataclass

import torch
import tyro

from benchmarks.timing import fastest
from uvcloth.bodies.anny import DEFAULT_PHENOTYPE, rig
from uvcloth.bodies.body import load_body
from uvcloth.geometry.skinning import skin
from uvcloth.motion.library import load_clip


@dataclass(frozen=True)
class Options:
    """Compare the two at one batch size."""

    batch: int = 32
    """Frames at once."""
    rounds: int = 7
    """Measurements of each; the fastest counts."""


def main() -> None:
    options = tyro.cli(Options)
    body = load_body()
    transforms = load_clip("walk", body).transforms()[: options.batch]
    ours = fastest(lambda: skin(body.mesh.vertices, body.weights, transforms), options.rounds)
    model = rig("anny")
    pose = torch.eye(4, dtype=torch.float64).repeat(len(transforms), len(body.skeleton.names), 1, 1)
    theirs = fastest(lambda: model(pose_parameters=pose, phenotype_kwargs=DEFAULT_PHENOTYPE), options.rounds)
    print(f"ours {1e3 * ours / len(transforms):.2f} ms per frame, ratio Anny / ours {theirs / ours:.1f}")


if __name__ == "__main__":
    main()
