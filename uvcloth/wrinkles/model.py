"""Trained wrinkles: the network, its checkpoint, and garments with wrinkles, frame after frame."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.checkpoint import Checkpoint, TrainingData, body_record, load_checkpoint, restored
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.geometry.mesh import Mesh, neighbour_average
from uvcloth.physics.fabric import JERSEY
from uvcloth.physics.outfit_clearing import CLEARANCE
from uvcloth.physics.surface import BodySurface
from uvcloth.wrinkles.inputs import FARTHEST, Past, first_past, input_maps, texel_inputs
from uvcloth.wrinkles.network import WrinkleConfig, WrinkleNet
from uvcloth.wrinkles.sheet import Sheet

METHOD = "wrinkles"
"""Name in a checkpoint."""

SHIPPED = Path(str(files("uvcloth"))) / "data" / "wrinkles"
"""Folder of the trained network in the package."""


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
        return ""


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


def load_wrinkles(folder: Path, body: Body) -> Wrinkles:
    """Read trained wrinkles. Raises InputError as `load_checkpoint`, and for a model of another method."""
    checkpoint = load_checkpoint(folder, body)
    if checkpoint.method != METHOD:
        raise InputError(f"{folder}: a model of method {checkpoint.method!r:.60}, expected {METHOD}")
    wrinkles: Wrinkles = restored(
        checkpoint, folder, WrinkleConfig, Wrinkles.untrained, lambda each: each.net
    )
    wrinkles.net.eval()
    return wrinkles


class WrinkledGarment:
    """One garment of a rollout with wrinkles: its refined mesh, and what the network remembers of it."""

    def __init__(self, wrinkles: Wrinkles, garment: Garment) -> None:
        """Lay the garment out. Raises InputError as `Sheet.of` does."""
        self.sheet = Sheet.of(garment, wrinkles.config.size)
        self._net, self._config = wrinkles.net, wrinkles.config
        mesh = self.sheet.refined.mesh
        self._average = neighbour_average(mesh.faces, len(mesh.vertices)).float().to_sparse_csr()
        self._past: Past | None = None
        self._shown: Tensor | None = None

    @property
    def mesh(self) -> Mesh:
        """The refined mesh at rest."""
        return self.sheet.refined.mesh

    def begin(self) -> None:
        """Forget the frames before."""
        self._past = self._shown = None

    @torch.no_grad()
    def wrinkled(self, vertices: Tensor, fps: float, skin: BodySurface) -> Tensor:
        """Vertices (n, 3) m of the refined mesh with wrinkles, of the next frame of the garment (N, 3) m.

        skin: of the body in this frame, which wrinkles keep off. All frames are in one frame of reference.
        """
        points, refined = vertices[self.sheet.refined.kept], self.sheet.refined
        near = skin.closest(points, FARTHEST)
        past = first_past(self.sheet, points) if self._past is None else self._past
        rows, axes, self._past = texel_inputs(self.sheet, points, past, fps, near.signed_distance)
        maps = self._net(input_maps(self.sheet, rows[None]))
        local = maps[0].flatten(1)[:, self.sheet.texels.pixels].T.reshape(-1, 3, 4)
        if self._shown is not None:
            local = lagged(self._shown, local, fps, self._config.lag)
        self._shown = local
        rough = self._config.gain * self.sheet.at_vertices(axes @ local)
        # Half the way to the mean around: gains of texels are rough, and both sides of a seam differ.
        offsets = 0.5 * (rough + self._average @ rough)
        # The smooth surface, and planes along the skin, which between points are those between theirs.
        values = torch.cat([points, near.normals, near.signed_distance[:, None]], dim=1)
        smooth, normals, away = (refined.matrix @ values).split([3, 3, 1], dim=1)
        outwards = (offsets * normals).sum(1, keepdim=True)
        room = (away - CLEARANCE).clamp(min=0.0)
        return smooth + offsets + (outwards.clamp(min=-room) - outwards) * normals


def lagged(before: Tensor, now: Tensor, fps: float, lag: float) -> Tensor:
    """Values that follow new ones, now, from those of the frame before with a lag, s."""
    return now if lag == 0.0 else now + math.exp(-1.0 / (fps * lag)) * (before - now)
