"""Outfits on cages, which the solver moves, and the garments that follow them, cleared off the skin."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.collider import Collider, compact, make_collider
from uvcloth.bodies.frames import BodyFrames
from uvcloth.bodies.opened import Opening, make_opening
from uvcloth.garments.band import holding_band
from uvcloth.garments.cage import QUALITIES, Cage, make_cage
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.layer_thickness import inner_thickness
from uvcloth.geometry.mesh import join_meshes, unique_edges, weld
from uvcloth.geometry.skinning import skin
from uvcloth.physics.cloth import moving_body
from uvcloth.physics.cloth.clearing import FineMesh, FineState, clear
from uvcloth.physics.cloth.cloth import Damping, make_cloth, vertex_rings
from uvcloth.physics.cloth.solver import (
    COMPILING,
    HOLD,
    HOLD_DAMPING,
    Motion,
    Settings,
    Solver,
    State,
    is_compiled,
    make_solver,
    start,
    step,
)
from uvcloth.physics.layers import Layer

LOGGER = logging.getLogger(__name__)

CAGE_INTERVAL = 1.0 / 60.0
"""Seconds between two searches for contact; fine cloth is searched twice as often."""

SETTLING_FRAMES, SETTLING_FPS = 45, 30.0
"""Frames, and how many there are in a second, in which cloth comes to rest."""

CLEARANCE = 0.003
"""Metres that garments keep from the skin, and from each other."""


@dataclass(frozen=True)
class PhysicsConfig:
    """Settings of the solver on cages.

    quality: of the cages, a key of QUALITIES. compression: share of the membrane's stiffness that is left
    where compression begins, because a coarse face cannot buckle as fine cloth does.
    """

    quality: str = "default"
    compression: float = 0.3
    damping: Damping = field(default_factory=Damping)
    settings: Settings = field(default_factory=lambda: Settings(interval=CAGE_INTERVAL))


@dataclass(frozen=True)
class CagedGarment:
    """A garment with its cage.

    kept: (U,) its vertices at different places; places: (N,) the one of these that each vertex is at. points:
    (U, 3) m at rest, weights: (U, J). cage: of those points. cage_weights: (n, J). rows: of its cage among
    all cages.
    """

    kept: Tensor
    places: Tensor
    points: Tensor
    weights: Tensor
    cage: Cage
    cage_weights: Tensor
    rows: slice


@dataclass(frozen=True)
class Over:
    """A garment that lies over another: its points that are kept on the outer side of it, (R,) rows."""

    outer: int
    inner: int
    rows: Tensor
    layer: Layer


@dataclass(frozen=True)
class CagedOutfit:
    """An outfit on cages, ready to be stepped.

    closed: the body as closed parts. opening: moves these apart to give cloth room. used: (C,) the
    collider's vertices that the solver has. hold: (n,) 1/s, the attachment of bands. fine, fine_body: for the
    clearing of all garments' points. over: the pairs of layers, the innermost first.
    """

    garments: tuple[CagedGarment, ...]
    solver: Solver
    closed: Collider
    opening: Opening
    used: Tensor
    hold: NDArray[np.float32]
    fine: FineMesh
    fine_body: moving_body.Body
    over: tuple[Over, ...]

    def collider(self, body_vertices: Tensor) -> NDArray[np.float32]:
        """Opened collider (C, 3) m of a posed body (V, 3) m."""
        return self.opening.opened(self.closed.vertices(body_vertices))[self.used].numpy()

    def skinned(self, transforms: Tensor) -> tuple[Tensor, ...]:
        """Smoothly skinned points (U, 3) m of each garment. transforms: (J, 3, 4)."""
        return tuple(skin(each.points, each.weights, transforms[None])[0] for each in self.garments)

    def skinned_cages(self, transforms: Tensor) -> NDArray[np.float32]:
        """Smoothly skinned cages (n, 3) m of all garments. transforms: (J, 3, 4)."""
        return torch.cat(
            [skin(each.cage.vertices, each.cage_weights, transforms[None])[0] for each in self.garments]
        ).numpy()


@dataclass(frozen=True)
class CagedState:
    """Cloth of one rollout, with the collider and the targets of its last frame.

    body: (C, 3) m, the collider. targets: (n, 3) m that its cages were pulled to. fine: the points of all
    garments in the frame that was shown last.
    """

    cloth: State
    body: NDArray[np.float32]
    targets: NDArray[np.float32]
    fine: FineState

    def displaced(self, way: NDArray[np.float64]) -> "CagedState":
        """The same displaced by (3,) m."""
        return replace(
            self,
            cloth=replace(self.cloth, origin=self.cloth.origin + way),
            body=(self.body + way).astype(np.float32),
            targets=(self.targets + way).astype(np.float32),
        )


def posed(frames: BodyFrames) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield joint transforms (J, 3, 4) and body vertices (V, 3) m of each frame, on the CPU."""
    return zip(frames.transforms[:, -1].cpu(), frames.vertices[:, -1].cpu(), strict=True)


def make_caged_outfit(outfit: Outfit, config: PhysicsConfig) -> CagedOutfit:
    """Make cages of an outfit's garments, and the solver that moves them all as one cloth.

    Raises InputError for a garment that nothing holds up, and for cloth that the solver cannot step.
    """
    if not is_compiled():
        LOGGER.info(COMPILING)
    body = outfit.body
    collider = make_collider(body)
    garments = tuple(_caged(outfit.garments, QUALITIES[config.quality]))
    joined = join_meshes((each.cage.vertices, each.cage.faces) for each in garments)
    points = torch.cat([each.points for each in garments])
    touches = collider.touches(joined.vertices, body.mesh.vertices)
    fine_touches = collider.touches(points, body.mesh.vertices)
    met = touches.any(1) | fine_touches.any(1)
    parts = tuple(compress(collider.parts, met))
    used, faces = compact(parts)
    at_rest = collider.vertices(body.mesh.vertices)[used].numpy()
    bands = [holding_band(garment, body) for garment in outfit.garments]
    held = torch.cat(
        [
            each.cage.at_cage(band.vertices[each.kept, None].float())[:, 0] > 0.5
            for each, band in zip(garments, bands, strict=True)
        ]
    )
    mass = torch.cat(
        [torch.full((len(each.cage_weights),), band.mass) for each, band in zip(garments, bands, strict=True)]
    )
    cloth = make_cloth(
        joined.vertices.numpy(),
        joined.faces.numpy(),
        outfit.garments[0].fabric,
        mass_factor=torch.where(held, mass, 1.0).numpy(),
        thickness=_thickness([each.cage.vertices for each in garments], outfit.garments),
        compression=config.compression,
        damping=config.damping,
    )
    solid = moving_body.make_body(at_rest, faces, touches[met].numpy())
    names = " + ".join(garment.name for garment in outfit.garments)
    return CagedOutfit(
        garments,
        make_solver(cloth, joined.vertices.numpy(), solid, config.settings, f"garment {names}"),
        collider,
        make_opening(collider.for_cloth(met), body.mesh.vertices),
        used,
        np.where(held.numpy(), HOLD, 0.0).astype(np.float32),
        _fine_mesh(garments, outfit.garments),
        solid._replace(touches=fine_touches[met].numpy()),
        tuple(_layers(garments, outfit.garments)),
    )


def next_frame(
    prepared: CagedOutfit,
    state: CagedState,
    body: NDArray[np.float32],
    targets: NDArray[np.float32],
    pull: float,
    fps: float,
) -> CagedState:
    """Cloth one frame later: the collider at (C, 3) m, cages pulled to targets (n, 3) m with `pull`, 1/s."""
    held = prepared.hold > 0
    motion = Motion(
        1.0 / fps,
        state.body,
        body,
        state.targets,
        targets,
        np.where(held, prepared.hold, pull).astype(np.float32),
        np.where(held, HOLD_DAMPING, 1.0).astype(np.float32),
    )
    return replace(state, cloth=step(prepared.solver, state.cloth, motion), body=body, targets=targets)


def at_rest(
    prepared: CagedOutfit, body: NDArray[np.float32], targets: NDArray[np.float32], pull: float
) -> CagedState:
    """Cloth that comes to rest from the targets (n, 3) m, pulled to them, on a still collider (C, 3) m.

    Whenever it slows down it is stopped, so that a skirt does not swing for seconds (kinetic damping:
    Barnes, 1999).
    """
    nowhere = np.zeros((sum(_sizes(prepared)), 3), np.float32)
    fine = FineState(nowhere, np.zeros_like(body), moving_body.no_memory(prepared.fine_body), 0)
    state = CagedState(start(prepared.solver, targets), body, targets, fine)
    energy = 0.0
    for _ in range(SETTLING_FRAMES):
        state = next_frame(prepared, state, body, targets, pull, SETTLING_FPS)
        before, energy = energy, float(np.square(state.cloth.velocities).sum())
        if energy < before:
            stopped = replace(state.cloth, velocities=np.zeros_like(state.cloth.velocities))
            state, energy = replace(state, cloth=stopped), 0.0
    return state


def carry(
    prepared: CagedOutfit, state: CagedState, cages: NDArray[np.float32], garments: Sequence[Tensor]
) -> tuple[CagedState, tuple[Tensor, ...]]:
    """Garments (N, 3) m that follow their cages, cleared off the body and off each other.

    cages: (n, 3) m and garments: (U, 3) m of each, skinned in one pose. The offsets of the cloth from the
    cages are added to the garments.
    """
    offsets = torch.from_numpy((state.cloth.vertices() - cages).astype(np.float32))
    origin = np.asarray(state.body, np.float64).mean(0)
    points = torch.cat(
        [
            near + each.cage.at_garment(offsets[each.rows])
            for each, near in zip(prepared.garments, garments, strict=True)
        ]
    )
    positions = (points.numpy() - origin).astype(np.float32)
    fine = clear(
        prepared.fine,
        prepared.fine_body,
        state.fine,
        (state.body - origin).astype(np.float32),
        positions,
        np.float32(CLEARANCE),
    )
    finished = list(
        (torch.from_numpy(fine.positions) + torch.from_numpy(origin)).float().split(_sizes(prepared))
    )
    for pair in prepared.over:
        _lift(pair, finished)
    return replace(state, fine=fine), tuple(
        vertices[each.places] for each, vertices in zip(prepared.garments, finished, strict=True)
    )


def _caged(garments: Sequence[Garment], edge: float) -> Iterator[CagedGarment]:
    first = 0
    for garment in garments:
        mesh = garment.mesh
        kept, places = weld(mesh.vertices).unique(return_inverse=True)
        cage = make_cage(mesh.vertices[kept], places[mesh.faces], edge)
        weights = garment.smooth_weights[kept]
        yield CagedGarment(
            kept=kept,
            places=places,
            points=mesh.vertices[kept],
            weights=weights,
            cage=cage,
            cage_weights=cage.at_cage(weights),
            rows=slice(first, first + len(cage.vertices)),
        )
        first += len(cage.vertices)


def _sizes(prepared: CagedOutfit) -> list[int]:
    return [len(each.points) for each in prepared.garments]


def _thickness(points: Sequence[Tensor], garments: Sequence[Garment]) -> NDArray[np.float32]:
    return torch.cat(
        [
            inner_thickness(vertices, (inner.mesh for inner in garments[:index]))
            for index, vertices in enumerate(points)
        ]
    ).numpy()


def _fine_mesh(garments: Sequence[CagedGarment], worn: Sequence[Garment]) -> FineMesh:
    meshes = zip(garments, worn, strict=True)
    joined = join_meshes((each.points, each.places[garment.mesh.faces]) for each, garment in meshes)
    rings = vertex_rings(unique_edges(joined.faces).numpy(), len(joined.vertices))
    return FineMesh(_thickness([each.points for each in garments], worn), *rings)


def _layers(garments: Sequence[CagedGarment], worn: Sequence[Garment]) -> Iterator[Over]:
    """Pairs of garments, with the points of the outer one that are not on the inner side at rest."""
    for outer, cage in enumerate(garments):
        for inner, below in enumerate(garments[:outer]):
            layer = Layer(below.points, below.places[worn[inner].mesh.faces])
            beside = layer.beside(cage.points)
            rows = torch.nonzero(~beside.covered | (beside.distance >= 0)).squeeze(1)
            yield Over(outer, inner, rows, layer)


def _lift(pair: Over, garments: list[Tensor]) -> None:
    """Move the outer garment of a pair off the inner one."""
    pair.layer.update(garments[pair.inner])
    beside = pair.layer.beside(garments[pair.outer][pair.rows])
    lack = torch.where(beside.covered, CLEARANCE - beside.distance, 0.0).clamp(min=0.0)
    lifted = garments[pair.outer].clone()
    lifted[pair.rows] += lack[:, None] * beside.normals
    garments[pair.outer] = lifted
