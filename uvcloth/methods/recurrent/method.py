"""Recurrent rigs: blend shapes of a garment whose weights a small recurrent network plays, without a solver.

A garment is posed by linear blend skinning with smooth weights of its rest shape plus a sum of blend shapes.
A gated recurrent unit gives the weights from the body's motion in the root's axes; its hidden state, a few
hundred numbers, is all that is remembered. It is trained on runs of the solver on a cage (`train.recurrent`),
whose offsets from the skinned cage span the shapes. No paper: the parts are those of SNUG (Santesteban et
al., 2022) and Neural Cloth Simulation (Bertiche et al., 2022), which train them on energies instead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from rasterize.gather import gather
from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.checkpoint import (
    Checkpoint,
    TrainingData,
    body_record,
    misfit,
    require_weights_of,
    stored_config,
)
from uvcloth.errors import InputError
from uvcloth.files.eight_bits import from_eight_bits, in_eight_bits
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.records import CPU
from uvcloth.geometry.skinning import skin_each
from uvcloth.methods.capabilities import Riggable, Swinging
from uvcloth.methods.method import Method, MethodEntry, Traits, for_inference, require_supported
from uvcloth.methods.recurrent.body_motion import OF_ROOT, PER_JOINT, body_motion
from uvcloth.methods.recurrent.condition import condition
from uvcloth.methods.recurrent.network import (
    TICK,
    RecurrentConfig,
    RecurrentNetwork,
    RecurrentNetworks,
)
from uvcloth.methods.recurrent.rig import RecurrentRig
from uvcloth.methods.recurrent.scaled import ScaledNetwork


@dataclass(frozen=True)
class RecurrentGarment:
    """A garment that is ready to be stepped.

    network: of the garment, on its body. rest: (3, N) m, its mesh at rest plus the mean. shapes: (K, 3 N) m.
    weights: (N, J) blend weights. heads: (J, 3) m of the skeleton.
    """

    network: ScaledNetwork
    rest: Tensor
    shapes: Tensor
    weights: Tensor
    heads: Tensor

    def motion(self, frames: BodyFrames) -> Tensor:
        """Motion (B, C) of bodies, as the network sees it."""
        return body_motion(frames.transforms, self.heads, frames.fps)

    def posed(self, weights: Tensor, transforms: Tensor) -> Tensor:
        """Garment (B, N, 3) m of weights (B, K) of its shapes, on joints (B, J, 3, 4)."""
        points = torch.addmm(self.rest.flatten(), weights, self.shapes)
        return skin_each(points.view(len(weights), 3, -1), self.weights, transforms)


@dataclass(frozen=True)
class Recurrent(Method, Riggable, Swinging):
    """A recurrent network for each of some templates, on any body of the skeleton that it was trained on.

    dynamics: factor of what is due to motion, see ScaledNetwork.
    """

    config: RecurrentConfig
    networks: RecurrentNetworks
    name: str = "recurrent"
    dynamics: float = 1.0

    @property
    def traits(self) -> Traits:
        """Reading the fabric if it was trained on several."""
        return Traits(autoregressive=True, reads_fabric=self.networks.read_fabrics)

    @classmethod
    def untrained(cls, config: RecurrentConfig) -> "Recurrent":
        """The method without a garment; training gives it some."""
        return cls(config, RecurrentNetworks())

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason that it cannot dress an outfit: it is for the meshes of its templates."""
        for garment in outfit.garments:
            known = garment.source == "template" and garment.name in self.networks
            if not known or len(garment.mesh.vertices) != len(self.networks.of(garment.name).corners):
                names = ", ".join(self.networks) or "no garment yet"
                return f"garment {garment.name}: model {self.name} is for the templates {names}"
        return ""

    def prepare(self, outfit: Outfit, device: torch.device) -> tuple[RecurrentGarment, ...]:
        """Carry the shapes to the garments. Raises InputError for an unsupported outfit."""
        require_supported(self, outfit)
        return tuple(self._prepared(garment, outfit.body, device) for garment in outfit.garments)

    @torch.no_grad()
    def init(self, prepared: tuple[RecurrentGarment, ...], frames: BodyFrames) -> tuple[Tensor, ...]:
        """Memories (B, M) of garments on bodies that have stood still as in the frames."""
        return tuple(each.network.at_rest(each.motion(frames)) for each in prepared)

    @torch.no_grad()
    def step(
        self, prepared: tuple[RecurrentGarment, ...], state: tuple[Tensor, ...], frames: BodyFrames
    ) -> tuple[tuple[Tensor, ...], tuple[Tensor, ...]]:
        """Memories (B, M) and garments (B, N, 3) m of the next frame of B rollouts."""
        following, garments = [], []
        for each, before in zip(prepared, state, strict=True):
            weights, hidden = each.network.step(each.motion(frames), before, 1.0 / (frames.fps * TICK))
            following.append(hidden)
            garments.append(each.posed(weights, frames.transforms[:, -1]))
        return tuple(following), tuple(garments)

    def with_dynamics(self, factor: float) -> "Recurrent":
        """The method with another factor."""
        return replace(self, dynamics=factor)

    @torch.no_grad()
    def as_rig(self, body: Body, garments: tuple[Garment, ...] = ()) -> RecurrentRig:
        """The rig of garments on a body. Raises InputError for none, and for others than its templates."""
        if not garments:
            raise InputError(f"model {self.name}: name --garment, some of {', '.join(self.networks)}")
        require_supported(self, Outfit(body, garments))
        made = [self._prepared(garment, body, CPU) for garment in garments]
        meshes = [
            replace(garment.mesh, vertices=each.rest.T) for garment, each in zip(garments, made, strict=True)
        ]
        return RecurrentRig(
            name=self.name,
            garments=tuple((garment.name, mesh) for garment, mesh in zip(garments, meshes, strict=True)),
            owner=torch.arange(sum(len(mesh.vertices) for mesh in meshes)),
            weights=torch.cat([each.weights for each in made]),
            shapes=_apart([each.shapes.unflatten(1, (3, -1)).mT for each in made]),
            networks=tuple(each.network for each in made),
            heads=body.skeleton.heads,
        )

    def _prepared(self, garment: Garment, body: Body, device: torch.device) -> RecurrentGarment:
        told = self.networks.of(garment.name).conditioned(condition(body, garment.fabric))
        network: RecurrentNetwork = for_inference(told, device)
        mean, shapes = (
            gather(values, network.corners, network.shares).mT for values in (network.mean, network.shapes)
        )
        return RecurrentGarment(
            network=ScaledNetwork(network, self.dynamics),
            rest=garment.mesh.vertices.to(device).T + mean,
            shapes=shapes.flatten(1),
            weights=garment.smooth_weights.to(device),
            heads=body.skeleton.heads.to(device),
        )


def _apart(shapes: Sequence[Tensor]) -> Tensor:
    """Shapes (K, N, 3) of each of some garments as those of all their vertices."""
    counts = [shape.shape[1] for shape in shapes]
    rows = [
        torch.nn.functional.pad(each, (0, 0, sum(counts[:place]), sum(counts[place + 1 :])))
        for place, each in enumerate(shapes)
    ]
    return torch.cat(rows)


def recurrent_checkpoint(
    method: Recurrent, body: Body, data: TrainingData, notes: dict[str, Any]
) -> Checkpoint:
    """The checkpoint: matrices and shapes in eight bits, the rest in half precision."""
    tensors = {
        name: tensor.half() if tensor.is_floating_point() and not _is_large(name) else tensor
        for name, tensor in method.networks.state_dict().items()
    }
    return Checkpoint(
        method="recurrent",
        config=asdict(method.config),
        tensors=in_eight_bits(tensors, _is_large),
        body=body_record(body),
        garments=tuple(method.networks),
        data=data,
        notes=notes,
    )


def _is_large(name: str) -> bool:
    """True for the names of matrices and shapes."""
    return ".weight" in name or name.endswith(".shapes")


def load_recurrent(checkpoint: Checkpoint, folder: Path) -> Recurrent:
    """The trained method of a checkpoint. Raises InputError if its parts do not fit each other."""
    try:
        config = stored_config(checkpoint, RecurrentConfig)
        tensors = from_eight_bits(checkpoint.tensors)
        sizes = {name: _sizes(tensors, name) for name in checkpoint.garments}

        def create() -> RecurrentNetworks:
            return RecurrentNetworks({name: RecurrentNetwork(config, *each) for name, each in sizes.items()})

        require_weights_of(create, tensors)
        networks = create()
        networks.load_state_dict(tensors)
        for name in networks:
            networks.of(name).require_corners()
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise misfit(folder, error) from error
    return Recurrent(config, networks.eval())


def _sizes(tensors: Mapping[str, Tensor], name: str) -> tuple[int, int, int, int]:
    """Joints, vertices of the cage and of a garment, and corners of each, of the tensors of a checkpoint."""
    joints = (len(tensors[f"{name}.center"]) - OF_ROOT) // PER_JOINT
    vertices, around = tensors[f"{name}.corners"].shape
    return joints, len(tensors[f"{name}.mean"]), vertices, around


PRESETS: dict[str, RecurrentConfig] = {
    "default": RecurrentConfig(),
    "gpu": RecurrentConfig(),
    "tiny": RecurrentConfig(shapes=4, width=8),
}

ENTRY = MethodEntry(RecurrentConfig(), Recurrent.untrained, PRESETS, load_recurrent)
