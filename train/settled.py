"""Outfits at rest in poses, settled on cages: they supervise models that see the pose alone."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from rich.progress import track
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.files.fields import check_fields, numbers, text, whole
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.methods.physics.dressed import dressed, shown
from uvcloth.methods.physics.outfit import CagedOutfit, PhysicsConfig, make_caged_outfit

SETTLED_FILE = "settled.npz"
"""File of a run with the outfits that were settled for it."""

SETTLED_FORMAT = "uvcloth-settled-1"

FIELDS = {
    "of": text(),
    "tried": whole(),
    "rows": whole("S").or_empty(),
    "vertices": numbers("S", "N", 3).or_empty(),
}
"""Arrays of that file; of: hash of the outfit and all poses; tried: how many poses were."""

SAVED_EVERY = 25
"""Poses after which the file is written."""


def settle(prepared: CagedOutfit, transforms: Tensor) -> tuple[Tensor, ...]:
    """Each garment (N, 3) m at rest on a body in a pose (J, 3, 4), cleared off its skin.

    Raises InputError where cloth flies apart.
    """
    return shown(dressed(prepared, transforms), torch.zeros(3))


@dataclass(frozen=True)
class SettledOutfit:
    """An outfit at rest in S of P poses.

    rows: (S,) of the poses; those in which cloth flew apart are left out. vertices: (S, N, 3) m, all
    garments, one after another. tried: number of the poses that were simulated so far.
    """

    rows: Tensor
    vertices: Tensor
    tried: int


def settled_outfit(outfit: Outfit, transforms: Tensor, path: Path) -> SettledOutfit:
    """Settle an outfit in poses (P, J, 3, 4), or read it from the file that keeps it.

    A file that an interruption left is continued. Raises InputError for a file of another outfit or other
    poses, for a damaged one, and as `make_caged_outfit` does.
    """
    of = _fingerprint(outfit, transforms)
    settled = _load(path, of) if path.exists() else _nothing(outfit)
    if settled.tried == len(transforms):
        return settled
    prepared = make_caged_outfit(outfit, PhysicsConfig())
    rows, vertices = [settled.rows], [settled.vertices]
    for row in track(range(settled.tried, len(transforms)), "settling the outfit"):
        # Where cloth flies apart the pose is left out.
        with suppress(InputError):
            vertices.append(torch.cat(settle(prepared, transforms[row]))[None])
            rows.append(torch.tensor([row]))
        if (row + 1) % SAVED_EVERY == 0 or row + 1 == len(transforms):
            settled = SettledOutfit(torch.cat(rows), torch.cat(vertices), row + 1)
            _save(settled, of, path)
    return settled


def _nothing(outfit: Outfit) -> SettledOutfit:
    """No pose yet."""
    vertices = sum(len(garment.mesh.vertices) for garment in outfit.garments)
    return SettledOutfit(torch.zeros(0, dtype=torch.int64), torch.zeros(0, vertices, 3), 0)


def _save(settled: SettledOutfit, of: str, path: Path) -> None:
    """Write the poses that are settled so far."""
    arrays = {"of": np.array(of), "tried": np.array(settled.tried), "rows": settled.rows.numpy()}
    arrays |= {"format": np.array(SETTLED_FORMAT), "vertices": settled.vertices.numpy()}
    save_arrays(path, arrays, compressed=False)


def _load(path: Path, of: str) -> SettledOutfit:
    """Settled poses from a file. Raises InputError if it is of another outfit."""
    data = check_fields(path, load_arrays(path, SETTLED_FORMAT, "a settled outfit of this version"), FIELDS)
    if str(data["of"]) != of:
        raise InputError(f"{path}: is of another outfit, fabric or poses; name another folder")
    vertices = torch.from_numpy(data["vertices"]).float()
    return SettledOutfit(torch.from_numpy(data["rows"]), vertices, int(data["tried"]))


def _fingerprint(outfit: Outfit, transforms: Tensor) -> str:
    """Hash of all that decides how an outfit comes to rest."""
    garments = [
        part
        for garment in outfit.garments
        for part in (garment.mesh.vertices, garment.mesh.faces, str(garment.fabric))
    ]
    return fingerprint(outfit.body.mesh.vertices, transforms, *garments)
