"""PBNS: blend weights and blend shapes that follow the pose, trained on physics without data.

A garment or outfit is posed by linear blend skinning of its rest shape plus a deformation, and the
deformation is a sum of blend shapes weighed by a perceptron that sees the pose (Bertiche et al. 2021, eq. 1
and 2). Every engine can play that. It is quasi-static: the same pose always looks the same, however fast the
body came there.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.checkpoint import (
    WEIGHTS,
    Checkpoint,
    TrainingData,
    body_record,
    misfit,
    require_weights_of,
    stored_config,
)
from uvcloth.errors import InputError
from uvcloth.files.fields import check_fields, indices, numbers
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import JoinedMesh, Mesh, join_meshes, weld
from uvcloth.geometry.skeleton import in_order
from uvcloth.geometry.skinning import apply_transforms, blend_transforms
from uvcloth.methods.capabilities import Riggable
from uvcloth.methods.method import Method, MethodEntry, Traits, for_inference, require_supported
from uvcloth.methods.pbns.network import PBNSConfig, PBNSNetwork
from uvcloth.methods.rig import PoseRig, pose_vectors

SAME_SHAPE = 0.002
"""Metres between joints or rest vertices that still count as the same body and garment."""


MESH_FIELDS = {
    "vertices": numbers("N", 3),
    "faces": indices("M", 3, of="N"),
    "uvs": numbers("U", 2),
    "face_uvs": indices("M", 3, of="U").or_empty(),
}
"""Tensors of a garment's mesh in a checkpoint."""

HALF_PRECISION = ("layers.", "shapes", "poses")
"""Tensors that are saved in half precision: they are most of a file, and blend shapes lose micrometres."""


@dataclass(frozen=True)
class ModelOutfit:
    """The outfit of a model: garments at rest on one body, the innermost first, as one list of N vertices.

    names: of the garments. meshes: of each. heads: (J, 3) the body's joints at rest, m. parents: (J,).
    """

    names: tuple[str, ...]
    meshes: tuple[Mesh, ...]
    heads: Tensor
    parents: tuple[int, ...]

    @property
    def joined(self) -> JoinedMesh:
        """The garments at rest as one mesh."""
        return join_meshes((mesh.vertices, mesh.faces) for mesh in self.meshes)

    @property
    def sizes(self) -> list[int]:
        """Vertices of each garment."""
        return [len(mesh.vertices) for mesh in self.meshes]


@dataclass(frozen=True)
class PBNSPrepared:
    """A model's outfit, or some of it, on a device.

    rows: (n,) of the model's vertices. sizes: vertices of each garment. weights: (n, J) blend weights.
    """

    network: PBNSNetwork
    rows: Tensor
    sizes: list[int]
    weights: Tensor


@dataclass(frozen=True)
class PBNS(Method, Riggable):
    """A quasi-static method for the outfit that it was trained on, or some of it, on that body."""

    config: PBNSConfig
    network: PBNSNetwork
    garments: ModelOutfit
    name: str = "pbns"
    traits = Traits(quasi_static=True)

    @classmethod
    def untrained(cls, config: PBNSConfig) -> "PBNS":
        """The method without a garment; training gives it one."""
        return cls(config, PBNSNetwork(config, 0, 0, 1, 0), ModelOutfit((), (), torch.zeros(1, 3), (-1,)))

    def unsupported_reason(self, outfit: Outfit) -> str:
        """Reason why it cannot dress an outfit: it is for the garments and the body of its training."""
        names = tuple(garment.name for garment in outfit.garments)
        garments = " over ".join(reversed(self.garments.names)) or "no garment yet"
        who = f"model {self.name} is for {garments}"
        if names != tuple(name for name in self.garments.names if name in names):
            return f"{who}, not for {' over '.join(reversed(names))}"
        if fault := self.body_fault(outfit.body):
            return fault
        meshes = dict(zip(self.garments.names, self.garments.meshes, strict=True))
        for garment in outfit.garments:
            mesh = meshes[garment.name]
            same_faces = torch.equal(garment.mesh.faces, mesh.faces)
            if not same_faces or garment.mesh.vertices.shape != mesh.vertices.shape:
                return f"garment {garment.name}: {who}, but another mesh of that name"
            apart = float((garment.mesh.vertices - mesh.vertices).norm(dim=1).max())
            if apart > SAME_SHAPE:
                return f"garment {garment.name}: {who}, {1000 * apart:.0f} mm from it at rest"
        return ""

    def body_fault(self, body: Body) -> str:
        """The reason that the model does not fit a body: it is for one shape of body; "" if it fits."""
        heads, expected = body.skeleton.heads, self.garments.heads
        if heads.shape == expected.shape and float((heads - expected).norm(dim=1).max()) < SAME_SHAPE:
            return ""
        return f"model {self.name} was trained on another body than {body.name!r}, in skeleton or shape"

    def prepare(self, outfit: Outfit, device: torch.device) -> PBNSPrepared:
        """Choose the vertices of the outfit. Raises InputError for an unsupported outfit."""
        require_supported(self, outfit)
        rows = self._rows([garment.name for garment in outfit.garments])
        network = for_inference(self.network, device)
        indices = torch.cat(rows).to(device)
        return PBNSPrepared(network, indices, [len(each) for each in rows], network.blend_weights()[indices])

    def _rows(self, names: Sequence[str]) -> list[Tensor]:
        """Rows of the model's vertices that are those of each of some of its garments."""
        parts = torch.arange(len(self.network.rest)).split(self.garments.sizes)
        by_name = dict(zip(self.garments.names, parts, strict=True))
        return [by_name[name] for name in names]

    @torch.no_grad()
    def step(
        self, prepared: PBNSPrepared, state: tuple[()], frames: BodyFrames
    ) -> tuple[tuple[()], tuple[Tensor, ...]]:
        """Garment vertices (B, N, 3) of each garment, m (paper eq. 1)."""
        network, rows, transforms = prepared.network, prepared.rows, frames.transforms[:, -1]
        deformed = network.deform(pose_vectors(self.garments.parents, transforms))[:, network.owner[rows]]
        posed = apply_transforms(
            blend_transforms(prepared.weights, transforms), network.rest[rows] + deformed
        )
        return state, posed.split(prepared.sizes, dim=1)

    @torch.no_grad()
    def as_rig(self, body: Body, garments: tuple[Garment, ...] = ()) -> PoseRig:
        """The model itself, which is a rig: all of its garments, or the named ones. Raises InputError for
        another body, and for other garments.
        """
        if fault := self.body_fault(body):
            raise InputError(fault)
        if garments:
            require_supported(self, Outfit(body, garments))
        network, meshes = self.network, zip(self.garments.names, self.garments.meshes, strict=True)
        names = [garment.name for garment in garments] or self.garments.names
        rows = self._rows(names)
        points, owner = network.owner[torch.cat(rows)].unique(return_inverse=True)
        return PoseRig(
            name=self.name,
            garments=tuple((name, mesh) for name, mesh in meshes if name in names),
            owner=owner,
            weights=network.unique_weights()[points],
            shapes=network.shapes.detach().view(len(network.shapes), -1, 3)[:, points],
            layers=tuple((layer.weight.detach(), layer.bias.detach()) for layer in network.linears()),
            parents=self.garments.parents,
            poses=network.poses,
        )


def rest_outfit(outfit: Outfit) -> ModelOutfit:
    """An outfit as a model keeps it."""
    skeleton = outfit.body.skeleton
    names = tuple(garment.name for garment in outfit.garments)
    meshes = tuple(garment.mesh for garment in outfit.garments)
    return ModelOutfit(names, meshes, skeleton.heads, skeleton.parents)


def new_network(config: PBNSConfig, garments: ModelOutfit, weights: Tensor, poses: Tensor) -> PBNSNetwork:
    """An untrained network for an outfit. weights: (N, J) to start from. poses: (M, 3 J) of training."""
    joined = torch.cat(
        [weld(mesh.vertices) + at for mesh, at in zip(garments.meshes, garments.joined.starts, strict=True)]
    )
    kept, owner = joined.unique(return_inverse=True)
    network = PBNSNetwork(config, len(owner), len(kept), len(garments.heads), len(poses))
    network.rest, network.owner, network.poses = garments.joined.vertices, owner, poses
    network.start_from(weights[kept])
    return network


def pbns_checkpoint(method: PBNS, body: Body, data: TrainingData, notes: dict[str, Any]) -> Checkpoint:
    """The checkpoint: the network, most of it in half precision, and the outfit that it is for."""
    tensors = {
        f"network.{name}": tensor.half() if name.startswith(HALF_PRECISION) else tensor
        for name, tensor in method.network.used().items()
    }
    for index, mesh in enumerate(method.garments.meshes):
        # Faces may serve as face_uvs too, which safetensors refuses to write twice.
        tensors |= {f"mesh.{index}.{field.name}": getattr(mesh, field.name).clone() for field in fields(Mesh)}
    return Checkpoint(
        method="pbns",
        config=asdict(method.config),
        tensors=tensors | {"heads": method.garments.heads, "parents": torch.tensor(method.garments.parents)},
        body=body_record(body),
        garments=method.garments.names,
        data=data,
        notes=notes,
    )


def load_pbns(checkpoint: Checkpoint, folder: Path) -> PBNS:
    """The trained method of a checkpoint. Raises InputError if its parts do not fit each other."""
    garments = _outfit(checkpoint, folder / WEIGHTS)
    tensors = checkpoint.tensors
    try:
        config = stored_config(checkpoint, PBNSConfig)
        state = {k.removeprefix("network."): v for k, v in tensors.items() if k.startswith("network.")}
        sizes = [len(state[name]) for name in ("owner", "strongest", "poses", "shapes")]
        counts = (*sizes[:2], len(garments.heads), *sizes[2:])
        require_weights_of(lambda: PBNSNetwork(config, *counts), state)
        network = PBNSNetwork(config, *counts)
        network.load_state_dict(state)
        _require_fit(network, garments)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise misfit(folder, error) from error
    return PBNS(config, network.eval(), garments)


def _outfit(checkpoint: Checkpoint, path: Path) -> ModelOutfit:
    """The outfit of a checkpoint. Raises InputError if its meshes or its joints are invalid."""
    arrays = {
        name: tensor.numpy() for name, tensor in checkpoint.tensors.items() if not name.startswith("network.")
    }
    meshes = []
    for index in range(len(checkpoint.garments)):
        mesh = {f"mesh.{index}.{name}": field for name, field in MESH_FIELDS.items()}
        fields = check_fields(path, arrays, mesh).values()
        meshes.append(Mesh(*(torch.from_numpy(array) for array in fields)))
    joints = check_fields(path, arrays, {"heads": numbers("J", 3), "parents": indices("J", of="J", least=-1)})
    parents = tuple(joints["parents"].tolist())
    if not in_order(parents) or not meshes:
        raise InputError(f"{path}: has no garments, or a joint before its parent")
    return ModelOutfit(checkpoint.garments, tuple(meshes), torch.from_numpy(joints["heads"]), parents)


def _require_fit(network: PBNSNetwork, garments: ModelOutfit) -> None:
    """Raise ValueError unless a network has the outfit's vertices and joints."""
    if not sum(garments.sizes) == len(network.rest) == len(network.owner):
        raise ValueError(f"{sum(garments.sizes)} vertices, weights for {len(network.owner)}")
    joints = len(garments.heads)
    if network.joints != joints:
        raise ValueError(f"{joints} joints, poses of {network.joints}")
    for values, end in ((network.owner, len(network.strongest)), (network.strongest, joints)):
        if values.numel() and not 0 <= values.min() <= values.max() < end:
            raise ValueError(f"an index is out of range, expected 0 to {end - 1}")


PRESETS: dict[str, PBNSConfig] = {
    "default": PBNSConfig(),
    "paper": PBNSConfig(influences=99),
    "tiny": PBNSConfig(width=16, layers=2),
}

ENTRY = MethodEntry(PBNSConfig(), PBNS.untrained, PRESETS, load_pbns)
