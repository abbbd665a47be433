"""Trained wrinkles: the network, its checkpoint, and what it serves."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from uvcloth.bodies.body import Body
from uvcloth.checkpoint import Checkpoint, TrainingData, body_record, load_checkpoint, restored
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.templates import load_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.fabric import JERSEY
from uvcloth.wrinkles.network import WrinkleConfig, WrinkleNet

METHOD = "wrinkles"
"""Name in a checkpoint."""

TRAINED_BODY = "default"
"""Name of the body that the networks in the package were trained on."""

BY_DEFAULT = ("tops",)
"""Templates whose pictures have wrinkles without being asked for: better in validation than plain ones."""

SAME_PLACE = 1e-4
"""Distance of texture coordinates, in parts of the sheet, below which they are the same."""

SHIPPED = Path(str(files("uvcloth"))) / "data" / "wrinkles"
"""Folder of the trained networks in the package, a folder for each template."""


def shipped_for(outfit: Outfit) -> Path:
    """Folder of the packaged network of the outermost garment that has one; of T-shirts if none has."""
    folders = [SHIPPED / garment.template for garment in outfit.garments if garment.template]
    return next((folder for folder in reversed(folders) if folder.is_dir()), SHIPPED / "tops")


@dataclass(frozen=True)
class Wrinkles:
    """A trained network of wrinkles."""

    config: WrinkleConfig
    net: WrinkleNet

    @classmethod
    def untrained(cls, config: WrinkleConfig) -> "Wrinkles":
        """The network with untrained weights, which makes no wrinkles."""
        return cls(config, WrinkleNet(config))

    def unsupported_reason(self, garment: Garment, quality: str) -> str:
        """The reason that it has no wrinkles for a garment on a cage of a quality, "" if it has."""
        if quality != self.config.quality:
            return (
                f"garment {garment.name}: wrinkles are trained for --quality {self.config.quality}, "
                f"not {quality}"
            )
        if garment.fabric != JERSEY:
            return f"garment {garment.name}: wrinkles are trained for jersey, not for another fabric"
        if garment.template not in self.config.garments:
            kind = garment.template or "a garment without template"
            return (
                f"garment {garment.name}: wrinkles are trained for {', '.join(self.config.garments)}, "
                f"not {kind}"
            )
        if garment.source == "file" and not has_coordinates_of(garment.mesh, garment.template):
            return (
                f"garment {garment.name}: wrinkles lie on the texture coordinates of the template "
                f"{garment.template}, which it does not have"
            )
        return ""


def has_coordinates_of(mesh: Mesh, template: str) -> bool:
    """Tell whether the faces of a mesh lie on a template's texture coordinates, in any order."""
    cut = load_template(template)
    if len(mesh.faces) != len(cut.faces) or not len(mesh.uvs):
        return False
    ours, theirs = mesh.uvs[mesh.face_uvs].mean(1), cut.uvs[cut.face_uvs].mean(1)
    distance, nearest = KDTree(theirs.numpy()).query(ours.numpy())
    return bool(distance.max() < SAME_PLACE) and len(np.unique(nearest)) == len(theirs)


def wrinkles_checkpoint(
    wrinkles: Wrinkles, body: Body, data: TrainingData, notes: Mapping[str, Any]
) -> Checkpoint:
    """The checkpoint of trained wrinkles; weights in half precision."""
    return Checkpoint(
        method=METHOD,
        config=asdict(wrinkles.config),
        tensors={name: value.half() for name, value in wrinkles.net.state_dict().items()},
        body=body_record(body),
        garments=wrinkles.config.garments,
        data=data,
        notes=dict(notes),
    )


def load_wrinkles(folder: Path) -> Wrinkles:
    """Read trained wrinkles, for any body. Raises InputError as `load_checkpoint`, and for another method."""
    checkpoint = load_checkpoint(folder)
    if checkpoint.method != METHOD:
        raise InputError(f"{folder}: a model of method {checkpoint.method!r:.60}, expected {METHOD}")
    wrinkles: Wrinkles = restored(
        checkpoint, folder, WrinkleConfig, Wrinkles.untrained, lambda each: each.net
    )
    wrinkles.net.eval()
    return wrinkles
