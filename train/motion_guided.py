"""The objectives of Motion-guided: first a space of shapes, then the encoder that moves through it."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from rich.console import Console
from rich.progress import track
from torch import Tensor, nn

from rasterize.bake import bake, scatter_map
from rasterize.errors import InputError
from train.loop import LoopConfig
from train.operators import Operator, differences, sampling
from train.prepare import check_rests
from train.recordings import Holdout, Recording, frames_of, hold_out, load_recordings
from uvcloth.bodies.body import Body, load_body
from uvcloth.checkpoint import load_checkpoint, save_checkpoint
from uvcloth.garments.templates import wear
from uvcloth.mesh import edge_lengths, laplacian, unique_edges
from uvcloth.methods.correspondence import rotate, rotate_back, to_device
from uvcloth.methods.latent import REACH, LinearSpace, Space
from uvcloth.methods.motion_guided import (
    MEMORY,
    GarmentMaps,
    MotionGuidedConfig,
    Situation,
    carried_offsets,
    garment_maps,
    motion_guided_checkpoint,
    motion_values,
    next_shape,
    posed_shape,
    rest_shape,
    shape_features,
    situation_features,
)
from uvcloth.methods.seeds import PosedSeeds, kernel_transforms, pose_seeds
from uvcloth.physics.surface import BodySurface

ROUNDS = 4
"""Iterations that take a garment back to the rest space."""

RIDGE = 1e-3
"""Of the linear encoder, as a share of the mean square of what it sees."""

CLEARANCE = 0.002
"""Metres that the rest shape should keep off the body at rest (epsilon of L_SDF)."""

CHUNK = 16
"""Frames that are carried at once."""

ROLLED = 150
"""Frames of a validation clip that are rolled out, at most."""


@dataclass(frozen=True)
class MotionGuidedLosses(Holdout):
    """Weights of the losses of both stages (sections 4.2 and 5), and how they are trained."""

    laplacian: float = 1.0
    """Error of the mesh Laplacian, beside that of the vertices."""
    random: float = 0.1
    """Edge lengths of shapes decoded from random codes."""
    inside: float = 100.0
    """Depth of rest shapes, seen and random, in the body at rest."""
    settled: float = 0.02
    """Metres of error below which these two set in, to their full weight at none."""
    regular: float = 0.001
    """Distance of the mean square of codes from 1."""
    code: float = 0.01
    """Error of the predicted codes (paper: 1, with errors of vertices summed)."""
    steady: float = 1.0
    """Error of the change since the frame before, beside that of the vertices: less jitter (paper: 0)."""
    still: bool = True
    """Train on the virtual sample too whose garment does not change: E_t = 0."""
    past: Literal["own", "true"] = "own"
    """Histories in training: the network's latest predictions, or the simulation's (paper)."""


SHAPE = "shape"
"""The folder in a run that holds the first stage."""

LOOPS: dict[str, LoopConfig] = {
    "fast": LoopConfig(steps=1000),
    "paper": LoopConfig(steps=30000, batch=4, learning_rate=1e-4, weight_decay=0.0, average=0.0),
    "tiny": LoopConfig(steps=8, batch=2, validate_every=4, average=0.9),
}
"""How long the dynamics are trained."""

SHAPE_LOOPS: dict[str, LoopConfig] = {
    "fast": LoopConfig(steps=200, learning_rate=1e-4, weight_decay=0.0, validate_every=50),
    "paper": LOOPS["paper"],
    "tiny": LOOPS["tiny"],
}
"""How long the space of shapes is trained; a linear one is fitted before."""

LOSSES: dict[str, MotionGuidedLosses] = {
    "fast": MotionGuidedLosses(),
    "paper": MotionGuidedLosses(steady=0.0, past="true"),
    "tiny": MotionGuidedLosses(),
}


@dataclass(frozen=True)
class Rows:
    """R frames of the garment, clip after clip, each led in by MEMORY frames of its settling.

    vertices: (R, N, 3) m, world; offsets: the same, as offsets from their carriers. transforms: (R, J, 3, 4).
    seeds: posed. samples: (S,) int64 rows that count. starts: (R,) int64 first row of the clip.
    """

    vertices: Tensor
    offsets: Tensor
    transforms: Tensor
    seeds: PosedSeeds
    samples: Tensor
    starts: Tensor

    def to(self, device: torch.device) -> "Rows":
        return to_device(self, device)


def load_rows(recordings: list[Recording], garment: str, maps: GarmentMaps) -> Rows:
    """Join the clips that have the garment."""
    vertices, transforms, samples, starts = [], [], [], []
    row = 0
    for recording in recordings:
        first = max(0, recording.settling - MEMORY)
        frames = slice(first, None)
        vertices.append(recording.vertices[garment][frames].float())
        transforms.append(recording.transforms[frames])
        count = len(transforms[-1])
        samples.append(torch.arange(row + max(MEMORY, recording.settling - first), row + count))
        starts.append(torch.full((count,), row))
        row += count
    joined = torch.cat(transforms)
    simulated = torch.cat(vertices)
    return Rows(
        vertices=simulated,
        offsets=offsets_of(maps, simulated, joined),
        transforms=joined,
        seeds=pose_seeds(maps.seeds, joined),
        samples=torch.cat(samples),
        starts=torch.cat(starts),
    )


def offsets_of(maps: GarmentMaps, vertices: Tensor, transforms: Tensor) -> Tensor:
    """Garments (R, N, 3) as offsets from their carriers, some at a time."""
    parts = zip(vertices.split(CHUNK), transforms.split(CHUNK), strict=True)
    return torch.cat([carried_offsets(maps, *part) for part in parts])


class Material:
    """What both stages train on: one garment on one body, training and validation clips."""

    def __init__(
        self, config: MotionGuidedConfig, losses: MotionGuidedLosses, data: Path, body: Body | None = None
    ) -> None:
        """Read the data. Raises InputError if it lacks the garment or is of another body."""
        self.config, self.losses = config, losses
        self.body = body or load_body()
        recordings = load_recordings(data, (config.garment,), self.body)
        self.garment = garment = wear(config.garment, self.body)
        check_rests({config.garment: garment.mesh.vertices}, recordings, self.body)
        training, held = hold_out(recordings, losses)
        if not training:
            raise InputError(f"{data}: needs two clips of {config.garment} at least, one to validate with")
        self.files = {name: digest for r in recordings for name, digest in r.files.items()}
        self.fps = recordings[0].fps
        self.maps = garment_maps(config, garment, self.body)
        self.rows = load_rows(training, config.garment, self.maps)
        self.held = load_rows(held, config.garment, self.maps)
        self.held_clips = [r.clip for r in held]
        edges = unique_edges(garment.mesh.faces)
        count = len(garment.mesh.vertices)
        self.edges = differences(edges, count)
        self.lengths = edge_lengths(garment.mesh.vertices, edges)
        smooth = laplacian(garment.mesh.faces, count)
        self.laplacian = Operator(smooth.to_sparse_csr(), smooth.t().to_sparse_csr())
        self.sample = sampling(self.maps.pixels, self.maps.shares, 4 * config.size**2)
        self.skin = BodySurface(self.body.mesh.vertices, self.body.mesh.faces)
        Console().print(
            f"{frames_of(training)} training frames of {len(training)} clips, "
            f"{frames_of(held)} validation frames ({', '.join(self.held_clips)})"
        )

    def to(self, device: torch.device) -> None:
        self.maps = to_device(self.maps, device)
        self.rows, self.held = self.rows.to(device), self.held.to(device)
        self.edges, self.laplacian = self.edges.to(device), self.laplacian.to(device)
        self.sample = self.sample.to(device)
        self.lengths = self.lengths.to(device)
        self.skin = BodySurface(self.body.mesh.vertices.to(device), self.body.mesh.faces.to(device))

    def codes(self, space: Space, rows: Rows, chosen: Tensor) -> Tensor:
        """Z* of simulated garments: (B, Z)."""
        seen = (rows.vertices[chosen], rows.offsets[chosen], rows.seeds.points[chosen])
        return space.encode(shape_features(space, self.maps, *seen))

    def shape_error(self, vertices: Tensor, truth: Tensor) -> Tensor:
        """L_rec: mean absolute error of vertices, and of their Laplacian."""
        wrong = vertices - truth
        return wrong.abs().mean() + self.losses.laplacian * self.laplacian(wrong).abs().mean()

    def depth(self, resting: Tensor) -> Tensor:
        """L_SDF: mean depth below CLEARANCE of rest shapes (B, N, 3), by the exact distance to the body."""
        points = resting.flatten(0, 1)
        with torch.no_grad():
            skin = self.skin.closest(points)
        distance = ((points - skin.points) * skin.normals).sum(1)
        return (CLEARANCE - distance).clamp(min=0.0).mean()


class ShapeObjective:
    """Stage one: an autoencoder of the simulated garments."""

    def __init__(self, material: Material) -> None:
        self.material = material

    @property
    def samples(self) -> Tensor:
        return self.material.rows.samples

    def networks(self) -> dict[str, nn.Module]:
        material, net = self.material, self.material.config.shape_space()
        offsets = material.rows.offsets[material.rows.samples[::4]]
        seen = material.maps.map(material.maps.positions(offsets))
        net.shift.copy_(seen.mean(0))
        net.scale.copy_((seen - net.shift).std().clamp(min=1e-3))
        if isinstance(net, LinearSpace):
            fit_linear(net, material)
        return {"net": net}

    def to(self, device: torch.device) -> None:
        self.material.to(device)

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        material, losses = self.material, self.material.losses
        space = networks["net"]
        codes = material.codes(space, material.rows, rows)
        random = torch.randn_like(codes[: max(1, len(codes) // 2)])
        resting = rest_shape(space, material.maps, torch.cat([codes, random]), material.sample)
        posed = posed_shape(space, material.maps, resting[: len(rows)], material.rows.seeds[rows])
        lengths = material.edges(resting[len(rows) :]).norm(dim=2)
        shape = material.shape_error(posed, material.rows.vertices[rows])
        # From the start, they would teach the decoder to ignore its codes.
        settled = (1.0 - shape.detach() / losses.settled).clamp(min=0.0)
        parts = {
            "shape": shape,
            "random": settled * losses.random * (lengths - material.lengths).abs().mean(),
            "inside": settled * losses.inside * material.depth(resting),
            "regular": losses.regular * _regular(codes),
        }
        yield "net", torch.stack(list(parts.values())).sum(), parts

    @torch.no_grad()
    def validate(self, net: Any) -> dict[str, float]:
        """How exactly held-out garments are encoded and decoded, mm."""
        net.eval()
        material, errors = self.material, []
        for chosen in material.held.samples[::2].split(8):
            codes = material.codes(net, material.held, chosen)
            resting = rest_shape(net, material.maps, codes)
            posed = posed_shape(net, material.maps, resting, material.held.seeds[chosen])
            errors.append((posed - material.held.vertices[chosen]).norm(dim=2).mean(1) * 1000.0)
        net.train()
        return {"mean": float(torch.cat(errors).mean())}

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        self._save({"space": net}, run, notes)

    def _save(self, stages: dict[str, nn.Module], run: Path, notes: dict[str, Any]) -> None:
        material = self.material
        tensors = {f"{s}.{name}": t for s, net in stages.items() for name, t in net.state_dict().items()}
        notes = {**notes, "validation_clips": material.held_clips}
        save_checkpoint(
            motion_guided_checkpoint(material.config, tensors, material.body, material.files, notes), run
        )

    def settings(self) -> dict[str, Any]:
        material = self.material
        return {**asdict(material.config), **asdict(material.losses), "data": material.files}

    def memory(self) -> dict[str, Tensor]:
        return {}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        pass


def rest_displacements(space: Space, material: Material, chosen: Tensor) -> Tensor:
    """Simulated garments of rows (B,) as displacements in the local frames at rest: (B, 3 N), m.

    The kernels that take a vertex back depend on where it comes to lie: found by iteration.
    """
    maps, rows = material.maps, material.rows
    resting = maps.points.expand(len(chosen), -1, -1)
    for _ in range(ROUNDS):
        blended = kernel_transforms(resting, maps.kernels, space.radii, maps.seeds, rows.seeds[chosen])
        resting = rotate(torch.linalg.inv(blended[..., :3]), rows.vertices[chosen] - blended[..., 3])
    return rotate_back(maps.axes, resting - maps.points).flatten(1)


def decoded_maps(values: Tensor, material: Material) -> Tensor:
    """Values at the vertices (B, N, 3) as maps that a decoder would give: (B, 4 H W 3)."""
    sheet = material.maps.fine
    baked = bake(values, material.garment.mesh.faces, sheet)
    return scatter_map(baked, sheet).flatten(2).transpose(1, 2).flatten(1)


@torch.no_grad()
def fit_linear(space: LinearSpace, material: Material) -> None:
    """Fit encoder and decoder in closed form: principal components of the shapes, of unit variance.

    Shapes are the simulated garments taken back to the rest space by the kernels there; the encoder is ridge
    regression from the maps that it sees.
    """
    maps, rows, chosen = material.maps, material.rows, material.rows.samples
    shapes = torch.cat(
        [
            rest_displacements(space, material, part)
            for part in track(chosen.split(CHUNK), "shapes", transient=True)
        ]
    )
    mean = shapes.mean(0)
    torch.manual_seed(0)
    latent = space.decoder.in_features
    codes, scales, components = torch.pca_lowrank(shapes - mean, q=min(latent, len(shapes) - 1), center=False)
    size = codes.std(0).clamp(min=1e-9)
    directions = (components * (scales * size)).T
    decoded = decoded_maps(torch.cat([directions, mean[None]]).unflatten(1, (-1, 3)), material) / REACH
    space.decoder.weight.zero_()
    space.decoder.weight.T[: len(directions)] = decoded[:-1]
    space.decoder.bias.copy_(decoded[-1])
    seen = torch.cat(
        [
            space.features(maps.map(maps.positions(rows.offsets[part]))).flatten(1)
            for part in chosen.split(CHUNK)
        ]
    )
    wanted = codes / size
    gram = seen @ seen.T
    ridge = RIDGE * gram.diagonal().mean() * torch.eye(len(gram))
    space.code.weight.zero_()
    space.code.bias.zero_()
    space.code.weight[: wanted.shape[1]] = (seen.T @ torch.linalg.solve(gram + ridge, wanted)).T


class DynamicsObjective(ShapeObjective):
    """Stage two: the dynamic encoder, the shape space being fixed."""

    def __init__(self, material: Material, space: Space) -> None:
        super().__init__(material)
        self.space = space.eval().requires_grad_(False)
        self.past, self.past_offsets = material.rows.vertices.clone(), material.rows.offsets.clone()
        with torch.no_grad():
            self.codes = torch.cat(
                [
                    material.codes(self.space, material.rows, chosen)
                    for chosen in track(torch.arange(len(self.past)).split(CHUNK), "codes", transient=True)
                ]
            )

    def networks(self) -> dict[str, nn.Module]:
        net = self.material.config.dynamics()
        material = self.material
        seen = [
            motion_values(material.config.carried, material.maps, self._situation(material.rows, chosen))
            for chosen in material.rows.samples[::8].split(CHUNK)
        ]
        scale = torch.cat(seen).square().mean((0, 1)).sqrt()
        net.motion_scale.copy_(scale.clamp(min=1e-3)[:, None, None])
        return {"net": net}

    def to(self, device: torch.device) -> None:
        super().to(device)
        self.space.to(device)
        self.past, self.past_offsets = self.past.to(device), self.past_offsets.to(device)
        self.codes = self.codes.to(device)

    def steps(
        self, networks: Mapping[str, Any], rows: Tensor
    ) -> Iterator[tuple[str, Tensor, dict[str, Tensor]]]:
        material, losses, net = self.material, self.material.losses, networks["net"]
        seen = self._situation(material.rows, rows, (self.past, self.past_offsets))
        features, change = situation_features(self.space, net, material.maps, seen, material.config.sigma)
        if losses.still:
            features = torch.cat([features, features])
            change = torch.cat([change, torch.zeros_like(change)])
            wanted = torch.cat([rows, rows - 1])
        else:
            wanted = rows
        codes = net(features, change)
        resting = rest_shape(self.space, material.maps, codes, material.sample)
        posed = posed_shape(self.space, material.maps, resting, material.rows.seeds[wanted])
        before = self.past[rows - 1] - material.rows.vertices[rows - 1]
        wrong = posed - material.rows.vertices[wanted]
        parts = {
            "shape": wrong.abs().mean(),
            "steady": losses.steady * (wrong[: len(rows)] - before).abs().mean(),
            "code": losses.code * (codes - self.codes[wanted]).abs().mean(),
            "regular": losses.regular * _regular(codes),
        }
        if losses.past == "own":
            self.past[rows] = posed[: len(rows)].detach()
            self.past_offsets[rows] = carried_offsets(
                material.maps, self.past[rows], material.rows.transforms[rows]
            )
        yield "net", torch.stack(list(parts.values())).sum(), parts

    def _situation(self, rows: Rows, chosen: Tensor, past: tuple[Tensor, Tensor] | None = None) -> Situation:
        """What comes before the chosen rows (B,); past: the garments (R, N, 3), where not as simulated."""
        vertices, offsets = past or (rows.vertices, rows.offsets)
        back = chosen[:, None] - torch.arange(1, MEMORY + 1, device=chosen.device)
        return self._after(rows, chosen, vertices[back], offsets[back])

    def _after(self, rows: Rows, chosen: Tensor, before: Tensor, offsets: Tensor) -> Situation:
        now = chosen[:, None] - torch.arange(MEMORY, device=chosen.device)
        return Situation(
            before=before,
            offsets=offsets,
            transforms=rows.transforms[now],
            seeds_before=rows.seeds[chosen - 1],
            seeds=rows.seeds[chosen],
            fps=self.material.fps,
        )

    @torch.no_grad()
    def validate(self, net: Any) -> dict[str, float]:
        """Mean vertex error over rollouts of the held-out clips, side by side, before contact, mm."""
        net.eval()
        material, held = self.material, self.material.held
        starts, counts = held.starts.unique(return_counts=True)
        first = self._situation(held, starts + MEMORY)
        before, offsets = first.before, first.offsets
        errors = []
        for frame in range(MEMORY, min(ROLLED, int(counts.min()))):
            chosen = starts + frame
            seen = self._after(held, chosen, before, offsets)
            resting = next_shape(self.space, net, material.maps, seen, material.config.sigma)
            posed = posed_shape(self.space, material.maps, resting, held.seeds[chosen])
            errors.append((posed - held.vertices[chosen]).norm(dim=2).mean(1) * 1000.0)
            moved = carried_offsets(material.maps, posed, held.transforms[chosen])
            before = torch.cat([posed[:, None], before[:, :-1]], dim=1)
            offsets = torch.cat([moved[:, None], offsets[:, :-1]], dim=1)
        net.train()
        return {"mean": float(torch.cat(errors).mean())}

    def save(self, net: Any, run: Path, notes: dict[str, Any]) -> None:
        self._save({"space": self.space, "dynamics": net}, run, notes)

    def memory(self) -> dict[str, Tensor]:
        return {"past": self.past} if self.material.losses.past == "own" else {}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        if self.material.losses.past == "own":
            self.past.copy_(memory["past"])
            self.past_offsets = offsets_of(self.material.maps, self.past, self.material.rows.transforms)


def _regular(codes: Tensor) -> Tensor:
    """L_reg of codes (B, Z)."""
    return (codes.square().mean(1) - 1.0).abs().mean()


def load_shape_space(folder: Path, config: MotionGuidedConfig) -> Space:
    """The space of shapes that the first stage saved. Raises InputError if it is of another config."""
    checkpoint = load_checkpoint(folder)
    space = config.shape_space()
    try:
        space.load_state_dict({name.removeprefix("space."): t for name, t in checkpoint.tensors.items()})
    except RuntimeError as error:
        raise InputError(f"{folder}: was trained with other settings of the network") from error
    return space
