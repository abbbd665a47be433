"""PBNS: blend weights and blend shapes that follow the pose, which physics teaches without data.

A garment or outfit is posed by linear blend skinning of its rest shape plus a deformation, and the
deformation is a sum of blend shapes weighed by a perceptron that sees the pose (Bertiche et al. 2021, eq. 1
and 2). Every engine can play that. It is quasi-static: the same pose always looks the same, however fast the
body came there.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.checkpoint import Checkpoint, TrainingData, body_identity, misfit, stored_config
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import Mesh, weld
from uvcloth.geometry.skeleton import local_rotations
from uvcloth.geometry.skinning import apply_transforms, blend_transforms

SAME_SHAPE = 0.002
"""Metres between joints or rest vertices that still count as the same body and garment."""

SHARPNESS = 100.0
"""Of blend weights while they are trained: a step of 0.01 moves about a hundredth of the weight."""

LEAST_WEIGHT = 0.01
"""Of SHARPNESS: what a joint without weight starts from, so that it can gain some."""

HALVED = ("layers.", "shapes", "poses")
"""What of the network is saved in half precision: it is most of a file, and blend shapes lose micrometres."""

FIRST_SHAPE = 1e-3
"""Standard deviation of the blend shapes before training, metres."""


@dataclass(frozen=True)
class PBNSConfig:
    """What the network is made of."""

    width: int = 256
    """Width of the pose embedding's layers, and number of blend shapes."""
    layers: int = 4
    """Layers of the pose embedding."""
    influences: int = 4
    """Joints that may move a vertex, the strongest (paper: all): four are what every engine plays."""

    def __post_init__(self) -> None:
        """Raises InputError for sizes that are none."""
        for name in ("width", "layers", "influences"):
            if getattr(self, name) < 1:
                raise InputError(f"--{name} {getattr(self, name)}: has to be 1 or more")

    def create(self) -> "PBNS":
        """The method without a garment; training gives it one."""
        return PBNS(self, PBNSNetwork(self, 0, 0, 1, 0), RestOutfit((), (), torch.zeros(1, 3), (-1,)))


@dataclass(frozen=True)
class RestOutfit:
    """What a model dresses: garments at rest on one body, the innermost first, as one list of N vertices.

    names: of the garments. meshes: of each. heads: (J, 3) the body's joints at rest, m. parents: (J,).
    """

    names: tuple[str, ...]
    meshes: tuple[Mesh, ...]
    heads: Tensor
    parents: tuple[int, ...]

    @property
    def vertices(self) -> Tensor:
        """All vertices at rest (N, 3), m."""
        return torch.cat([mesh.vertices for mesh in self.meshes])

    @property
    def sizes(self) -> list[int]:
        """Vertices of each garment."""
        return [len(mesh.vertices) for mesh in self.meshes]

    @property
    def starts(self) -> list[int]:
        """The first vertex of each garment."""
        return list(accumulate(self.sizes[:-1], initial=0))


class PBNSNetwork(nn.Module):
    """Pose embedding, blend shapes and blend weights for N vertices on J joints.

    Vertices at one place at rest (texture seams) are one to the network: owner (N,) int64 says which of U.
    rest: (N, 3) m. poses: (M, 3 J) the training poses as vectors, which give the embedding its range.
    """

    rest: Tensor
    owner: Tensor
    strongest: Tensor
    poses: Tensor

    def __init__(self, config: PBNSConfig, vertices: int, unique: int, joints: int, poses: int) -> None:
        super().__init__()
        widths = [3 * joints, *[config.width] * config.layers]
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        self.shapes = nn.Parameter(FIRST_SHAPE * torch.randn(config.width, 3 * unique))
        influences = min(config.influences, joints)
        self.sharp_weights = nn.Parameter(torch.zeros(unique, influences))
        self.register_buffer("strongest", torch.zeros(unique, influences, dtype=torch.int64))
        self.register_buffer("rest", torch.zeros(vertices, 3))
        self.register_buffer("owner", torch.zeros(vertices, dtype=torch.int64))
        self.register_buffer("poses", torch.zeros(poses, 3 * joints))

    @property
    def joints(self) -> int:
        """Of the skeleton, J."""
        return self.poses.shape[1] // 3

    def start_from(self, weights: Tensor) -> None:
        """Take over the strongest of blend weights (U, J)."""
        shares, self.strongest = weights.topk(self.sharp_weights.shape[1], dim=1)
        positive = SHARPNESS * shares / shares.sum(1, keepdim=True)
        sharp = torch.where(positive > 1.0, positive - 1.0, positive.clamp(min=LEAST_WEIGHT).log())
        with torch.no_grad():
            self.sharp_weights.copy_(sharp / SHARPNESS)

    def forward(self, poses: Tensor) -> tuple[Tensor, Tensor]:
        """Deformation (B, U, 3) m of some poses (B, 3 J), and the blend weights (U, J) that pose it."""
        with torch.autocast(poses.device.type, enabled=False):
            return self.deform(poses), self.unique_weights()

    def embed(self, poses: Tensor) -> Tensor:
        """High-level pose embedding f_X (paper eq. 2): pose vectors (B, 3 J) -> (B, width), none negative."""
        for layer in self.layers:
            poses = torch.relu(layer(poses))
        return poses

    def deform(self, poses: Tensor) -> Tensor:
        """Deformation dT of the rest shape, f_X(theta) D (paper eq. 2): (B, 3 J) -> (B, U, 3), m."""
        return (self.embed(poses) @ self.shapes).view(len(poses), -1, 3)

    def blend_shapes(self) -> Tensor:
        """The PSD matrix D: (width, N, 3), m."""
        return self.shapes.view(len(self.shapes), -1, 3)[:, self.owner]

    def blend_weights(self) -> Tensor:
        """(N, J), rows sum to one; no row has more than the config's influences."""
        return self.unique_weights()[self.owner]

    def unique_weights(self) -> Tensor:
        """Blend weights of the U vertices: (U, J). What is trained is made positive by ELU and normalized."""
        positive = nn.functional.elu(SHARPNESS * self.sharp_weights) + 1.0
        shares = positive / positive.sum(1, keepdim=True)
        return shares.new_zeros(len(shares), self.joints).scatter_add(1, self.strongest, shares)


@dataclass(frozen=True)
class PBNSState:
    """What a rollout wears of a model's outfit.

    rows: (n,) of the outfit's vertices. sizes: vertices of each garment. weights: (n, J) blend weights.
    """

    rows: Tensor
    sizes: list[int]
    weights: Tensor


@dataclass(frozen=True)
class PBNS:
    """A Method without memory: it dresses the outfit that it was trained for, or some of it, on that body."""

    config: PBNSConfig
    network: PBNSNetwork
    worn: RestOutfit
    name: str = "pbns"
    autoregressive: bool = False
    quasi_static: bool = True

    def unsupported_reason(self, outfit: Outfit) -> str:
        """It dresses garments that it was trained for, in their order, on that very body."""
        names = tuple(garment.name for garment in outfit.garments)
        own = " over ".join(reversed(self.worn.names)) or "no garment yet"
        who = f"model {self.name} is for {own}"
        if names != tuple(name for name in self.worn.names if name in names):
            return f"{who}, not for {' over '.join(reversed(names))}"
        if fault := self.body_fault(outfit.body):
            return fault
        meshes = dict(zip(self.worn.names, self.worn.meshes, strict=True))
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
        """Why the model does not fit a body: blend shapes are for one body's shape; "" where it fits."""
        heads, own = body.skeleton.heads, self.worn.heads
        if heads.shape == own.shape and float((heads - own).norm(dim=1).max()) < SAME_SHAPE:
            return ""
        return f"model {self.name} was trained on another body than {body.name!r}, in skeleton or shape"

    def start(self, outfit: Outfit, frames: BodyFrames) -> PBNSState:
        """Take the outfit. Raises InputError for one that it has an unsupported_reason to."""
        if unsupported_reason := self.unsupported_reason(outfit):
            raise InputError(unsupported_reason)
        rows = torch.arange(len(self.network.rest)).split(self.worn.sizes)
        own = dict(zip(self.worn.names, rows, strict=True))
        worn = [own[garment.name] for garment in outfit.garments]
        with torch.no_grad():
            weights = self.network.blend_weights()
        return PBNSState(torch.cat(worn), [len(each) for each in worn], weights[torch.cat(worn)])

    @torch.no_grad()
    def step(self, state: PBNSState, frames: BodyFrames) -> tuple[PBNSState, tuple[Tensor, ...]]:
        """Garment vertices (B, N, 3) of each garment, m (paper eq. 1)."""
        network, transforms = self.network, frames.transforms[:, -1]
        deformed = network.deform(pose_vectors(self.worn.parents, transforms))[:, network.owner[state.rows]]
        posed = apply_transforms(
            blend_transforms(state.weights, transforms), network.rest[state.rows] + deformed
        )
        return state, posed.split(state.sizes, dim=1)

    def observe(self, state: PBNSState, garments: tuple[Tensor, ...]) -> PBNSState:
        """It remembers nothing."""
        return state


def pose_vectors(parents: Sequence[int], transforms: Tensor) -> Tensor:
    """The pose theta as the network sees it: joint transforms (B, J, 3, 4) -> (B, 3 J).

    Three numbers per joint: the axis-angle of its rotation relative to its parent, radians, and in place of
    the root's, which would tell north from south, the direction of gravity in the root's axes.
    """
    from kornia.geometry.conversions import rotation_matrix_to_axis_angle

    turns = transforms[..., :3]
    local = local_rotations(parents, turns)
    vectors = rotation_matrix_to_axis_angle(local.reshape(-1, 3, 3)).view(*turns.shape[:2], 3)
    down = turns.new_tensor([0.0, 0.0, -1.0])
    root = torch.tensor([parent < 0 for parent in parents], device=turns.device)
    return torch.where(root[:, None], turns.mT @ down, vectors).flatten(1)


def rest_outfit(outfit: Outfit) -> RestOutfit:
    """An outfit as a model keeps it."""
    skeleton = outfit.body.skeleton
    names = tuple(garment.name for garment in outfit.garments)
    meshes = tuple(garment.mesh for garment in outfit.garments)
    return RestOutfit(names, meshes, skeleton.heads, skeleton.parents)


def new_network(config: PBNSConfig, worn: RestOutfit, weights: Tensor, poses: Tensor) -> PBNSNetwork:
    """An untrained network for an outfit. weights: (N, J) to start from. poses: (M, 3 J) of training."""
    joined = torch.cat([weld(mesh.vertices) + at for mesh, at in zip(worn.meshes, worn.starts, strict=True)])
    kept, owner = joined.unique(return_inverse=True)
    network = PBNSNetwork(config, len(owner), len(kept), len(worn.heads), len(poses))
    network.rest, network.owner, network.poses = worn.vertices, owner, poses
    network.start_from(weights[kept])
    return network


def pbns_checkpoint(method: PBNS, body: Body, data: TrainingData, notes: dict[str, Any]) -> Checkpoint:
    """What training saves: the network, most of it in half precision, and the outfit that it is for."""
    tensors = {
        f"network.{name}": tensor.half() if name.startswith(HALVED) else tensor
        for name, tensor in method.network.state_dict().items()
    }
    for index, mesh in enumerate(method.worn.meshes):
        # Faces may serve as face_uvs too, which safetensors refuses to write twice.
        tensors |= {f"mesh.{index}.{field.name}": getattr(mesh, field.name).clone() for field in fields(Mesh)}
    return Checkpoint(
        method="pbns",
        config=asdict(method.config),
        tensors=tensors | {"heads": method.worn.heads, "parents": torch.tensor(method.worn.parents)},
        body=body_identity(body),
        templates=method.worn.names,
        data=data,
        notes=notes,
    )


def load_pbns(checkpoint: Checkpoint, folder: Path) -> PBNS:
    """The trained method of a checkpoint. Raises InputError if its parts do not fit each other."""
    tensors = checkpoint.tensors
    try:
        config = stored_config(checkpoint, PBNSConfig)
        meshes = tuple(
            Mesh(**{field.name: tensors[f"mesh.{index}.{field.name}"] for field in fields(Mesh)})
            for index in range(len(checkpoint.templates))
        )
        worn = RestOutfit(checkpoint.templates, meshes, tensors["heads"], tuple(tensors["parents"].tolist()))
        state = {k.removeprefix("network."): v for k, v in tensors.items() if k.startswith("network.")}
        counts = (len(state["owner"]), len(state["strongest"]), len(worn.heads), len(state["poses"]))
        network = PBNSNetwork(config, *counts)
        network.load_state_dict(state)
        _require_fit(network, worn)
    except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as error:
        raise misfit(folder, error) from error
    return PBNS(config, network.eval(), worn)


def _require_fit(network: PBNSNetwork, worn: RestOutfit) -> None:
    """Raise ValueError, IndexError or RuntimeError unless a network has the outfit's vertices and joints."""
    if not sum(worn.sizes) == len(network.rest) == len(network.owner):
        raise ValueError(f"{sum(worn.sizes)} vertices, weights for {len(network.owner)}")
    joints = len(worn.heads)
    if not (len(worn.parents) == network.joints == joints and max(worn.parents) < joints):
        raise ValueError(f"{joints} joints, {len(worn.parents)} parents, poses of {network.joints}")
    network.blend_weights()
