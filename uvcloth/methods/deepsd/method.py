"""DeePSD: a rig of blend weights and blend shapes for any outfit, written by a network that reads its mesh.

The network reads an outfit once; then it is posed by linear blend skinning of its rest shape plus blend
shapes weighed by a perceptron that sees the pose (Bertiche et al. 2021, eq. 1 and 2). It is quasi-static: the
same pose always looks the same, however fast the body came there.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

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
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.skinning import skin_each
from uvcloth.methods.capabilities import Capability, FinishAware, Riggable
from uvcloth.methods.deepsd.config import PRESETS, DeePSDConfig
from uvcloth.methods.deepsd.network import Branch, DeePSDNetwork
from uvcloth.methods.deepsd.outfit_graph import PackedOutfits, outfit_graph, pack
from uvcloth.methods.method import Method, MethodEntry, Traits, for_inference, require_supported
from uvcloth.methods.rig import PoseRig, pose_vectors

BRANCHES: tuple[Branch, ...] = ("data", "physics")
"""What is added up in use (paper: D_PSD = D_data + D_phys)."""

DEFAULT_JOINTS = 31
"""Of the skeleton of the bodies that `uvcloth body` makes."""


@dataclass(frozen=True)
class DeePSDPrepared:
    """The rig of an outfit of N vertices on a device; those at one place are one of U points.

    owner: (N,). points: (U, 3) m. weights: (U, J). visibility: (J,), how much each joint influences the keys.
    shapes: (K, 3, U) m, None where no blend shapes are predicted; then described: (U, F) is what offsets are
    predicted from. parents: of the joints. sizes: vertices of each garment.
    """

    network: DeePSDNetwork
    owner: Tensor
    points: Tensor
    weights: Tensor
    visibility: Tensor
    shapes: Tensor | None
    described: Tensor
    parents: tuple[int, ...]
    sizes: tuple[int, ...]


@dataclass(frozen=True)
class DeePSD(Method, FinishAware, Riggable):
    """A quasi-static method for any outfit on any body of the skeleton that it was trained on.

    branches: the blend shapes that are added up. poses: (M, 3 J) some of the pose vectors of its training.
    """

    config: DeePSDConfig
    network: DeePSDNetwork
    poses: Tensor
    branches: tuple[Branch, ...] = BRANCHES
    name: str = "deepsd"

    @classmethod
    def untrained(cls, config: DeePSDConfig) -> "DeePSD":
        """The method before training, for the bodies that `uvcloth body` makes."""
        return cls(config, DeePSDNetwork(config, DEFAULT_JOINTS), torch.zeros(0, 3 * DEFAULT_JOINTS))

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason that it cannot dress an outfit: a body of another skeleton."""
        joints = len(outfit.body.skeleton.names)
        if joints == self.network.joints:
            return ""
        return (
            f"model {self.name} is for a skeleton of {self.network.joints} joints, "
            f"body {outfit.body.name!r} has {joints}"
        )

    @property
    def traits(self) -> Traits:
        """Reading the fabric if it was trained on garments of several."""
        return Traits(quasi_static=True, reads_fabric=self.config.reads_fabric)

    def capability(self, kind: type[Capability]) -> Capability | None:
        """As any method, but no rig if it deforms by offsets, to which no engine gives weights."""
        if kind is Riggable and self.config.deformation == "offsets":
            return None
        return super().capability(kind)

    def before_finish(self) -> "DeePSD":
        """The method without its branch of physics.

        That branch moves cloth outwards in many poses to keep it out of the body in all, which costs
        accuracy; a finish moves what is inside in the pose at hand.
        """
        kept = tuple(branch for branch in self.branches if branch != "physics")
        return replace(self, branches=kept) if kept and kept != self.branches else self

    @torch.no_grad()
    def prepare(self, outfit: Outfit, device: torch.device) -> DeePSDPrepared:
        """Make the rig of an outfit. Raises InputError for a body of another skeleton."""
        require_supported(self, outfit)
        graph = outfit_graph(outfit)
        network = for_inference(self.network, device)
        packed = pack([graph], device, self.config.spread)
        described = network.describe(packed)
        return DeePSDPrepared(
            network=network,
            owner=graph.owner.to(device),
            points=packed.points,
            weights=network.blend_weights(described, packed),
            visibility=network.joint_visibility(packed.joint_areas[0]),
            shapes=self._shapes(network, described, packed),
            described=described,
            parents=tuple(outfit.body.skeleton.parents),
            sizes=tuple(len(garment.mesh.vertices) for garment in outfit.garments),
        )

    def _shapes(self, network: DeePSDNetwork, described: Tensor, packed: PackedOutfits) -> Tensor | None:
        """Blend shapes (K, 3, U) m of all branches together; None where the config predicts none."""
        if self.config.deformation != "blend_shapes":
            return None
        shapes = torch.stack([network.shapes(described, packed, branch) for branch in self.branches]).sum(0)
        return shapes.permute(1, 2, 0).contiguous()

    @torch.no_grad()
    def step(
        self, prepared: DeePSDPrepared, state: tuple[()], frames: BodyFrames
    ) -> tuple[tuple[()], tuple[Tensor, ...]]:
        """Garment vertices (B, N, 3) of each garment, m (paper eq. 1)."""
        transforms = frames.transforms[:, -1]
        keys = prepared.network.embed(pose_vectors(prepared.parents, transforms), prepared.visibility)
        deformed = prepared.points.T + self._deformation(prepared, keys)
        posed = skin_each(deformed, prepared.weights, transforms)
        return state, posed[:, prepared.owner].split(list(prepared.sizes), dim=1)

    def _deformation(self, prepared: DeePSDPrepared, keys: Tensor) -> Tensor:
        """Deformation (B, 3, U) m of the outfit at rest."""
        if prepared.shapes is not None:
            return (keys @ prepared.shapes.flatten(1)).view(len(keys), 3, -1)
        offsets = keys.new_zeros(len(keys), len(prepared.points), 3)
        if self.config.deformation == "offsets":
            for branch in self.branches:
                offsets = offsets + prepared.network.offsets(prepared.described, keys, branch)
        return offsets.mT

    @torch.no_grad()
    def as_rig(self, body: Body, garments: tuple[Garment, ...] = ()) -> PoseRig:
        """The rig of an outfit. Raises InputError for a body of another skeleton, and without garments."""
        if not garments:
            raise InputError(f"model {self.name} rigs any outfit, so it needs one: name it with --garment")
        prepared = self.prepare(Outfit(body, garments), torch.device("cpu"))
        shapes = prepared.shapes if prepared.shapes is not None else torch.zeros(0, 3, len(prepared.points))
        return PoseRig(
            name=self.name,
            garments=tuple((garment.name, garment.mesh) for garment in garments),
            owner=prepared.owner,
            weights=prepared.weights,
            shapes=shapes.mT,
            layers=self.network.embedding_layers(prepared.visibility),
            parents=prepared.parents,
            poses=self.poses,
            sum_to_one=self.config.keys > 0,
        )


def deepsd_checkpoint(method: DeePSD, body: Body, data: TrainingData, notes: dict[str, Any]) -> Checkpoint:
    """The checkpoint of a method that was trained on bodies with the mesh and skeleton of one."""
    tensors = {f"network.{name}": tensor for name, tensor in method.network.state_dict().items()}
    return Checkpoint(
        method="deepsd",
        config=asdict(method.config),
        tensors=tensors | {"poses": method.poses.half()},
        body=body_record(body),
        garments=(),
        data=data,
        notes=notes | {"branches": method.branches},
    )


def load_deepsd(checkpoint: Checkpoint, folder: Path) -> DeePSD:
    """The trained method of a checkpoint. Raises InputError if its parts do not fit each other."""
    try:
        config = stored_config(checkpoint, DeePSDConfig)
        poses = checkpoint.tensors["poses"].float()
        if poses.ndim != 2 or poses.shape[1] % 3:
            raise ValueError(f"poses of the shape {tuple(poses.shape)}, expected (M, 3 J)")
        joints = poses.shape[1] // 3
        state = {
            name.removeprefix("network."): tensor
            for name, tensor in checkpoint.tensors.items()
            if name != "poses"
        }
        require_weights_of(lambda: DeePSDNetwork(config, joints), state)
        network = DeePSDNetwork(config, joints)
        network.load_state_dict(state)
        branches = tuple(branch for branch in BRANCHES if branch in checkpoint.notes["branches"])
    except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as error:
        raise misfit(folder, error) from error
    return DeePSD(config, network.eval(), poses, branches)


ENTRY = MethodEntry(DeePSDConfig(), DeePSD.untrained, PRESETS, load_deepsd)
