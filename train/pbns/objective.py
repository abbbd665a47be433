"""The objective of PBNS: the potential energy of cloth on a body, over many poses and no simulation."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.bodies.posing import posed_skin
from uvcloth.checkpoint import save_checkpoint
from uvcloth.garments.fit import is_skirt
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.order import check_order
from uvcloth.garments.pins import pinned
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.mesh import Mesh, first_of
from uvcloth.geometry.records import CPU, to_device
from uvcloth.geometry.skinning import apply_transforms, blend_transforms
from uvcloth.methods.pbns.method import PBNS, new_network, pbns_checkpoint, rest_outfit
from uvcloth.methods.pbns.network import PBNSConfig, PBNSNetwork
from uvcloth.methods.rig import pose_vectors
from uvcloth.motion.poses import PoseDatabase
from uvcloth.physics.fabric import Fabric
from uvcloth.physics.layers import wrong_side_percent
from uvcloth.physics.measures import edge_change, fold_angle, fold_cosine
from uvcloth.physics.obstacle import Obstacle
from uvcloth.physics.surface import BodySurface
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS, Surface, contact_sheet, render, three_quarter

from ..loop import Objective
from ..posed_batch import ClosestPointCache, empty_cache
from .energy import EnergyConfig, PBNSEnergy
from .poses import BodyPoses
from .smoothing import GradientSmoothing
from .supervision import SettledPoses, Supervision

SMOOTHING = 0.5
"""Share of the blend shapes' gradient that is smoothed over the garment."""

MILLI = 1000.0
"""Losses are logged in millijoules, lengths in millimetres."""

LOOSE_DISTANCES = (0.02, 0.06)
"""Metres from the skin at rest over which cloth goes from close to free."""

VALIDATION_POSES = 128
"""Poses that validation takes, at most."""

PICTURE_POSES = 3
"""Validation poses in the picture."""

PICTURE_SIZE = (300, 400)
"""Width and height of a pictured pose, pixels."""


@dataclass(frozen=True)
class AttachmentConfig:
    """The initial attachment of a garment to the body: pins and blend weights."""

    pins: tuple[str, ...] = ("band",)
    """Pins: band (the vertices that hold each garment up), waist, neck, none, or a file of vertex numbers."""
    weights: Literal["auto", "closest", "smooth"] = "auto"
    """Blend weights of the closest body vertex (paper), or smoothed over the garment; auto: the smooth ones
    where cloth drapes freely."""
    train_weights: Literal["auto", "yes", "no"] = "auto"
    """Also train the blend weights; auto: only of outfits with a skirt (paper)."""


@dataclass(frozen=True)
class Posed:
    """Poses in memory. vectors: (P, 3 J) as the network sees them. transforms: (P, J, 3, 4)."""

    vectors: Tensor
    transforms: Tensor


class PBNSObjective(Objective):
    """Energies of an outfit on one body over a database of poses (PBNS section 3.3).

    batch: poses in a step. smoothing: share of the blend shapes' gradient that is smoothed, as in
    `GradientSmoothing`. supervision: beside the energies, None for physics alone. Raises InputError for
    layers that cross at rest, pins that name no vertex, a share that is not valid, and a database without
    training or validation poses.
    """

    def __init__(
        self,
        config: PBNSConfig,
        fabric: Fabric,
        energy: EnergyConfig,
        attachment: AttachmentConfig,
        outfit: Outfit,
        poses: BodyPoses,
        batch: int,
        smoothing: float = SMOOTHING,
        device: torch.device = CPU,
        supervision: Supervision | None = None,
    ) -> None:
        self.config, self.fabric, self.attachment, self.outfit = config, fabric, attachment, outfit
        self.data, self.batch, self.device = poses.data, batch, device
        self.garments = rest_outfit(outfit)
        self.poses, self.held = (
            to_device(_posed(poses.database.of(split), outfit), device) for split in ("train", "validation")
        )
        self.weights = torch.cat([_weights(garment, outfit.body, attachment) for garment in outfit.garments])
        self.trains_weights = attachment.train_weights == "yes" or (
            attachment.train_weights == "auto"
            and any(is_skirt(garment.mesh, outfit.body) for garment in outfit.garments)
        )
        held = held_vertices(outfit, attachment)
        network = self._network()
        owner = network.owner
        joined = self.garments.joined
        self.points = joined.vertices[first_of(owner)].to(device)
        self.faces = [
            owner[mesh.faces + start].to(device)
            for mesh, start in zip(self.garments.meshes, joined.starts, strict=True)
        ]
        self.smoothing = GradientSmoothing(self.faces, smoothing, device)
        pins = owner[held].unique()
        self.energy = PBNSEnergy(outfit.body, self.points, self.faces, pins, fabric, energy, batch, device)
        self.caches = empty_cache(len(self.poses.vectors), len(self.points), device)
        self.supervision = None if supervision is None else _of_points(supervision, first_of(owner), device)

    @property
    def samples(self) -> Tensor:
        """The training poses."""
        return torch.arange(len(self.poses.vectors))

    def networks(self) -> dict[str, nn.Module]:
        """The network, with the blend weights to start from."""
        network = self._network()
        network.shapes.register_hook(self.smoothing)
        return {"net": network}

    def _network(self) -> PBNSNetwork:
        """A new network, whose blend weights are trained only if the settings say so."""
        network = new_network(self.config, self.garments, self.weights, self.poses.vectors.cpu())
        network.sharp_weights.requires_grad_(self.trains_weights)
        return network

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        """The potential energy of a batch of poses, mJ each (paper eq. 3, and the pins), and supervision."""
        cache = ClosestPointCache(self.caches.points[rows], self.caches.clearance[rows])
        deformed, posed = self.pose(networks["net"], self.poses, rows)
        parts = self._energies(deformed, posed, self.poses.transforms[rows], cache)
        self.caches.points[rows], self.caches.clearance[rows] = cache.points, cache.clearance
        if self.supervision is not None:
            settled = self.supervision.training
            drawn = torch.randint(len(settled.rows), (len(rows),))
            weight = self.supervision.config.supervision
            parts["settled"] = weight * self._distance(networks["net"], self.poses, settled.some(drawn))
        yield "net", torch.stack(list(parts.values())).sum(), parts

    def pose(self, net: Any, poses: Posed, rows: Tensor) -> tuple[Tensor, Tensor]:
        """The deformation at rest and the posed outfit of some poses, (B, U, 3) m each."""
        deformed, weights = net(poses.vectors[rows])
        blended = blend_transforms(weights, poses.transforms[rows])
        return deformed, apply_transforms(blended, self.points + deformed)

    def _distance(self, net: Any, poses: Posed, settled: SettledPoses) -> Tensor:
        """Mean distance to an outfit at rest, mm: ()."""
        _, posed = self.pose(net, poses, settled.rows)
        return MILLI * (posed - settled.vertices).norm(dim=-1).mean()

    def _energies(
        self, deformed: Tensor, posed: Tensor, transforms: Tensor, cache: ClosestPointCache | None
    ) -> dict[str, Tensor]:
        """Mean energies over a batch, mJ: () each."""
        energies = self.energy(deformed, posed, transforms, cache)
        return {name: MILLI * energy.mean() for name, energy in energies.items()}

    @torch.no_grad()
    def validate(self, net: Any) -> dict[str, float]:
        """Energy and the measures of the paper's Table 1 on poses of clips that are not trained on.

        energy_mJ: of the outfit. edge_mm, bend_rad, bend_cos: see uvcloth.physics.measures. inside_percent:
        of vertices, as the evaluation counts it. layers_percent: of an outer garment's vertices over an inner
        one that are on its wrong side. settled_mm: mean distance to the outfit at rest, where it is known.
        """
        stride = math.ceil(len(self.held.vectors) / VALIDATION_POSES)
        rows = torch.arange(0, len(self.held.vectors), stride, device=self.held.vectors.device)
        energies, posed = [], []
        for some in rows.split(self.batch):
            deformed, vertices = self.pose(net, self.held, some)
            parts = self._energies(deformed, vertices, self.held.transforms[some], None)
            energies.append(len(some) * torch.stack(list(parts.values())).sum())
            posed.append(vertices)
        scores = {
            "energy_mJ": float(torch.stack(energies).sum()) / len(rows),
            **self.measure(torch.cat(posed), self.held.transforms[rows]),
        }
        if self.supervision is not None and len(self.supervision.held.rows):
            scores["settled_mm"] = float(self._distance(net, self.held, self.supervision.held))
        return scores

    def measure(self, posed: Tensor, transforms: Tensor) -> dict[str, float]:
        """The measures of outfits (B, U, 3) m on the body at transforms (B, J, 3, 4), see `validate`."""
        faces = torch.cat(self.faces)
        measures = {
            "edge_mm": MILLI * edge_change(posed, self.points, faces).mean(),
            "bend_rad": fold_angle(posed, faces).mean(),
            "bend_cos": fold_cosine(posed, faces).mean(),
            "inside_percent": self._inside_percent(posed, transforms),
        }
        if self.energy.layers:
            measures["layers_percent"] = self._layers_percent(posed)
        return {name: float(value) for name, value in measures.items()}

    def _inside_percent(self, posed: Tensor, transforms: Tensor) -> Tensor:
        """Percent of the vertices inside the body, over all garments and poses."""
        body = self.outfit.body
        bodies = posed_skin(body, transforms.cpu())
        obstacle = Obstacle(make_collider(body), body.mesh.vertices)
        inside = torch.zeros(len(posed))
        for rows, _ in self._pieces():
            garment = obstacle.contact_garment(self.points[rows].cpu())
            share = obstacle.inside_percent(posed[:, rows].cpu().contiguous(), garment, bodies)
            inside += share * len(rows) / len(self.points)
        return inside.mean()

    def _layers_percent(self, posed: Tensor) -> Tensor:
        """Percent of what covers an inner garment that is on its wrong side, of the worst two garments."""
        pieces = [(posed[:, rows].contiguous(), faces) for rows, faces in self._pieces()]
        crossed = [
            wrong_side_percent(outer, inner, faces)
            for index, (inner, faces) in enumerate(pieces)
            for outer, _ in pieces[index + 1 :]
        ]
        return torch.tensor(max(crossed))

    def _pieces(self) -> list[tuple[Tensor, Tensor]]:
        """Each garment as its rows (n,) among the outfit's vertices, and its faces (F, 3) into them."""
        return [faces.unique(return_inverse=True) for faces in self.faces]

    @torch.no_grad()
    def picture(self, net: Any) -> Tensor:
        """A few validation poses, rendered: (H, W, 3) uint8."""
        body = self.outfit.body
        rows = (
            torch.linspace(0, len(self.held.vectors) - 1, PICTURE_POSES).long().to(self.held.vectors.device)
        )
        _, posed = self.pose(net, self.held, rows)
        bodies = posed_skin(body, self.held.transforms[rows].cpu())
        pictures = []
        for vertices, skin_vertices in zip(posed.cpu(), bodies, strict=True):
            surfaces = [Surface(skin_vertices, body.mesh.faces, BODY_COLOR)]
            for index, faces in enumerate(self.faces):
                color = GARMENT_COLORS[index % len(GARMENT_COLORS)]
                surfaces.append(Surface(vertices, faces.cpu(), color))
            camera = three_quarter(skin_vertices, aspect=PICTURE_SIZE[0] / PICTURE_SIZE[1])
            floor = float(skin_vertices[:, 2].min())
            pictures.append(render(surfaces, camera, PICTURE_SIZE, floor))
        return torch.from_numpy(contact_sheet(pictures, columns=PICTURE_POSES))

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        """Write the checkpoint of the network."""
        method = PBNS(self.config, net, self.garments)
        save_checkpoint(pbns_checkpoint(method, self.outfit.body, self.data, notes | self._made_of()), run)

    def settings(self) -> dict[str, Any]:
        """Settings that must not change within a run."""
        garments = {
            name: _digest(mesh) for name, mesh in zip(self.garments.names, self.garments.meshes, strict=True)
        }
        body = {self.outfit.body.name: self.outfit.body.identity.shape}
        return {
            "method": asdict(self.config),
            **self._made_of(),
            "body": body,
            "garments": garments,
            "data": asdict(self.data),
        }

    def _made_of(self) -> dict[str, Any]:
        """Settings of the energy and of how it is minimized."""
        return {
            "fabric": asdict(self.fabric),
            "energy": asdict(self.energy.config),
            "attachment": asdict(self.attachment),
            "smoothing": self.smoothing.share,
            "supervision": None if self.supervision is None else asdict(self.supervision.config),
        }


def _of_points(supervision: Supervision, points: Tensor, device: torch.device) -> Supervision:
    """Supervision of some of the vertices (U,) of an outfit, on a device."""
    training, held = (
        to_device(replace(settled, vertices=settled.vertices[:, points]), device)
        for settled in (supervision.training, supervision.held)
    )
    return replace(supervision, training=training, held=held)


def held_vertices(outfit: Outfit, attachment: AttachmentConfig) -> Tensor:
    """The pinned vertices of all garments: (N,) bool. Raises InputError as `check_order` and `pinned` do."""
    check_order(outfit.garments)
    return pinned(outfit.garments, outfit.body, attachment.pins)


def _posed(poses: PoseDatabase, outfit: Outfit) -> Posed:
    """The poses of a database for the body of an outfit."""
    skeleton = outfit.body.skeleton
    transforms = poses.transforms(skeleton)
    return Posed(pose_vectors(skeleton.parents, transforms), transforms)


def _weights(garment: Garment, body: Body, attachment: AttachmentConfig) -> Tensor:
    """The blend weights (N, J) that a garment starts from."""
    if attachment.weights == "closest":
        return garment.weights
    if attachment.weights == "smooth":
        return garment.smooth_weights
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    distance = surface.closest(garment.mesh.vertices, LOOSE_DISTANCES[1]).signed_distance
    loose = ((distance - LOOSE_DISTANCES[0]) / (LOOSE_DISTANCES[1] - LOOSE_DISTANCES[0])).clamp(0.0, 1.0)
    return torch.lerp(garment.weights, garment.smooth_weights, loose[:, None])


def _digest(mesh: Mesh) -> str:
    """SHA-256 of where a mesh is at rest and of its faces, in hexadecimal."""
    return fingerprint(mesh.vertices, mesh.faces)
