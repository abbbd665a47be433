"""Cloth simulation with Newton's SolverStyle3D (projective dynamics)."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor

from rasterize.errors import InputError
from uvcloth.simulate.engine import Scene


@dataclass(frozen=True)
class Style3D:
    """Settings in SI units; a light cotton jersey.

    substeps: per frame at least; stride: m that the skinned garment moves in a substep at most.
    density: kg/m2. stretch: (weft, warp, shear) N/m. bend: N m. radius: m, kept between cloth and body.
    contact_reach: m, how deep in a part of the body cloth may be and still find its way out.
    drag: 1/s towards still air. follow: 1/s towards the skinned garment's velocity.
    hold: 1/s, the frequency of the soft attachment of the band.
    """

    name: str = "newton.SolverStyle3D"
    substeps: int = 10
    stride: float = 0.01
    iterations: int = 4
    linear_iterations: int = 10
    density: float = 0.2
    stretch: tuple[float, float, float] = (300.0, 300.0, 90.0)
    bend: float = 3e-6
    radius: float = 0.004
    self_radius: float = 0.003
    contact_stiffness: float = 1e4
    contact_reach: float = 0.06
    contact_damping: float = 1e-2
    friction: float = 0.3
    drag: float = 1.0
    follow: float = 2.0
    hold: float = 100.0

    def describe(self) -> dict[str, Any]:
        return {
            "engine": self.name,
            "versions": {name: version(name) for name in ("newton", "warp-lang")},
            "settings": asdict(self),
        }

    def simulate(self, scene: Scene) -> Iterator[Tensor]:
        """Raises InputError if the `simulate` extra is not installed."""
        try:
            import newton
        except ModuleNotFoundError as error:
            raise InputError("simulating needs Newton: install uvcloth[simulate]") from error
        model, bodies = _model(self, scene)
        solver = newton.solvers.SolverStyle3D(
            model,
            config=newton.solvers.SolverStyle3D.Config(
                iterations=self.iterations, linear_iterations=self.linear_iterations
            ),
        )
        assert solver.collision is not None
        solver.collision.radius = self.self_radius
        solver.collision.friction_epsilon = 1e-2
        # Vertices against faces keep layers apart; edge tests and untangling cost half of the time.
        solver.collision.stiff_ee = solver.collision.stiff_ef = 0.0
        pipeline = newton.CollisionPipeline(model, soft_contact_gap=self.contact_reach)
        _keep_apart(pipeline, scene.touches)
        contacts, control = pipeline.contacts(), model.control()
        now, later = model.state(), model.state()
        forces = _Forces(self, scene, model)
        collider = _Collider(scene, model, bodies)
        yield scene.rest.clone()
        for frame in range(1, len(scene.collider)):
            collider.begin(frame)
            forces.begin(frame)
            count = self.substeps_between(scene.carrier[frame - 1], scene.carrier[frame])
            step = 1.0 / (scene.fps * count)
            for substep in range(1, count + 1):
                share = substep / count
                collider.move(share)
                now.clear_forces()
                forces.apply(now, share)
                pipeline.collide(now, contacts)
                solver.step(now, later, control, contacts, step)
                now, later = later, now
            yield torch.from_numpy(now.particle_q.numpy().copy())

    def substeps_between(self, before: Tensor, after: Tensor) -> int:
        """More of them where the skinned garment is fast, or limbs would pass through cloth."""
        farthest = float((after - before).norm(dim=1).max())
        return max(self.substeps, math.ceil(farthest / self.stride))


def _model(settings: Style3D, scene: Scene) -> tuple[Any, list[Any]]:
    """The finalized model, and the meshes of the collider's parts, whose live points the collider moves."""
    import newton
    from newton.solvers import style3d

    builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
    newton.solvers.SolverStyle3D.register_custom_attributes(builder)
    panels = _flattened(scene.rest.numpy(), scene.faces.numpy())
    weft, warp, shear = settings.stretch
    style3d.add_cloth_mesh(
        builder,
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        vel=wp.vec3(0.0, 0.0, 0.0),
        vertices=[wp.vec3(*point) for point in scene.rest.tolist()],
        indices=scene.faces.reshape(-1).tolist(),
        density=settings.density,
        panel_verts=[wp.vec2(*point) for point in panels.tolist()],
        panel_indices=list(range(3 * len(scene.faces))),
        particle_radius=settings.radius,
        tri_aniso_ke=wp.vec3(weft, warp, shear),
        edge_aniso_ke=wp.vec3(settings.bend, settings.bend, settings.bend),
    )
    builder.particle_mass = (np.array(builder.particle_mass) * scene.heavier.numpy()).tolist()
    builder.particle_radius = (settings.radius + scene.room).tolist()
    shape = newton.ModelBuilder.ShapeConfig(density=0.0, mu=settings.friction)
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
    model = builder.finalize(device="cpu")
    model.soft_contact_ke = settings.contact_stiffness
    model.soft_contact_kd = settings.contact_damping
    model.soft_contact_mu = settings.friction
    return model, [part.mesh for part in parts]


def _flattened(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Every triangle laid flat on its own, isometrically: (3 M, 2)."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    length = np.linalg.norm(b - a, axis=1)
    x_axis = (b - a) / length[:, None]
    along = ((c - a) * x_axis).sum(1)
    height = np.linalg.norm(c - a - along[:, None] * x_axis, axis=1)
    zero = np.zeros_like(length)
    corners = [np.stack(pair, 1) for pair in ((zero, zero), (length, zero), (along, height))]
    return np.stack(corners, axis=1).reshape(-1, 2)


def _keep_apart(pipeline: Any, touches: Tensor) -> None:
    """Let vertices and parts that may not touch be pairs with the last shape, which touches nothing."""
    pairs = pipeline.soft_rigid_contact_pairs.numpy()
    allowed = np.append(touches.numpy(), np.zeros_like(touches[:1]), axis=0)
    pairs[~allowed[pairs[:, 1], pairs[:, 0]], 1] = len(touches)
    pipeline.soft_rigid_contact_pairs.assign(pairs)


class _Collider:
    """The moving body: interpolated between frames, refitted at every substep."""

    def __init__(self, scene: Scene, model: Any, meshes: list[Any]) -> None:
        self.frames = [scene.collider[:, faces.unique()].contiguous() for faces in scene.collider_parts]
        self.fps = scene.fps
        self.meshes = meshes
        self.low, self.high = model.shape_collision_aabb_lower, model.shape_collision_aabb_upper

    def begin(self, frame: int) -> None:
        self.ends = [(frames[frame - 1], frames[frame]) for frames in self.frames]
        for mesh, (start, end) in zip(self.meshes, self.ends, strict=True):
            wp.copy(mesh.velocities, _vectors((end - start) * self.fps))
        reached = [torch.cat(ends) for ends in self.ends]
        for bounds, corners in (
            (self.low, [points.amin(0) for points in reached]),
            (self.high, [points.amax(0) for points in reached]),
        ):
            wp.copy(bounds, _vectors(torch.stack(corners)), count=len(corners))

    def move(self, share: float) -> None:
        for mesh, (start, end) in zip(self.meshes, self.ends, strict=True):
            wp.copy(mesh.points, _vectors(torch.lerp(start, end, share)))
            mesh.refit()


class _Forces:
    """Soft attachment of the band, drag of the air, and a pull towards the skinned garment's velocity."""

    def __init__(self, settings: Style3D, scene: Scene, model: Any) -> None:
        self.settings, self.fps = settings, scene.fps
        self.carrier = scene.carrier
        self.mass = torch.from_numpy(model.particle_mass.numpy().copy())[:, None]
        self.light = self.mass / scene.heavier[:, None]
        self.band = scene.band[:, None].float()

    def begin(self, frame: int) -> None:
        self.start, self.end = self.carrier[frame - 1], self.carrier[frame]
        self.velocity = (self.end - self.start) * self.fps

    def apply(self, state: Any, share: float) -> None:
        position = wp.to_torch(state.particle_q)
        velocity = wp.to_torch(state.particle_qd)
        target = torch.lerp(self.start, self.end, share)
        lag = self.velocity - velocity
        hold = self.settings.hold
        attachment = self.mass * (hold**2 * (target - position) + 1.4 * hold * lag)
        attachment[:, 2:] += 9.81 * (self.mass - self.light)
        air = self.light * (self.settings.follow * lag - self.settings.drag * velocity)
        wp.to_torch(state.particle_f).copy_(self.band * attachment + air)


def _vectors(values: Tensor) -> Any:
    return wp.from_torch(values.contiguous(), dtype=wp.vec3)
