"""Jolt Physics, the cloth of a game engine, over the windows of a data folder, for `--predicted jolt=OUT`.

    npm install --prefix FOLDER jolt-physics@1.1.0
    PYTHONPATH=. python benchmarks/rivals/jolt.py DATA OUT --jolt FOLDER [--split validation]
    PYTHONPATH=. python benchmarks/rivals/jolt.py DATA OUT --jolt FOLDER --split train --clips 3 --tune 20

It gets the motion and the garment, not the simulation. Its cloth is the cage that physics has (or the mesh of
the garment with --quality mesh), held by skinned constraints, with backstops and convex hulls on the bones.
--tune draws settings at random around those below, and prints them with their mean distance from the
simulations, mm, the best first. Needs Node.
"""

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation
from torch import Tensor

from benchmarks.rivals.sequences import RivalRun, sequences
from uvcloth.bodies.body import REGIONS, Body, load_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.files.atomic import make_folder
from uvcloth.garments.band import holding_band
from uvcloth.garments.cage import QUALITIES, make_cage
from uvcloth.garments.garment import Garment
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.mesh import edge_lengths, face_normals, unique_edges, welded
from uvcloth.geometry.skinning import skin
from uvcloth.physics.surface import BodySurface
from uvcloth.process.command import run_command

PROGRAM = Path(__file__).with_name("jolt_cloth.mjs")

DENSITY = 0.2
"""Mass of cloth, kg/m2."""

SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "dress": {
        "substeps": 4, "iterations": 6, "stretch": 0.03, "shear": 0.1, "bend": 3e4,
        "tether": "GeodesicDistance", "tether_length": 1.05, "damping": 1.0, "follow": 1.0, "friction": 0.0,
        "radius": 0.008, "gravity": 9.81, "backstop": 0.1, "slack": 0.0, "farthest": 1e9, "slope": 0.0,
        "tight": 0.0, "tight_distance": 0.03, "hulls": ("thigh", "calf"),
    },
    "tops": {
        "substeps": 2, "iterations": 6, "stretch": 0.03, "shear": 1.0, "bend": 1e4,
        "tether": "EuclideanDistance", "tether_length": 1.05, "damping": 2.0, "follow": 8.0, "friction": 0.05,
        "radius": 0.002, "gravity": 9.81, "backstop": 0.1, "slack": -0.003, "farthest": 0.2, "slope": 0.0,
        "tight": 0.0, "tight_distance": 0.05, "hulls": ("thigh", "calf"),
    },
    "bottoms": {
        "substeps": 2, "iterations": 6, "stretch": 0.03, "shear": 0.0, "bend": 1e4,
        "tether": "None", "tether_length": 1.02, "damping": 2.0, "follow": 8.0, "friction": 0.1,
        "radius": 0.008, "gravity": 7.0, "backstop": 0.06, "slack": 0.0, "farthest": 1e9, "slope": 0.0,
        "tight": 0.03, "tight_distance": 0.05, "hulls": (),
    },
}  # fmt: skip
"""Settings by garment, tuned on training clips. stretch, shear and bend are compliances. tether: a long range
attachment and its length over that at rest. follow: 1/s, damping relative to the skinned garment. backstop:
clearance at rest below which the body is a half space, slack m behind it. farthest, slope: most distance from
the skinned garment, m, and how much it grows per metre from the band. tight: clearance below which that is
tight_distance. hulls: regions of the body that are colliders."""

TUNED = ("stretch", "shear", "bend", "damping", "follow", "radius", "farthest", "tight_distance", "gravity")
"""Settings that are drawn at random between half and twice their value."""

SLAB, OVERLAP, SUPPORTS = 0.2, 0.02, 48
"""Length of a hull along its bone and overlap with the next, m, and the most points of a hull."""


@dataclass(frozen=True)
class Jolt(RivalRun):
    """Simulate windows with Jolt Physics."""

    jolt: Path = field(kw_only=True)
    """Folder in which `npm install jolt-physics` ran."""
    tune: int = 0
    """Number of settings to try instead of simulating once."""
    clips: int = 0
    """Most clips of the split; 0 for all."""

    def run(self) -> None:
        """Simulate, or tune. Raises InputError for a damaged sequence."""
        torch.set_grad_enabled(False)
        body = load_body()
        if not self.tune:
            make_folder(self.out)
        for name in self.garments:
            garment = load_garment(name, body)
            cloth = make_rival(garment, body, self.quality)
            paths = self._sequences(name)
            if self.tune:
                self._tune(cloth, name, [load_simulated(path) for path in paths])
                continue
            for path in paths:
                clip = load_simulated(path)
                vertices, ms = self._simulate(cloth, clip, SETTINGS[name])
                self.write(path.name, vertices, clip.fps, ms, len(cloth.rest))

    def _sequences(self, garment: str) -> list[Path]:
        """The sequences of a garment in the split."""
        there = sequences(self.data, garment, self.split)
        # Evenly over the index, whose neighbours are alike.
        return there[:: max(1, len(there) // self.clips)][: self.clips] if self.clips else there

    def _tune(self, cloth: "Rival", name: str, clips: list[SimulatedClip]) -> None:
        """Print settings and their mean distances, the best first."""
        generator = np.random.default_rng(0)
        tried = []
        for trial in range(self.tune):
            factors = 2.0 ** generator.uniform(-1, 1, len(TUNED)) if trial else np.ones(len(TUNED))
            drawn = {key: SETTINGS[name][key] * float(by) for key, by in zip(TUNED, factors, strict=True)}
            errors = []
            for clip in clips:
                vertices, _ = self._simulate(cloth, clip, {**SETTINGS[name], **drawn})
                far = (vertices - clip.vertices)[clip.warm_up :].norm(dim=2)
                errors.append(1000.0 * float(far.mean()))
            tried.append((float(np.mean(errors)), drawn))
            print(f"{name} {trial}: {tried[-1][0]:.2f} mm", flush=True)
        for error, drawn in sorted(tried, key=lambda each: each[0])[:5]:
            print(f"{name} {error:.2f} mm { ({key: round(value, 4) for key, value in drawn.items()}) }")

    def _simulate(
        self, cloth: "Rival", clip: SimulatedClip, settings: Mapping[str, Any]
    ) -> tuple[Tensor, float]:
        """The garment (F, N, 3) m, and milliseconds of processor time a frame."""
        targets = skin(cloth.rest, cloth.weights, clip.transforms)
        options = {key: value for key, value in settings.items() if key != "hulls"}
        hulls = [each for each in cloth.hulls if each.region in settings["hulls"]]
        points = np.concatenate([np.zeros((0, 3), np.float32), *(each.points for each in hulls)])
        arrays = {
            "rest": cloth.rest.numpy(), "faces": cloth.faces.numpy(), "mass": cloth.mass, "held": cloth.held,
            "clearance": cloth.clearance, "below": cloth.below, "targets": targets.numpy(),
            "joints": joint_poses(clip.transforms), "hull_points": points,
        }  # fmt: skip
        header = {
            "options": options, "fps": clip.fps, "frames": len(targets), "joints": clip.transforms.shape[1],
            "hulls": [{"joint": each.joint, "count": len(each.points)} for each in hulls],
        }  # fmt: skip
        with TemporaryDirectory() as folder:
            source, result = Path(folder) / "in", Path(folder) / "out"
            source.write_bytes(packed(header, arrays))
            command = ["node", *map(str, (PROGRAM, source, result, self.jolt))]
            ran = subprocess.run(command, capture_output=True, text=True, check=True)
            moved = torch.from_numpy(np.fromfile(result, np.float32)).view(targets.shape)
        return cloth.carried(moved - targets, clip.transforms), float(ran.stdout)


@dataclass(frozen=True)
class Hull:
    """Convex hull on a bone. joint: that moves it. region: of the body. points: (P, 3) m at rest."""

    joint: int
    region: str
    points: NDArray[np.float32]


@dataclass(frozen=True)
class Rival:
    """A garment for Jolt.

    rest: (n, 3) m, faces: (M, 3) and weights: (n, J) of the mesh that it moves. mass: (n,) kg. held: (n,) 1
    for the band. clearance: (n,) m from the body. below: (n,) m from the band along edges. carry: the garment
    that follows.
    """

    rest: Tensor
    faces: Tensor
    weights: Tensor
    mass: NDArray[np.float32]
    held: NDArray[np.int32]
    clearance: NDArray[np.float32]
    below: NDArray[np.float32]
    hulls: tuple[Hull, ...]
    garment: Garment
    at_garment: Any

    def carried(self, offsets: Tensor, transforms: Tensor) -> Tensor:
        """The garment (F, N, 3) m with offsets (F, n, 3) m from the skinned one."""
        skinned = skin(self.garment.mesh.vertices, self.garment.smooth_weights, transforms)
        return skinned + self.at_garment(offsets)


def make_rival(garment: Garment, body: Body, quality: str) -> Rival:
    """Prepare a garment on a cage of a quality, or on its own mesh."""
    mesh = welded(garment.mesh.vertices, garment.mesh.faces)
    weights, band = garment.smooth_weights[mesh.kept], holding_band(garment, body).vertices[mesh.kept]
    rest, faces, held = mesh.points, mesh.faces, band
    if quality in QUALITIES:
        cage = make_cage(mesh.points, mesh.faces, QUALITIES[quality])
        rest, faces, weights = cage.vertices, cage.faces, cage.at_cage(weights)
        held = cage.at_cage(band[:, None].float())[:, 0] > 0.5

    def at_garment(offsets: Tensor) -> Tensor:
        fine = cage.at_garment(offsets) if quality in QUALITIES else offsets
        return fine[:, mesh.places]

    areas = 0.5 * face_normals(rest, faces).norm(dim=1)
    mass = torch.zeros(len(rest)).index_add(0, faces.flatten(), (DENSITY * areas / 3.0).repeat_interleave(3))
    edges = unique_edges(faces)
    graph = coo_array((edge_lengths(rest, edges).numpy(), edges.T.numpy()), shape=(len(rest), len(rest)))
    ways = dijkstra(graph.tocsr(), directed=False, indices=np.flatnonzero(held.numpy()), min_only=True)
    clearance = BodySurface(body.mesh.vertices, body.mesh.faces).closest(rest).signed_distance
    return Rival(
        rest=rest,
        faces=faces.int(),
        weights=weights,
        mass=mass.numpy(),
        held=held.int().numpy(),
        clearance=clearance.numpy(),
        below=ways.astype(np.float32),
        hulls=tuple(make_hulls(body)),
        garment=garment,
        at_garment=at_garment,
    )


def make_hulls(body: Body, regions: tuple[str, ...] = ("torso", "thigh", "calf")) -> Iterator[Hull]:
    """Hulls of the body at rest, in slabs along its bones."""
    vertices, owners = body.mesh.vertices.numpy(), body.weights.argmax(1).numpy()
    region_of = np.full(len(vertices), -1)
    region_of[body.mesh.faces.numpy()] = body.regions.numpy()[:, None]
    height = vertices[:, 2]
    for region in regions:
        inside = region_of == REGIONS.index(region)
        for joint in np.unique(owners[inside]):
            mine = inside & (owners == joint)
            low, high = height[mine].min(), height[mine].max()
            cuts = np.linspace(low, high, max(1, round((high - low) / SLAB)) + 1)
            for begin, end in pairwise(cuts):
                slab = vertices[mine & (height >= begin - OVERLAP) & (height <= end + OVERLAP)]
                if len(slab) >= 12:
                    yield Hull(int(joint), region, _outermost(slab).astype(np.float32))


def _outermost(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """The points that lie furthest in each of SUPPORTS directions, on a Fibonacci sphere."""
    step = np.arange(SUPPORTS) + 0.5
    up, turn = 1.0 - 2.0 * step / SUPPORTS, np.pi * (1.0 + 5.0**0.5) * step
    level = np.sqrt(1.0 - up**2)
    directions = np.stack([level * np.cos(turn), level * np.sin(turn), up], 1)
    return points[np.unique((points @ directions.T).argmax(0))]


def joint_poses(transforms: Tensor) -> NDArray[np.float32]:
    """Places and quaternions (F, J, 7), x y z first, of transforms (F, J, 3, 4), without jumps of sign."""
    frames, joints = transforms.shape[:2]
    turns = Rotation.from_matrix(transforms[..., :3].reshape(-1, 3, 3).numpy()).as_quat()
    turns = turns.reshape(frames, joints, 4)
    flips = np.where((turns[1:] * turns[:-1]).sum(2) < 0.0, -1.0, 1.0).cumprod(0)
    turns[1:] *= flips[..., None]
    return np.concatenate([transforms[..., 3].numpy(), turns], axis=2).astype(np.float32)


def packed(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Header and arrays as PROGRAM reads them."""
    kinds = {name: np.int32 if each.dtype.kind == "i" else np.float32 for name, each in arrays.items()}
    listed = [{"name": n, "kind": kinds[n].__name__, "count": each.size} for n, each in arrays.items()]
    text = json.dumps({**header, "arrays": listed}).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(np.ascontiguousarray(each, kinds[name]).tobytes() for name, each in arrays.items())
    return len(text).to_bytes(4, "little") + text + body


if __name__ == "__main__":
    sys.exit(run_command("jolt.py", lambda: tyro.cli(Jolt).run()))
