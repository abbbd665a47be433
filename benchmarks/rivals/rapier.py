"""Rapier's soft bodies, of a game engine, over the windows of a data folder, for `--predicted rapier=OUT`.

    pip install --target FOLDER rapier3d==0.36.1
    PYTHONPATH=.:FOLDER python benchmarks/rivals/rapier.py DATA OUT [--split validation]
    PYTHONPATH=.:FOLDER python benchmarks/rivals/rapier.py DATA OUT --quality mesh --rate 120

It gets the motion and the garment, not the simulation. Its cloth is the cage that physics has (or the mesh of
the garment with --quality mesh), whose band moves as the skinned garment. The body is a mesh of pinned
particles, skinned. Settings are the same for all garments; they were chosen on a dress, in 02_03 and 35_01.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import rapier3d
import torch
import tyro
from numpy.typing import NDArray
from torch import Tensor

from benchmarks.rivals.jolt import Rival, make_rival
from benchmarks.rivals.sequences import RivalRun, sequences
from uvcloth.bodies.body import REGIONS, Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.files.atomic import make_folder
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.skinning import skin
from uvcloth.process.command import run_command

MET = ("torso", "upper_arm", "forearm", "thigh", "calf")
"""Regions of the body that are colliders: head, hands and feet have three quarters of its faces."""

STRETCH, BEND = 200.0, 1.0
"""Natural frequencies of edges and of folds, 1/s, damped critically; Rapier's defaults are 30 and 10."""

RADIUS, FRICTION, NEAR = 0.002, 0.0, 0.005
"""Thickness of a particle, m, friction, and the distance of surfaces at which contacts begin, m."""


@dataclass(frozen=True)
class Rapier(RivalRun):
    """Simulate windows with Rapier."""

    rate: int = 60
    """Least steps a second."""
    substeps: int = 4
    """Of a step: Rapier's solver iterations."""
    self_contact: bool = True
    """Contact of cloth with itself."""

    def run(self) -> None:
        """Simulate. Raises InputError for a damaged sequence."""
        torch.set_grad_enabled(False)
        torch.set_num_threads(1)
        body = load_body()
        used, faces = collider(body)
        make_folder(self.out)
        for name in self.garments:
            rival = make_rival(load_garment(name, body), body, self.quality)
            for path in sequences(self.data, name, self.split):
                clip = load_simulated(path)
                skinned = skin(rival.rest, rival.weights, clip.transforms)
                posed = posed_skin(body, clip.transforms, used)
                began = time.process_time()
                frames = list(self._frames(rival, skinned.numpy(), posed.numpy(), faces, clip.fps))
                ms = 1000.0 * (time.process_time() - began) / len(frames)
                offsets = torch.from_numpy(np.stack([skinned[0].numpy(), *frames])) - skinned
                vertices = rival.carried(offsets, clip.transforms)
                self.write(path.name, vertices, clip.fps, ms, len(rival.rest))

    def _frames(
        self,
        rival: Rival,
        targets: NDArray[np.float32],
        body: NDArray[np.float32],
        faces: NDArray[np.uint32],
        fps: float,
    ) -> Iterator[NDArray[np.float32]]:
        """Yield the cloth (n, 3) m at each frame after the first.

        targets: (F, n, 3) m, which the band follows. body: (F, B, 3) m and faces: (M, 3) of the collider.
        """
        world = rapier3d.PhysicsWorld(gravity=(0.0, 0.0, -9.81))
        world.set_num_threads(1)
        steps = max(1, round(self.rate / fps))
        parameters = world.integration_parameters
        parameters.dt = 1.0 / (fps * steps)
        parameters.num_solver_iterations = self.substeps
        parameters.normalized_prediction_distance = NEAR
        skinned = world.add_soft_body(make_body(body[0], faces))
        cloth = world.add_soft_body(make_cloth(rival, targets[0]).self_contacts(self.self_contact))
        band = np.flatnonzero(rival.held).tolist()
        for frame in range(len(targets) - 1):
            path = targets[frame + 1] - targets[frame]
            for step in range(steps):
                # Pinned particles keep their velocity, or go to a target: a body of thousands is set at once.
                world.soft_bodies[skinned].particle_velocities = (body[frame + 1] - body[frame]) * fps
                there = targets[frame] + path * ((step + 1) / steps)
                for vertex in band:
                    world.soft_bodies[cloth].set_particle_kinematic_target(vertex, there[vertex].tolist())
                world.step()
            yield np.array(world.soft_bodies[cloth].particle_positions, np.float32)


def collider(body: Body) -> tuple[Tensor, NDArray[np.uint32]]:
    """The vertices of the body's regions MET, and their faces."""
    met = torch.isin(body.regions, torch.tensor([REGIONS.index(region) for region in MET]))
    used, faces = body.mesh.faces[met].unique(return_inverse=True)
    return used, faces.numpy().astype(np.uint32)


def make_body(vertices: NDArray[np.float32], faces: NDArray[np.uint32]) -> rapier3d.SoftBodyBuilder:
    """A mesh of pinned particles, which holds nothing inside it."""
    return (
        rapier3d.SoftBody.trimesh(vertices, faces)
        .shape_matching(False)
        .edges(np.zeros((0, 2), np.uint32))
        .dihedrals(np.zeros((0, 4), np.uint32))
        .pinned_particles(np.arange(len(vertices), dtype=np.uint32))
        .self_contacts(False)
        .oriented(True)
        .particle_radius(RADIUS / 2)
        .surface_collider(rapier3d.Collider.ball(1.0).friction(FRICTION))
    )


def make_cloth(rival: Rival, vertices: NDArray[np.float32]) -> rapier3d.SoftBodyBuilder:
    """Cloth of edges and folds with a pinned band."""
    material = rapier3d.SoftBodyMaterial()
    material.edge_softness = rapier3d.SpringCoefficients(STRETCH, 1.0)
    material.bend_softness = rapier3d.SpringCoefficients(BEND, 1.0)
    return (
        rapier3d.SoftBody.trimesh(vertices, rival.faces.numpy().astype(np.uint32))
        .shape_matching(False)
        .masses(rival.mass.tolist())
        .material(material)
        .pinned_particles(np.flatnonzero(rival.held).astype(np.uint32))
        .particle_radius(RADIUS)
        .can_sleep(False)
        .surface_collider(rapier3d.Collider.ball(1.0).friction(FRICTION))
    )


if __name__ == "__main__":
    sys.exit(run_command("rapier.py", lambda: tyro.cli(Rapier).run()))
