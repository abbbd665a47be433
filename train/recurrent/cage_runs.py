"""Runs of the solver on a garment's cage over training motion, made as fast as they are learned from.

Run from the checkout as

    python -m train.recurrent.cage_runs DATA --garment dress --windows index.csv --clips-from mocap --runs 300

beside a training on DATA: each run is a file, which the training takes in when it validates next. Clips of
the index's split `validation` come first, into DATA/validation, on one body and of jersey. With `--bodies`
half of the runs are on one of these instead, and with `--fabrics` half of a fabric drawn at random.
"""

import math
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from rich.console import Console
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.commands.options import BodyFile
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.files.atomic import make_folder
from uvcloth.files.fields import check_fields, numbers, text
from uvcloth.files.options import AtLeast
from uvcloth.garments.cage import QUALITIES, Cage, kept_cage
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.mesh import welded
from uvcloth.geometry.rotations import rotate, rotate_back
from uvcloth.geometry.skinning import blend_transforms, skin
from uvcloth.methods.physics.dressed import dressed, move_on
from uvcloth.methods.physics.outfit import CagedOutfit, PhysicsConfig, make_caged_outfit
from uvcloth.methods.recurrent.condition import condition
from uvcloth.physics.fabric import JERSEY, Fabric
from uvcloth.physics.surface import BodySurface, SurfacePoints
from uvcloth.process.command import run_command

from .motions import FPS, Motions

RUN_FORMAT = "uvcloth-cage-run-3"

FIELDS = {
    "garment": text(),
    "quality": text(),
    "clip": text(),
    "subject": text(),
    "transforms": numbers("T", "J", 3, 4),
    "resting": numbers("T", "n", 3),
    "skin": numbers("T", "n", 4),
    "blend": numbers("n", "J"),
    "heads": numbers("J", 3),
    "condition": numbers("S"),
}
"""Arrays of a run's file."""

POSED_AT_ONCE = 32
"""Frames whose body is posed at once."""

FLATTEST = 0.2
"""Least determinant of a blended transform that is inverted: between legs far apart they are nearly flat."""

NEAR, FAR = 0.05, 1.0
"""Metres within which skin is kept, and the distance that stands for more."""

DRAWN = {
    "density": (0.07, 0.4),
    "stretch": (30.0, 100.0),
    "bend": (1e-6, 1e-4),
    "friction": (0.2, 0.5),
}
"""Ranges of the fabrics that are drawn, evenly by logarithm: those of FABRICS, and a little more."""

PREPARED_BODIES = 24
"""Bodies whose garments are kept."""


@dataclass(frozen=True)
class CageRun:
    """A cage over a motion of T frames.

    The n points are those of the garment's cage on the default body, wherever the run was made. garment:
    name. quality: of its cage. clip, subject: of the motion. transforms: (T, J, 3, 4) of the body. resting:
    (T, n, 3) m, offsets from the smoothly skinned garment before skinning turns them. skin: (T, n, 4),
    normals and offsets of planes: a point at rest (3,) is `normal @ point - offset` m off the skin that is
    nearest to the cloth. blend: (n, J) weights. heads: (J, 3) m of the body. condition: (S,) of it.
    """

    garment: str
    quality: str
    clip: str
    subject: str
    transforms: Tensor
    resting: Tensor
    skin: Tensor
    blend: Tensor
    heads: Tensor
    condition: Tensor

    def __len__(self) -> int:
        return len(self.resting)

    def to(self, device: torch.device) -> "CageRun":
        """The run on a device."""
        arrays = {name: value.to(device) for name, value in vars(self).items() if isinstance(value, Tensor)}
        return replace(self, **arrays)  # type: ignore[arg-type]

    def posed(self, resting: Tensor) -> Tensor:
        """Offsets at rest (T, n, 3), m, as skinning turns them."""
        return rotate(blend_transforms(self.blend, self.transforms)[..., :3], resting)


VALIDATION = "validation"
"""Folder, in that of the runs, of the runs of validation clips."""


def run_file(folder: Path, number: int) -> Path:
    """The file of a run."""
    return folder / f"{number:05d}.npz"


def run_files(folder: Path) -> list[Path]:
    """Files of the runs in a folder, by number."""
    return sorted(folder.glob("[0-9]*.npz"))


def save_run(run: CageRun, path: Path) -> None:
    """Write a run; offsets in half precision, which is 0.2 mm at 0.3 m. Raises InputError if it cannot be."""
    arrays = {name: value.numpy() for name, value in vars(run).items() if isinstance(value, Tensor)}
    texts = {name: np.array(value) for name, value in vars(run).items() if isinstance(value, str)}
    arrays |= {"resting": run.resting.half().numpy(), "skin": run.skin.half().numpy()}
    save_arrays(path, {"format": np.array(RUN_FORMAT), **texts, **arrays}, compressed=False)


def load_run(path: Path) -> CageRun:
    """Read what `save_run` wrote. Raises InputError naming the file if it is damaged or another format."""
    data = check_fields(path, load_arrays(path, RUN_FORMAT, "a run of a cage made by this version"), FIELDS)
    texts = {name: str(value) for name, value in data.items() if not value.ndim}
    arrays = {name: torch.from_numpy(value).float() for name, value in data.items() if value.ndim}
    return CageRun(**texts, **arrays)  # type: ignore[arg-type]


@torch.no_grad()
def simulate_cage(
    prepared: CagedOutfit, body: Body, transforms: Tensor, reference: Cage
) -> tuple[Tensor, Tensor, Tensor]:
    """Resting (T, n, 3), skin (T, n, 4) and blend (n, J) of a run at a reference cage's points.

    Cloth is at rest before the first frame. Raises InputError where cloth flies apart.
    """
    (garment,) = prepared.garments
    blend = reference.at_cage(garment.weights)
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    resting, skins, cloth = [], [], None
    for some in transforms.split(POSED_AT_ONCE):
        offsets, posed = [], posed_skin(body, some)
        for transform in some:
            if cloth is None:
                cloth = dressed(prepared, transform)
            else:
                move_on(cloth, transform, FPS)
            offset = (torch.from_numpy(cloth.cages()) - prepared.skinned_cages(transform)).float()
            offsets.append(reference.at_cage(garment.cage.at_garment(offset)))
        base = reference.at_cage(skin(garment.mesh.points, garment.weights, some))
        turns = blend_transforms(blend, some)[..., :3]
        rows = at_rest(turns, base, torch.stack(offsets), surface, posed)
        resting.append(rows[0])
        skins.append(rows[1])
    return torch.cat(resting), torch.cat(skins), blend


def at_rest(
    turns: Tensor, base: Tensor, offsets: Tensor, surface: BodySurface, posed: Tensor
) -> tuple[Tensor, Tensor]:
    """Offsets (T, n, 3) and planes of the skin (T, n, 4) of a run at rest, see CageRun.

    turns: (T, n, 3, 3) of skinning. base: (T, n, 3) m, skinned points; cloth is offsets (T, n, 3) off them.
    surface: the body's, which is put into the poses (T, V, 3).
    """
    near = []
    for points, vertices in zip(base + offsets, posed, strict=True):
        surface.update(vertices)
        near.append(_planes(surface.closest(points, NEAR)))
    resting = _resting(turns, offsets)
    return resting, _planes_at_rest(turns, torch.stack(near), resting)


def _planes(points: SurfacePoints) -> Tensor:
    """Normals of the skin closest to a cage, and distances from it: (n, 4); 0 and FAR for none."""
    near = points.faces >= 0
    normals = torch.where(near[:, None], points.normals, 0.0)
    distances = torch.where(near, points.signed_distance, FAR)
    return torch.cat([normals, distances[:, None]], dim=1)


def _planes_at_rest(turns: Tensor, planes: Tensor, resting: Tensor) -> Tensor:
    """Planes (T, n, 4) that give distances of offsets at rest, from normals and distances in the world."""
    normals = rotate_back(turns, planes[..., :3])
    offsets = (normals * resting).sum(-1) - planes[..., 3]
    return torch.cat([normals, offsets[..., None]], dim=-1)


def _resting(turns: Tensor, offsets: Tensor) -> Tensor:
    """Offsets (T, n, 3) m before skinning turns them, the least ones where it is nearly flat."""
    first, second, third = turns.unbind(-1)
    cross = torch.linalg.cross
    rows = torch.stack([cross(second, third), cross(third, first), cross(first, second)], dim=-2)
    volume = (first * rows[..., 0, :]).sum(-1, keepdim=True)
    return rotate(rows, offsets) / volume.clamp(min=FLATTEST)


def reference_cage(garment: str, quality: str) -> Cage:
    """The cage of a template on the default body, whose points all runs of the garment have."""
    mesh = load_garment(garment, load_body()).mesh
    points = welded(mesh.vertices, mesh.faces)
    return kept_cage(points.points, points.faces, QUALITIES[quality])


def draw_fabric(generator: np.random.Generator) -> Fabric:
    """A fabric at random, see DRAWN."""
    return Fabric(**{name: math.exp(generator.uniform(*np.log(ends))) for name, ends in DRAWN.items()})


@dataclass(frozen=True)
class CageRuns:
    """Simulate a garment's cage over training motion; runs that are there are kept."""

    data: tyro.conf.Positional[Path]
    """Folder of the runs."""
    garment: str
    """Template."""
    windows: Path
    """Index of the clips: its splits `validation`, each clip once, and `train`."""
    clips_from: Path | None = None
    """Folder of the clips, by default that of the index."""
    quality: str = "fast"
    """Quality of the cage."""
    runs: Annotated[int, AtLeast(1)] = 300
    """Number of runs in the folder at the end."""
    every: Annotated[int, AtLeast(1)] = 1
    """Make one of so many runs: one process of several takes `--every 2 --first 1`."""
    first: Annotated[int, AtLeast(0)] = 0
    """Number of the first run to make."""
    seed: int = 0
    """Random seed of the motions."""
    body: BodyFile = None
    """The body of the runs of validation, and of half of the others or all; made by `uvcloth body`."""
    bodies: tuple[Path, ...] = ()
    """Bodies of the other half, with its skeleton."""
    fabrics: bool = False
    """Draw the fabric of half of the runs at random."""

    def run(self) -> None:
        """Make the runs that are missing, and say how many frames a second of processor time makes."""
        if self.quality not in QUALITIES:
            raise InputError(f"--quality {self.quality}: expected one of {', '.join(QUALITIES)}")
        make_folder(self.data / VALIDATION)
        missing = list(self._missing())
        if not missing:
            return
        reference = reference_cage(self.garment, self.quality)
        console = Console(stderr=True)
        begun, frames = time.process_time(), 0
        for path, split, captured, number in missing:
            file, fabric = self.drawn(split, number)
            body = _body(file)
            motions = replace(captured, body=body)
            entry, transforms = motions.entry(number), motions.transforms(number)
            garment = replace(_garment(self.garment, body), fabric=fabric)
            try:
                prepared = make_caged_outfit(Outfit(body, (garment,)), PhysicsConfig(self.quality))
                resting, skins, blend = simulate_cage(prepared, body, transforms, reference)
            except InputError as error:
                console.print(f"{path}: {error} in the clip {entry.clip}, it is left out")
                continue
            run = CageRun(
                garment=self.garment,
                quality=self.quality,
                clip=entry.clip,
                subject=entry.subject,
                transforms=transforms,
                resting=resting,
                skin=skins,
                blend=blend,
                heads=body.skeleton.heads,
                condition=condition(body, fabric),
            )
            save_run(run, path)
            frames += len(run)
            rate = frames / (time.process_time() - begun)
            console.print(f"{path}, {entry.clip}: {frames} frames, {rate:.0f} per CPU second")

    def drawn(self, split: str, number: int) -> tuple[Path | None, Fabric]:
        """The body, None for the one of the package, and the fabric of a run."""
        generator = np.random.default_rng((self.seed, number, 1))
        file, fabric = self.body, JERSEY
        if split == "train":
            if self.bodies and generator.random() < 0.5:
                file = self.bodies[generator.integers(len(self.bodies))]
            if self.fabrics and generator.random() < 0.5:
                fabric = draw_fabric(generator)
        return file, fabric

    def _missing(self) -> Iterator[tuple[Path, str, Motions, int]]:
        """The file of each run to make, its split, the motions of that, and its number among them."""
        body = _body(self.body)
        for split, folder in (("validation", self.data / VALIDATION), ("train", self.data)):
            motions = Motions.of_split(split, self.windows, self.clips_from, body, self.seed)
            runs = self.runs if split == "train" else len(motions.entries)
            for number in range(self.first, runs, self.every):
                if not run_file(folder, number).exists():
                    yield run_file(folder, number), split, motions, number


@lru_cache(PREPARED_BODIES)
def _body(file: Path | None) -> Body:
    return load_body(file)


@lru_cache(PREPARED_BODIES)
def _garment(name: str, body: Body) -> Garment:
    return load_garment(name, body)


if __name__ == "__main__":
    sys.exit(run_command("train.recurrent.cage_runs", lambda: tyro.cli(CageRuns).run()))
