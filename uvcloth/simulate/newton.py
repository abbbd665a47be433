"""Cloth simulation with Newton's SolverVBD (vertex block descent)."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from importlib.metadata import version
from typing import Any, Self

import torch
import warp as wp
from torch import Tensor

from rasterize.warp_start import start_warp
from uvcloth.geometry.units import GRAVITY
from uvcloth.physics.fabric import AIR_DENSITY, Fabric
from uvcloth.simulate.engine import Frame, Scene
from uvcloth.simulate.newton_patches import (
    keep_apart,
    leave_out_gradients,
    patched_solver,
    require_newton,
)

STRIDE_SHARE = 0.85
"""Share of the distance to other cloth that a vertex may move before self-contact is detected again."""

MAX_SUBSTEPS = 200
"""Most substeps of a frame: enough for 25 m/s on the body; cloth that flies apart is not followed."""

# Versions are looked up in files, and an engine is described once for every sequence of a folder.
_version = cache(version)


@dataclass(frozen=True)
class Newton:
    """Newton's SolverVBD. Settings in SI units.

    substeps: per frame at least. iterations: of the solver in each; few in many substeps converge best.
    radius: m, kept between cloth and body. self_radius: m, kept between cloth and cloth; self_reach: m more
    within which cloth is watched. contact_reach: m, how deep in a part of the body cloth may be and still
    find its way out. creep: m/s of sliding below which friction fades.
    hold: 1/s, the frequency of the soft attachment of the band.
    """

    name: str = "newton.SolverVBD"
    fabric: Fabric = field(default_factory=Fabric)
    substeps: int = 20
    iterations: int = 3
    radius: float = 0.004
    self_radius: float = 0.003
    self_reach: float = 0.009
    contact_stiffness: float = 2e3
    contact_reach: float = 0.03
    contact_damping: float = 1e-2
    creep: float = 1e-3
    hold: float = 100.0

    @property
    def stride(self) -> float:
        """Metres that the solver lets a vertex move between two detections of self-contact."""
        return 0.5 * STRIDE_SHARE * (self.self_radius + self.self_reach)

    def describe(self) -> dict[str, Any]:
        """Describe engine, versions and settings, as `Engine` says."""
        return {
            "engine": self.name,
            "versions": {name: _version(name) for name in ("newton", "warp-lang")},
            "settings": asdict(self),
        }

    def with_fabric(self, fabric: Fabric) -> Self:
        """Make the same engine for cloth of another fabric."""
        return replace(self, fabric=fabric)

    def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
        """Yield the frames as `Engine` says.

        Raises InputError if Newton is missing or unsupported, ValueError for `after` without a memory.

        The memory of a frame is positions, velocities and accelerations, the first two relative to the mean
        of the skinned garment. It moves evenly between two frames, so that strides bound the motion of cloth
        on the body and not that of the body. The solver remembers nothing else: contacts are found again in
        each substep, in trees that are built at rest and refitted.
        """
        start_warp()
        require_newton()
        leave_out_gradients()
        import newton

        path = scene.skinned.mean(1, keepdim=True)
        scene = replace(
            scene, rest=scene.rest - path[0], skinned=scene.skinned - path, collider=scene.collider - path
        )
        model, bodies = _model(self, scene)
        pipeline = newton.CollisionPipeline(model, soft_contact_gap=self.contact_reach)
        keep_apart(pipeline, scene.touches)
        contacts, control = pipeline.contacts(), model.control()
        schedule = newton.solvers.SolverBase.CollisionFrequencyType.PRE_INIT
        solver = patched_solver()(
            model,
            iterations=self.iterations,
            friction_epsilon=self.creep,
            dat_conservative_bound_relaxation=STRIDE_SHARE,
            particle_enable_self_contact=True,
            particle_self_contact_margin=self.self_radius,
            particle_self_contact_gap=self.self_reach,
            particle_enable_tile_solve=False,
            collision_frequency_type={newton.solvers.SolverBase.CollisionSlot.SOFT_SELF_CONTACT: schedule},
        )
        now, later = model.state(), model.state()
        accelerations = scene.rest.new_tensor([0.0, 0.0, -GRAVITY]).repeat(len(scene.rest), 1)
        solver.accelerations = accelerations
        forces = _Forces(self, scene, model)
        collider = _Collider(scene, model, bodies)
        drifts = torch.cat([torch.zeros_like(path[:1]), path.diff(dim=0) * scene.fps])
        if after is None:
            after = Frame(0, scene.rest + path[0], _memory(now, accelerations))
            yield after
        else:
            _recall(after, now, accelerations)
        for frame in range(after.index + 1, len(scene.collider)):
            collider.begin(frame)
            forces.begin(frame)
            wind = drifts[frame]
            wp.to_torch(now.particle_qd).add_(drifts[frame - 1] - wind)
            count = self.substeps_for(
                scene.skinned[frame] - scene.skinned[frame - 1], wp.to_torch(now.particle_qd) / scene.fps
            )
            step = 1.0 / (scene.fps * count)
            for substep in range(1, count + 1):
                share = substep / count
                collider.move(share)
                now.clear_forces()
                forces.apply(now, share, wind)
                pipeline.collide(now, contacts)
                solver.step(now, later, control, contacts, step)
                torch.sub(wp.to_torch(later.particle_qd), wp.to_torch(now.particle_qd), out=accelerations)
                accelerations /= step
                now, later = later, now
            yield Frame(frame, wp.to_torch(now.particle_q) + path[frame], _memory(now, accelerations))

    def substeps_for(self, *moves: Tensor) -> int:
        """Number of substeps of a frame in which cloth and skinned garment move by `moves`, (N, 3) m each."""
        farthest = max(float(move.norm(dim=1).max()) for move in moves)
        return max(self.substeps, min(math.ceil(1.2 * farthest / self.stride), MAX_SUBSTEPS))


def _memory(state: Any, accelerations: Tensor) -> Tensor:
    """Positions, velocities and accelerations of a state, (9 N,)."""
    rows = (wp.to_torch(state.particle_q), wp.to_torch(state.particle_qd), accelerations)
    return torch.stack(rows).flatten()


def _recall(frame: Frame, state: Any, accelerations: Tensor) -> None:
    """Set a state, and accelerations, to the memory of a frame."""
    if frame.memory is None:
        raise ValueError("a frame without the engine's state cannot be continued")
    places = (wp.to_torch(state.particle_q), wp.to_torch(state.particle_qd), accelerations)
    for place, values in zip(places, frame.memory.view(3, -1, 3), strict=True):
        place.copy_(values)


def _model(settings: Newton, scene: Scene) -> tuple[Any, list[Any]]:
    """Build the model, and the meshes of the collider's parts, whose points the collider moves."""
    import newton

    fabric = settings.fabric
    upright: Any = wp.quat_identity()
    builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
    builder.add_cloth_mesh(
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=upright,
        scale=1.0,
        vel=wp.vec3(0.0, 0.0, 0.0),
        vertices=[wp.vec3(*point) for point in scene.rest.tolist()],
        indices=scene.faces.reshape(-1).tolist(),
        density=fabric.density,
        tri_ke=fabric.stretch / (2.0 * (1.0 + fabric.poisson)),
        tri_ka=fabric.stretch * fabric.poisson / (1.0 - fabric.poisson**2),
        tri_kd=0.0,
        edge_ke=1.0,
        edge_kd=0.0,
        particle_radius=settings.radius,
    )
    builder.particle_mass = (torch.tensor(builder.particle_mass) * scene.mass_factor).tolist()
    builder.particle_radius = (settings.radius + scene.inner_thickness).tolist()
    shape = newton.ModelBuilder.ShapeConfig(
        density=0.0, ke=settings.contact_stiffness, kd=settings.contact_damping, mu=fabric.friction
    )
    parts = []
    for faces in scene.collider_parts:
        used, corners = faces.unique(return_inverse=True)
        part = newton.Mesh(
            scene.collider[0, used].numpy(), corners.reshape(-1).numpy(), compute_inertia=False
        )
        builder.add_shape_mesh(body=-1, mesh=part, cfg=shape)
        parts.append(part)
    nothing = newton.ModelBuilder.ShapeConfig(
        density=0.0, has_shape_collision=False, has_particle_collision=False
    )
    builder.add_shape_sphere(body=-1, radius=1e-3, cfg=nothing)
    builder.color()
    model = builder.finalize(device="cpu")
    _set_bending(model, settings)
    model.soft_contact_ke = settings.contact_stiffness
    model.soft_contact_kd = settings.contact_damping
    model.soft_contact_mu = fabric.friction
    return model, [part.mesh for part in parts]


def _set_bending(model: Any, settings: Newton) -> None:
    """Give every edge the stiffness with which a mesh of any resolution bends like a plate.

    An edge of length l between faces of areas a and b stores B l^2 / (a + b) / 2 times its angle squared
    (exact for cylinders on the equilateral lattice: Seung and Nelson 1988); Newton multiplies by l itself.
    """
    edges = torch.from_numpy(model.edge_indices.numpy()).long()
    points = torch.from_numpy(model.particle_q.numpy())
    first, second, start, end = (points[edges[:, corner].clamp(min=0)] for corner in range(4))
    along = end - start
    lengths = along.norm(dim=1)
    doubled = sum(torch.linalg.cross(along, tip - start).norm(dim=1) for tip in (first, second))
    properties = torch.from_numpy(model.edge_bending_properties.numpy())
    properties[:, 0] = settings.fabric.bend * 2.0 * lengths / doubled
    model.edge_bending_properties.assign(properties.numpy())


class _Collider:
    """The moving body: interpolated between frames, refitted at every substep."""

    def __init__(self, scene: Scene, model: Any, meshes: list[Any]) -> None:
        self.frames = [scene.collider[:, faces.unique()].contiguous() for faces in scene.collider_parts]
        self.fps = scene.fps
        self.meshes = meshes
        self.low, self.high = model.shape_collision_aabb_lower, model.shape_collision_aabb_upper

    def begin(self, frame: int) -> None:
        """Set the two ends of the motion into a frame."""
        self.ends = [(frames[frame - 1], frames[frame]) for frames in self.frames]
        if not self.ends:
            return
        for mesh, (start, end) in zip(self.meshes, self.ends, strict=True):
            wp.copy(mesh.velocities, _vectors((end - start) * self.fps))
        reached = [torch.cat(ends) for ends in self.ends]
        for bounds, corners in (
            (self.low, [points.amin(0) for points in reached]),
            (self.high, [points.amax(0) for points in reached]),
        ):
            wp.copy(bounds, _vectors(torch.stack(corners)), count=len(corners))

    def move(self, share: float) -> None:
        """Move to a share, 0 to 1, of the way into the frame."""
        for mesh, (start, end) in zip(self.meshes, self.ends, strict=True):
            wp.copy(mesh.points, _vectors(torch.lerp(start, end, share)))
            mesh.refit()


class _Forces:
    """Soft attachment of the band, and drag of still air."""

    def __init__(self, settings: Newton, scene: Scene, model: Any) -> None:
        self.hold, self.fps = settings.hold, scene.fps
        self.pressure = 0.5 * AIR_DENSITY * settings.fabric.drag
        self.skinned, self.faces = scene.skinned, scene.faces
        self.mass = torch.from_numpy(model.particle_mass.numpy().copy())[:, None]
        self.light = self.mass / scene.mass_factor[:, None]
        self.band = scene.band[:, None].float()

    def begin(self, frame: int) -> None:
        """Set the two ends of the skinned garment's motion into a frame."""
        self.start, self.end = self.skinned[frame - 1], self.skinned[frame]
        self.velocity = (self.end - self.start) * self.fps

    def apply(self, state: Any, share: float, wind: Tensor) -> None:
        """Apply the forces at a share of the frame; wind: (1, 3) m/s, of the reference frame in the air."""
        position = wp.to_torch(state.particle_q)
        velocity = wp.to_torch(state.particle_qd)
        target = torch.lerp(self.start, self.end, share)
        attachment = self.mass * (
            self.hold**2 * (target - position) + 1.4 * self.hold * (self.velocity - velocity)
        )
        attachment[:, 2:] += GRAVITY * (self.mass - self.light)
        force = self.band * attachment
        force.index_add_(
            0, self.faces.reshape(-1), self._drag(position, velocity + wind).repeat_interleave(3, dim=0)
        )
        wp.to_torch(state.particle_f).copy_(force)

    def _drag(self, position: Tensor, velocity: Tensor) -> Tensor:
        """A third of the drag of each face (M, 3), N: along its normal, by the square of its speed there."""
        a, b, c = position[self.faces].unbind(1)
        normal = torch.linalg.cross(b - a, c - a)
        doubled = normal.norm(dim=1, keepdim=True).clamp(min=1e-12)
        normal = normal / doubled
        speed = (velocity[self.faces].mean(1) * normal).sum(1, keepdim=True)
        return -self.pressure / 6.0 * doubled * speed * speed.abs() * normal


def _vectors(values: Tensor) -> Any:
    return wp.from_torch(values.contiguous(), dtype=wp.vec3)
