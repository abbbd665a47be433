"""The hardest poses of a folder of motion capture, worn: cuffs, knees and hems, to be looked at.

Run from the checkout with PYTHONPATH=. as

    OMP_NUM_THREADS=1 python benchmarks/hardest.py INDEX.csv OUT.jpg [--garments bottoms shirt] [--count 10]

The hardest pose of a clip is the one in which limbs and spine are turned farthest from rest, as the sum of
the squares of the angles; of the clips of training and validation those with the hardest poses are drawn,
from the front and from behind, after half a second of `physics`. The poses are printed, hardest first.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from rich.progress import track

from uvcloth.bodies.body import Body, load_body
from uvcloth.files.image import write_png
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_outfit
from uvcloth.geometry.rotations import to_axis_angles
from uvcloth.geometry.skeleton import local_rotations
from uvcloth.lighting import FINE
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.motion.clip import Clip
from uvcloth.motion.index import clip_file, read_index
from uvcloth.motion.library import load_clip
from uvcloth.motion.roles import joint_roles
from uvcloth.process.command import run_command
from uvcloth.render import BODY_COLOR, GARMENT_COLORS, Surface, contact_sheet, render, three_quarter
from uvcloth.rollout import prepare_rollout

BENT = (
    *("lower_spine", "middle_spine", "upper_spine"),
    *(f"{side}_{part}" for side in ("left", "right") for part in ("thigh", "shin", "upper_arm", "forearm")),
)
"""Roles of the joints whose turning makes a pose hard."""

BEFORE = 15
"""Frames that are simulated before a pose."""

ROW = 3
"""Poses in a row of the picture."""

TURNS, SIZE = (20.0, 200.0), (300, 300)
"""Degrees about the figure, and pixels, of its pictures."""


@dataclass(frozen=True)
class HardPose:
    """A frame of a clip; turned: sum of the squares of the joints' angles, radians."""

    turned: float
    clip: Clip
    frame: int


@dataclass(frozen=True)
class Hardest:
    """Draw the hardest poses."""

    index: tyro.conf.Positional[Path]
    """Index of the clips."""
    out: tyro.conf.Positional[Path]
    """Picture to write."""
    garments: tuple[str, ...] = ("bottoms", "shirt")
    """Outfit, the innermost garment first."""
    count: int = 10
    """Number of poses."""
    quality: str = "default"
    """Quality of the cages."""

    def run(self) -> None:
        """Write the picture. Raises InputError for an index or a clip that cannot be read."""
        torch.set_num_threads(1)
        torch.set_grad_enabled(False)
        body = load_body()
        outfit = Outfit(body, load_outfit(self.garments, body))
        poses = sorted(self._poses(body), key=lambda pose: -pose.turned)[: self.count]
        for pose in poses:
            print(f"{pose.clip.name}, frame {pose.frame}: {pose.turned:.1f}")
        tiles = [tile for pose in poses for tile in self._pictures(pose, outfit)]
        write_png(self.out, contact_sheet(tiles, 2 * ROW))

    def _poses(self, body: Body) -> Iterator[HardPose]:
        """Yield the hardest pose of each clip that is not of the test."""
        roles = joint_roles(body.skeleton.names)
        joints = torch.tensor([roles[role] for role in BENT if role in roles])
        entries = [each for each in read_index(self.index).values() if each.split in ("train", "validation")]
        for entry in track(entries, "reading"):
            clip = load_clip(str(clip_file(entry, self.index.parent)), body)
            local = local_rotations(body.skeleton.parents, clip.rotations)
            turned = to_axis_angles(local[:, joints]).square().sum((1, 2))
            yield HardPose(float(turned.max()), clip, int(turned.argmax()))

    def _pictures(self, pose: HardPose, outfit: Outfit) -> Iterator[np.ndarray]:
        """Yield pictures of an outfit in a pose, one for each of TURNS."""
        prepared = prepare_rollout(Physics(PhysicsConfig(self.quality)), outfit)
        transforms = pose.clip.transforms()[max(0, pose.frame - BEFORE) : pose.frame + 1]
        *_, last = prepared.frames(transforms, pose.clip.fps)
        skin = last.body_vertices
        surfaces = [Surface(skin, outfit.body.mesh.faces, BODY_COLOR)]
        for garment, vertices, color in zip(outfit.garments, last.vertices, GARMENT_COLORS, strict=False):
            surfaces.append(Surface(vertices, garment.mesh.faces, color))
        for turn in TURNS:
            yield render(surfaces, three_quarter(skin, turn), SIZE, float(skin[:, 2].min()), FINE)


if __name__ == "__main__":
    sys.exit(run_command("hardest.py", lambda: tyro.cli(Hardest).run()))
