"""Fine cloth that tracks a coarse one: free where that cannot fold, pulled to it at longer waves.

After the tracking of shells by Bergou et al. 2007, with soft springs in place of constraints: fine cloth is
pulled to the surface that a cage carries, but only by the part of its offset whose waves the cage can have.
So its coarse motion is that of the cage, and what is left, folds, depends on it and on its past.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array, eye_array
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree
from torch import Tensor

from rasterize.gather import gather
from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import compact
from uvcloth.garments.cage import kept_cage
from uvcloth.garments.garment import Garment
from uvcloth.garments.joined import join
from uvcloth.garments.refined import Refined
from uvcloth.geometry.mesh import edge_lengths, neighbour_average, unique_edges
from uvcloth.physics.cloth.body import make_body
from uvcloth.physics.cloth.cloth import Cloth, make_cloth
from uvcloth.physics.cloth.solver import (
    HOLD,
    HOLD_DAMPING,
    Motion,
    Settings,
    State,
    make_solver,
    start,
    step,
)
from uvcloth.simulation.run import make_scene


@dataclass(frozen=True)
class Tracking:
    """Settings of fine cloth that tracks a coarse one.

    edge: m, length of its edges. pull: 1/s, frequency of the springs, and damping: their damping ratio.
    wavelength: m, above which waves of the offset are pulled back: a little more than two edges of a cage.
    settle: frames that the first pose lasts before. moved_mass: as `make_cloth` has it.
    """

    edge: float = 0.009
    pull: float = 40.0
    damping: float = 0.7
    wavelength: float = 0.1
    settle: int = 6
    moved_mass: float = 0.02
    settings: Settings = field(default_factory=lambda: Settings(renewal=4, interval=1.0 / 120.0))


@dataclass(frozen=True)
class FineGarment:
    """An even fine mesh of a garment, whose vertices lie in the refined garment.

    rest: (n, 3) m. faces: (m, 3). corners, weights: (n, 3) vertices of the refined garment around each, and
    their barycentrics.
    """

    refined: Refined
    rest: Tensor
    faces: Tensor
    corners: Tensor
    weights: Tensor

    @classmethod
    def of(cls, garment: Garment, edge: float) -> "FineGarment":
        """The mesh of a garment at rest with edges of a length, m."""
        refined = Refined.of(garment.mesh)
        even = kept_cage(refined.mesh.vertices, refined.mesh.faces, edge)
        return cls(refined, even.vertices, even.faces, even.corners, even.weights)

    def at(self, vertices: Tensor) -> Tensor:
        """Vertices (..., n, 3) m as the garment's smooth surface at (..., N, 3) m carries them."""
        return gather(self.refined.at(vertices), self.corners, self.weights)


class LongWaves:
    """Low-pass filter of values at the vertices of an even mesh: 1 / (1 + (k / k0)^4) of wave number k."""

    def __init__(self, rest: Tensor, faces: Tensor, wavelength: float) -> None:
        """Make the filter of a mesh at rest, (n, 3) m and (m, 3). wavelength: m, of k0."""
        count = len(rest)
        average = neighbour_average(faces, count)
        neighbours = coo_array((average.values().numpy(), average.indices().numpy()), shape=(count, count))
        spacing = float(edge_lengths(rest, unique_edges(faces)).mean())
        # On even triangles the mean of the neighbours lags by a quarter of h^2 times the Laplacian.
        laplacian = (eye_array(count) - neighbours) * (4.0 / spacing**2) * (wavelength / (2.0 * np.pi)) ** 2
        self._factors = splu((eye_array(count) + laplacian @ laplacian).tocsc())

    def of(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Long waves of values (n, C)."""
        return self._factors.solve(np.ascontiguousarray(values))


@dataclass(frozen=True)
class TrackedFrame:
    """One frame: the fine cloth, (n, 3) m, and the substeps that it took."""

    vertices: Tensor
    substeps: int


def track(
    garment: Garment,
    fine: FineGarment,
    body: Body,
    coarse: Tensor,
    transforms: Tensor,
    fps: float,
    tracking: Tracking,
) -> Iterator[TrackedFrame]:
    """Simulate fine cloth that tracks a garment, (F, N, 3) m, over a motion, (F, J, 3, 4); yield each frame.

    It begins where the garment is, and settles there in the first pose. Raises InputError for cloth that the
    solver cannot step and for a body that is too fast.
    """
    cloth = join(garment, body)
    scene = make_scene([cloth], [coarse], transforms, body, fps)
    targets = fine.at(coarse.double()).numpy()
    used, parts = compact(scene.collider_parts)
    bodies = scene.collider[:, used].numpy()
    place = KDTree(garment.mesh.vertices[cloth.kept].numpy()).query(fine.rest.numpy())[1]
    band, factor = scene.band.numpy()[place], scene.mass_factor.numpy()[place]
    rest = fine.rest.double().numpy()
    solver = make_solver(
        fine_cloth(fine, garment, factor, tracking),
        rest,
        make_body(bodies[0], parts, scene.touches.numpy()[:, place]),
        tracking.settings,
        f"garment {garment.name}",
    )
    filtered = LongWaves(fine.rest, fine.faces, tracking.wavelength)
    pull = np.where(band, HOLD, tracking.pull).astype(np.float32)
    damping = np.where(band, HOLD_DAMPING, tracking.damping).astype(np.float32)
    state = start(solver, targets[0])

    def stepped(state: State, before: int, now: int) -> State:
        """The state a frame later, pulled at long waves: the target has the short waves that cloth has."""
        offset = state.vertices() - targets[before]
        short = np.where(band[:, None], 0.0, offset - filtered.of(offset))
        ends = bodies[before], bodies[now], targets[before] + short, targets[now] + short
        return step(solver, state, Motion(1.0 / fps, *ends, pull, damping))

    for _ in range(tracking.settle):
        state = stepped(state, 0, 0)
    yield TrackedFrame(torch.from_numpy(state.vertices()), state.substeps)
    for now in range(1, len(targets)):
        state = stepped(state, now - 1, now)
        yield TrackedFrame(torch.from_numpy(state.vertices()), state.substeps)


def fine_cloth(
    fine: FineGarment, garment: Garment, factor: NDArray[np.floating], tracking: Tracking
) -> Cloth:
    """Cloth of a fine mesh. factor: (n,) on the mass of its vertices."""
    return make_cloth(
        fine.rest.numpy(),
        fine.faces.numpy(),
        garment.fabric,
        mass_factor=factor,
        moved_mass=tracking.moved_mass,
    )
