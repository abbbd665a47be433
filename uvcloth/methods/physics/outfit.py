"""Outfits on cages, which the solver moves, and the garments that follow them, cleared off the skin."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.bodies.posing import posed_skin
from uvcloth.garments.band import holding_band
from uvcloth.garments.cage import QUALITIES, Cage, kept_cage
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import WeldedMesh, join_meshes, welded
from uvcloth.geometry.rotations import from_axis_angles, heading, to_axis_angles
from uvcloth.geometry.skeleton import joint_positions, joint_transforms, local_rotations, world_rotations
from uvcloth.geometry.skinning import skin
from uvcloth.physics.cloth.cloth import Damping, make_cloth
from uvcloth.physics.cloth.solver import (
    HOLD,
    HOLD_DAMPING,
    Motion,
    Settings,
    Solver,
    State,
    make_solver,
    start,
    step,
)
from uvcloth.physics.layer_thickness import outfit_thickness
from uvcloth.physics.outfit_clearing import FOLLOWING, OutfitClearing
from uvcloth.player.clearing import ClearingMemory

CAGE_INTERVAL = 1.0 / 60.0
"""Seconds between two searches for contact; fine cloth is searched twice as often."""

CAGE_RENEWAL = 4
"""Frames from one search of all faces of the body for a vertex to the next."""

PULL_DAMPING = 0.3
"""Damping ratio of the spring that pulls cages to targets: at 1 a skirt swings out with half its energy."""

SETTLING_FRAMES, SETTLING_FPS = 45, 30.0
"""Frames, and how many there are in a second, in which cloth comes to rest."""

POSING_FRAMES = 20
"""Frames, of the same length, in which a body goes from its rest pose to its first pose."""


@dataclass(frozen=True)
class PhysicsConfig:
    """Settings of the solver on cages.

    quality: of the cages, a key of QUALITIES. compression: share of the membrane's stiffness that is left
    where compression begins, because a coarse face cannot buckle as fine cloth does.
    """

    quality: str = "default"
    compression: float = 0.3
    damping: Damping = field(default_factory=Damping)
    settings: Settings = field(default_factory=lambda: Settings(renewal=CAGE_RENEWAL, interval=CAGE_INTERVAL))


@dataclass(frozen=True)
class CagedGarment:
    """A garment with its cage.

    mesh: the garment, welded. weights: (U, J) of its points. cage: of those points. cage_weights: (n, J).
    rows: of its cage among all cages.
    """

    mesh: WeldedMesh
    weights: Tensor
    cage: Cage
    cage_weights: Tensor
    rows: slice

    def represented(self, transforms: Tensor, garment: Tensor) -> Tensor:
        """The garment (B, N, 3) m as a cage that lies in it carries it. transforms: (B, J, 3, 4)."""
        offsets = self.cage.at_cage(garment[:, self.mesh.kept])
        offsets -= skin(self.cage.vertices, self.cage_weights, transforms)
        near = skin(self.mesh.points, self.weights, transforms)
        return (near + self.cage.at_garment(offsets))[:, self.mesh.places]


@dataclass(frozen=True)
class CagedOutfit:
    """An outfit on cages, ready to be stepped.

    clearing: of the garments that follow the cages; solver and clearing share its collider. hold: (n,) 1/s,
    the attachment of bands.
    """

    garments: tuple[CagedGarment, ...]
    solver: Solver
    clearing: OutfitClearing
    hold: NDArray[np.float32]

    def collider(self, body_vertices: Tensor) -> NDArray[np.float32]:
        """Opened collider (C, 3) m of a posed body (V, 3) m."""
        return self.clearing.collider(body_vertices)

    def skinned(self, transforms: Tensor) -> tuple[Tensor, ...]:
        """Smoothly skinned points (U, 3) m of each garment. transforms: (J, 3, 4)."""
        return tuple(skin(each.mesh.points, each.weights, transforms[None])[0] for each in self.garments)

    def represented(self, transforms: Tensor, garments: Sequence[Tensor]) -> tuple[Tensor, ...]:
        """Garments (B, N, 3) m as cages in them carry them, not cleared. transforms: (B, J, 3, 4)."""
        pairs = zip(self.garments, garments, strict=True)
        return tuple(each.represented(transforms, worn) for each, worn in pairs)

    def skinned_cages(self, transforms: Tensor) -> NDArray[np.float32]:
        """Smoothly skinned cages (n, 3) m of all garments. transforms: (J, 3, 4)."""
        return torch.cat(
            [skin(each.cage.vertices, each.cage_weights, transforms[None])[0] for each in self.garments]
        ).numpy()


@dataclass(frozen=True)
class CagedState:
    """Cloth of one rollout, with the collider and the targets of its last frame.

    body: (C, 3) m, the collider. targets: (n, 3) m that its cages were pulled to. fine: what clearing
    remembers of the frame that was shown last.
    """

    cloth: State
    body: NDArray[np.float32]
    targets: NDArray[np.float32]
    fine: ClearingMemory

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
    body = outfit.body
    garments = tuple(_caged(outfit.garments, QUALITIES[config.quality]))
    joined = join_meshes((each.cage.vertices, each.cage.faces) for each in garments)
    clearing = OutfitClearing.of(body, [garment.mesh for garment in outfit.garments], joined)
    bands = [holding_band(garment, body) for garment in outfit.garments]
    held = torch.cat(
        [
            each.cage.at_cage(band.vertices[each.mesh.kept, None].float())[:, 0] > 0.5
            for each, band in zip(garments, bands, strict=True)
        ]
    )
    mass = torch.cat(
        [torch.full((len(each.cage_weights),), band.mass) for each, band in zip(garments, bands, strict=True)]
    )
    cloth = make_cloth(
        joined.vertices.numpy(),
        joined.faces.numpy(),
        [garment.fabric for garment in outfit.garments],
        mass_factor=torch.where(held, mass, 1.0).numpy(),
        thickness=outfit_thickness(
            [each.cage.vertices for each in garments],
            [(each.mesh.points, each.mesh.faces) for each in garments],
        ).numpy(),
        fabric_of=np.repeat(np.arange(len(garments)), [len(each.cage.faces) for each in garments]),
        apart=clearing.apart.numpy(),
        compression=config.compression,
        damping=config.damping,
    )
    names = " + ".join(garment.name for garment in outfit.garments)
    return CagedOutfit(
        garments,
        make_solver(
            cloth, joined.vertices.numpy(), clearing.cages_solid, config.settings, f"garment {names}"
        ),
        clearing,
        np.where(held.numpy(), HOLD, 0.0).astype(np.float32),
    )


def next_frame(
    prepared: CagedOutfit,
    state: CagedState,
    body: NDArray[np.float32],
    targets: NDArray[np.float32],
    pull: float,
    fps: float,
) -> CagedState:
    """Cloth one frame later: the collider at (C, 3) m, cages pulled to targets (n, 3) m with `pull`, 1/s.

    After the first frame that was shown, cloth moves along with the targets, so that a clip that starts in a
    run does not pull a resting skirt away.
    """
    if state.fine.frame == 1:
        along = (targets - state.targets) * fps - state.cloth.drift
        state = replace(state, cloth=replace(state.cloth, velocities=along.astype(np.float32)))
    held = prepared.hold > 0
    motion = Motion(
        1.0 / fps,
        state.body,
        body,
        state.targets,
        targets,
        np.where(held, prepared.hold, pull).astype(np.float32),
        np.where(held, HOLD_DAMPING, PULL_DAMPING).astype(np.float32),
    )
    return replace(state, cloth=step(prepared.solver, state.cloth, motion), body=body, targets=targets)


def dressed(prepared: CagedOutfit, body: Body, transforms: Tensor) -> CagedState:
    """Cloth at rest on a body that went from its rest pose to the pose of transforms (J, 3, 4).

    The root keeps its place, and turns from its heading. Skinned from its rest pose to a wide step at once, a
    garment would start between the legs, or with an arm through it.
    """
    way = _way_to(body, transforms)
    places = zip(map(prepared.collider, posed_skin(body, way)), map(prepared.skinned_cages, way), strict=True)
    return _settled(prepared, list(places), 0.0)


def _way_to(body: Body, transforms: Tensor) -> Tensor:
    """Joint transforms (POSING_FRAMES + 1, J, 3, 4) from the rest pose to those of a pose, (J, 3, 4)."""
    skeleton = body.skeleton
    turned = local_rotations(skeleton.parents, transforms[None, :, :, :3].double())
    facing = heading(turned[0, 0])
    turned[0, 0] = facing.mT @ turned[0, 0]
    shares = torch.linspace(0.0, 1.0, POSING_FRAMES + 1, dtype=torch.float64)
    shares = shares * shares * (3.0 - 2.0 * shares)
    way = from_axis_angles(shares[:, None, None] * to_axis_angles(turned))
    way[:, 0] = facing @ way[:, 0]
    root = joint_positions(skeleton, transforms[None])[0, 0].double()
    world = world_rotations(skeleton.parents, way)
    return joint_transforms(skeleton, world, root.expand(len(way), 3)).to(transforms)


def at_rest(
    prepared: CagedOutfit, body: NDArray[np.float32], targets: NDArray[np.float32], pull: float
) -> CagedState:
    """Cloth that comes to rest from the targets (n, 3) m, pulled to them, on a still collider (C, 3) m."""
    return _settled(prepared, [(body, targets)], pull)


def _settled(
    prepared: CagedOutfit,
    places: Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]],
    pull: float,
) -> CagedState:
    """Cloth that starts at the first targets (n, 3) m, and comes to rest where collider and targets end.

    places: collider (C, 3) m and targets of each frame; the last are kept for SETTLING_FRAMES. Whenever cloth
    slows down it is stopped, so that a skirt does not swing for seconds (kinetic damping: Barnes, 1999).
    """
    body, targets = places[0]
    state = CagedState(start(prepared.solver, targets), body, targets, prepared.clearing.start())
    energy = 0.0
    for body, targets in (*places[1:], *[places[-1]] * SETTLING_FRAMES):
        state = next_frame(prepared, state, body, targets, pull, SETTLING_FPS)
        before, energy = energy, float(np.square(state.cloth.velocities).sum())
        if energy < before:
            stopped = replace(state.cloth, velocities=np.zeros_like(state.cloth.velocities))
            state, energy = replace(state, cloth=stopped), 0.0
    return state


def followed(
    prepared: CagedOutfit, state: CagedState, cages: NDArray[np.float32], garments: Sequence[Tensor]
) -> list[Tensor]:
    """Points (U, 3) m of each garment as its cage carries it, not cleared; arguments as of `carry`."""
    offsets = torch.from_numpy((state.cloth.vertices() - cages).astype(np.float32))
    return [
        near + each.cage.at_garment(offsets[each.rows])
        for each, near in zip(prepared.garments, garments, strict=True)
    ]


def carry(
    prepared: CagedOutfit,
    state: CagedState,
    cages: NDArray[np.float32],
    garments: Sequence[Tensor],
    body_vertices: Tensor,
) -> tuple[CagedState, tuple[Tensor, ...]]:
    """Garments (N, 3) m that follow their cages, cleared off the body and off each other.

    cages: (n, 3) m, garments: (U, 3) m of each, and body_vertices: (V, 3) m, skinned in one pose. The offsets
    of the cloth from the cages are added to the garments.
    """
    points = followed(prepared, state, cages, garments)
    fine, finished = prepared.clearing.clear(points, state.body, body_vertices, state.fine, FOLLOWING)
    return replace(state, fine=fine), finished


def _caged(garments: Sequence[Garment], edge: float) -> Iterator[CagedGarment]:
    first = 0
    for garment in garments:
        mesh = welded(garment.mesh.vertices, garment.mesh.faces)
        cage = kept_cage(mesh.points, mesh.faces, edge)
        weights = garment.smooth_weights[mesh.kept]
        yield CagedGarment(
            mesh=mesh,
            weights=weights,
            cage=cage,
            cage_weights=cage.at_cage(weights),
            rows=slice(first, first + len(cage.vertices)),
        )
        first += len(cage.vertices)
