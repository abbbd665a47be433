"""Physics: the cloth solver on cages, in real time, of any garments in one solve, with nothing to train."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rasterize.errors import InputError
from uvcloth.bodies.collider import Collider, make_collider
from uvcloth.bodies.frames import BodyFrames
from uvcloth.bodies.opened import Opening, make_opening
from uvcloth.garments.band import Band, holding_band
from uvcloth.garments.cage import QUALITIES, Cage, make_cage
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.layer_thickness import inner_thickness
from uvcloth.geometry.mesh import join_meshes
from uvcloth.geometry.skinning import skin
from uvcloth.methods.method import Method, MethodEntry
from uvcloth.physics.cloth.body_contact import make_body
from uvcloth.physics.cloth.cloth import Damping, make_cloth
from uvcloth.physics.cloth.solver import Motion, Settings, Solver, State, make_solver, start, step

HOLD, HOLD_DAMPING = 100.0, 0.7
"""Frequency, 1/s, and damping ratio of the soft attachment of the band."""

SETTLING_SECONDS = 1.0
"""Seconds of standing still in the first pose before the first frame."""


@dataclass(frozen=True)
class PhysicsConfig:
    """Settings of the method.

    quality: of the cages, a key of QUALITIES. compression: share of the membrane's stiffness that is left in
    compression, where a coarse face cannot buckle. damping, settings: of the solver.
    """

    quality: str = "default"
    compression: float = 0.5
    damping: Damping = field(default_factory=Damping)
    settings: Settings = field(default_factory=Settings)


@dataclass(frozen=True)
class CagedGarment:
    """A garment with its cage.

    weights: (n, J) blend weights of the cage. start: row of its first vertex among those of all cages.
    """

    garment: Garment
    cage: Cage
    weights: Tensor
    start: int

    @property
    def rows(self) -> slice:
        """Rows of its vertices among those of all cages."""
        return slice(self.start, self.start + len(self.weights))


@dataclass(frozen=True)
class CagedOutfit:
    """An outfit on cages, ready to be stepped.

    closed: the body as closed parts, opening: what gives cloth room between them. used: (C,) the collider's vertices that the solver has. pull: (n,) 1/s, damping: (n,) of its attachment.
    """

    garments: tuple[CagedGarment, ...]
    solver: Solver
    closed: Collider
    opening: Opening
    used: Tensor
    pull: NDArray[np.float32]
    damping: NDArray[np.float32]

    def targets(self, transforms: Tensor) -> NDArray[np.float32]:
        """Skinned cages (n, 3) m of all garments. transforms: (J, 3, 4)."""
        skinned = [skin(each.cage.vertices, each.weights, transforms[None])[0] for each in self.garments]
        return torch.cat(skinned).numpy()

    def collider(self, body_vertices: Tensor) -> NDArray[np.float32]:
        """Opened collider (C, 3) m of a posed body (V, 3) m."""
        return self.opening.opened(self.closed.vertices(body_vertices))[self.used].numpy()


@dataclass(frozen=True)
class Solved:
    """Cloth of one rollout, and what moved it last: the collider (C, 3) m and the skinned cages (n, 3) m."""

    cloth: State
    body: NDArray[np.float32]
    targets: NDArray[np.float32]


@dataclass(frozen=True)
class Physics(Method):
    """The cloth solver on cages of the garments."""

    config: PhysicsConfig
    name: str = "physics"
    autoregressive: bool = True

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason that a garment cannot be solved."""
        try:
            for garment in outfit.garments:
                holding_band(garment, outfit.body)
        except InputError as error:
            return str(error)
        return ""

    def reads_fabric(self) -> bool:
        """True: a fabric is what the solver has."""
        return True

    def prepare(self, outfit: Outfit, device: torch.device) -> CagedOutfit:
        """Make the cages and their solver, which runs on the CPU."""
        body, config = outfit.body, self.config
        edge = QUALITIES[config.quality]
        cages = [make_cage(g.mesh.vertices, g.mesh.faces, edge) for g in outfit.garments]
        bands = [holding_band(garment, body) for garment in outfit.garments]
        joined = join_meshes((cage.vertices, cage.faces) for cage in cages)
        collider = make_collider(body)
        touches = collider.touches(joined.vertices, body.mesh.vertices)
        met = touches.any(1)
        parts = tuple(compress(collider.parts, met))
        used, corners = torch.cat(parts).unique(return_inverse=True)
        held = torch.cat([_held(cage, band) for cage, band in zip(cages, bands, strict=True)])
        mass = torch.cat([torch.full((len(c.vertices),), b.mass) for c, b in zip(cages, bands, strict=True)])
        cloth = make_cloth(
            joined.vertices.numpy(),
            joined.faces.numpy(),
            outfit.garments[-1].fabric,
            mass_factor=torch.where(held, mass, 1.0).numpy(),
            thickness=_thickness(outfit.garments, cages),
            compression=config.compression,
            damping=config.damping,
        )
        opening = make_opening(collider, body.mesh.vertices)
        solid = make_body(
            collider.vertices(body.mesh.vertices)[used].numpy(),
            [part.numpy() for part in corners.split([len(part) for part in parts])],
            touches[met].numpy(),
        )
        starts = np.cumsum([0, *(len(cage.vertices) for cage in cages)])
        return CagedOutfit(
            tuple(
                CagedGarment(garment, cage, cage.at_cage(garment.smooth_weights), int(first))
                for garment, cage, first in zip(outfit.garments, cages, starts[:-1], strict=True)
            ),
            make_solver(cloth, joined.vertices.numpy(), solid, config.settings),
            collider,
            opening,
            used,
            np.where(held.numpy(), HOLD, 0.0).astype(np.float32),
            np.full(len(held), HOLD_DAMPING, np.float32),
        )

    def init(self, prepared: CagedOutfit, frames: BodyFrames) -> tuple[Solved, ...]:
        """Let cloth settle on the bodies as they stand in the frames."""
        states = []
        for transforms, vertices in zip(frames.transforms[:, -1], frames.vertices[:, -1], strict=True):
            body, targets = prepared.collider(vertices), prepared.targets(transforms)
            state = Solved(start(prepared.solver, targets), body, targets)
            for _ in range(round(SETTLING_SECONDS * frames.fps)):
                state = _stepped(prepared, state, body, targets, frames.fps)
            states.append(state)
        return tuple(states)

    def step(
        self, prepared: CagedOutfit, state: tuple[Solved, ...], frames: BodyFrames
    ) -> tuple[tuple[Solved, ...], tuple[Tensor, ...]]:
        """Garments (B, N, 3) m of the next frame of B rollouts."""
        following, rows = [], []
        for solved, transforms, vertices in zip(
            state, frames.transforms[:, -1], frames.vertices[:, -1], strict=True
        ):
            body, targets = prepared.collider(vertices), prepared.targets(transforms)
            following.append(_stepped(prepared, solved, body, targets, frames.fps))
            rows.append(_carried(prepared, following[-1], transforms))
        return tuple(following), tuple(map(torch.stack, zip(*rows, strict=True)))

    def displaced(
        self, prepared: CagedOutfit, state: tuple[Solved, ...], shift: Tensor
    ) -> tuple[Solved, ...]:
        """The rollouts displaced by (B, 3) m."""
        ways = shift.double().cpu().numpy()
        return tuple(
            Solved(
                replace(solved.cloth, origin=solved.cloth.origin + way),
                (solved.body + way).astype(np.float32),
                (solved.targets + way).astype(np.float32),
            )
            for solved, way in zip(state, ways, strict=True)
        )


def _held(cage: Cage, band: Band) -> Tensor:
    return cage.at_cage(band.vertices[:, None].float())[:, 0] > 0.5


def _thickness(garments: Sequence[Garment], cages: Sequence[Cage]) -> NDArray[np.float32]:
    return torch.cat(
        [
            inner_thickness(cage.vertices, (inner.mesh for inner in garments[:index]))
            for index, cage in enumerate(cages)
        ]
    ).numpy()


def _stepped(
    prepared: CagedOutfit, state: Solved, body: NDArray, targets: NDArray, fps: float
) -> Solved:
    motion = Motion(
        1.0 / fps, state.body, body, state.targets, targets, prepared.pull, prepared.damping
    )
    return Solved(step(prepared.solver, state.cloth, motion), body, targets)


def _carried(prepared: CagedOutfit, state: Solved, transforms: Tensor) -> tuple[Tensor, ...]:
    """Garments (N, 3) m that follow their cages by what these are off the skinned ones."""
    offsets = torch.from_numpy((state.cloth.vertices() - state.targets).astype(np.float32))
    return tuple(
        skin(each.garment.mesh.vertices, each.garment.smooth_weights, transforms[None])[0]
        + each.cage.at_garment(offsets[each.rows])
        for each in prepared.garments
    )


ENTRY = MethodEntry(PhysicsConfig(), Physics)
