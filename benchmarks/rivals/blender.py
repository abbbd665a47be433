"""Blender's cloth over the windows of a data folder, for `--predicted blender=OUT`.

    UVCLOTH_BLENDER_PYTHON=PYTHON PYTHONPATH=. python benchmarks/rivals/blender.py DATA OUT
    ... blender.py DATA OUT --quality mesh --steps 16 --collision-steps 3 --self-collision

It gets the motion and the garment, not the simulation. The first command has the settings of a game: the cage
that physics has, few steps a frame, no contact of cloth with itself; the garment follows the cage. The second
has Blender at its best, on all vertices. The fabric is that of `uvcloth simulate`. The milliseconds are
processor time of Blender without its start, which is timed for one frame.
"""

import resource
import sys
from dataclasses import dataclass, replace

import torch
import tyro

from benchmarks.rivals.sequences import RivalRun, sequences
from uvcloth.bodies.body import load_body
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.files.atomic import make_folder
from uvcloth.garments.cage import QUALITIES, make_cage
from uvcloth.garments.joined import join
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.skinning import skin
from uvcloth.process.command import run_command
from uvcloth.simulation.blender import Blender, find_blender
from uvcloth.simulation.engine import Scene
from uvcloth.simulation.remeshed import scene_on
from uvcloth.simulation.run import make_scene


@dataclass(frozen=True)
class BlenderCloth(RivalRun):
    """Simulate windows with Blender's cloth."""

    steps: int = 4
    """Steps a frame, a power of two; Blender's own default is 5."""
    collision_steps: int = 1
    """Passes over contacts in a step; Blender's own default is 2."""
    self_collision: bool = False
    """Contact of cloth with itself, which Blender leaves out by default."""
    hold: float | None = None
    """Frequency of the attachment of the band, 1/s; without one it moves as the skinned garment."""

    def run(self) -> None:
        """Simulate. Raises InputError for a damaged sequence, and if Blender is missing or ends."""
        torch.set_grad_enabled(False)
        body = load_body()
        blender = replace(
            find_blender(),
            quality=self.steps,
            collision_quality=self.collision_steps,
            self_collision=self.self_collision,
            hold=self.hold,
        )
        make_folder(self.out)
        for name in self.garments:
            cloth = join(load_garment(name, body), body)
            mesh = cloth.garment.mesh
            cage = (
                make_cage(mesh.vertices[cloth.kept], cloth.faces, QUALITIES[self.quality])
                if self.quality in QUALITIES
                else None
            )
            for path in sequences(self.data, name, self.split):
                clip = load_simulated(path)
                skinned = skin(mesh.vertices, cloth.garment.smooth_weights, clip.transforms)
                scene = make_scene((cloth,), [skinned], clip.transforms, body, clip.fps)
                solved = scene_on(scene, cage) if cage else scene
                _, start = simulated(blender, first_frames(solved, 1))
                moved, seconds = simulated(blender, solved)
                offsets = moved - solved.skinned
                vertices = scene.skinned + (cage.at_garment(offsets) if cage else offsets)
                ms = 1000.0 * (seconds - start) / (len(moved) - 1)
                self.write(path.name, cloth.whole(vertices, skinned), clip.fps, ms, moved.shape[1])


def simulated(blender: Blender, scene: Scene) -> tuple[torch.Tensor, float]:
    """The frames (F, n, 3) m of a scene, and the seconds of processor time that Blender's process took."""
    began = children_seconds()
    frames = torch.stack([frame.vertices for frame in blender.simulate(scene)])
    return frames, children_seconds() - began


def children_seconds() -> float:
    """Seconds of processor time of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def first_frames(scene: Scene, count: int) -> Scene:
    """The beginning of a scene."""
    return replace(scene, skinned=scene.skinned[:count], collider=scene.collider[:count])


if __name__ == "__main__":
    sys.exit(run_command("blender.py", lambda: tyro.cli(BlenderCloth).run()))
