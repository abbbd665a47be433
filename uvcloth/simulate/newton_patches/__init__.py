"""Replaced internals of one version of Newton, each with the reason.

The tests of this folder show for each that Newton itself still lacks it; one that fails says which to remove.
"""

from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import torch
import warp as wp
from torch import Tensor

from uvcloth.errors import InputError

SUPPORTED = "1.8"
"""Version of Newton whose internals are known; the patches of a release (1.8.1) are tried as they are."""


@dataclass(frozen=True)
class Patch:
    """One replaced name of a module of Newton; `original` is what Newton itself has there."""

    module: Any
    name: str
    replacement: Any
    why: str
    original: Any

    def apply(self) -> None:
        """Replace it, for kernels that are compiled from now on."""
        setattr(self.module, self.name, self.replacement)


def require_newton() -> None:
    """Raise InputError if Newton is not installed, or in a version whose internals are not known."""
    try:
        installed = version("newton")
    except PackageNotFoundError as error:
        raise InputError("simulating needs Newton: install uvcloth[simulate]") from error
    if installed.split(".")[:2] != SUPPORTED.split("."):
        raise InputError(
            f"Newton {installed} is installed, but this engine needs Newton {SUPPORTED}, whose internals it "
            "replaces: install uvcloth[simulate]"
        )


@cache
def patches() -> tuple[Patch, ...]:
    """Patches of the functions of SolverVBD, in the state before they are applied."""
    from newton._src.solvers.vbd import particle_vbd_kernels, solver_vbd

    from uvcloth.simulate.newton_patches import bending, near_pairs

    threads = "on a CPU threads run one after another: one looks through all contacts of a vertex or an edge"
    near = "most pairs that are watched are too far apart to matter, which a cheap test shows"
    table = [
        (solver_vbd, "NUM_THREADS_PER_COLLISION_PRIMITIVE", 1, threads),
        (particle_vbd_kernels, "NUM_THREADS_PER_COLLISION_PRIMITIVE", 1, threads),
        (
            particle_vbd_kernels,
            "evaluate_dihedral_angle_based_bending_force_hessian",
            bending.bending_force_hessian,
            "one corner in closed form costs a fraction of products of matrices for all four",
        ),
        (
            particle_vbd_kernels,
            "create_edge_edge_division_plane_closest_pt",
            near_pairs.near_edge_edge_plane,
            near,
        ),
        (
            particle_vbd_kernels,
            "create_vertex_triangle_division_plane_closest_pt",
            near_pairs.near_vertex_triangle_plane,
            near,
        ),
        (
            particle_vbd_kernels,
            "evaluate_edge_edge_contact_2_vertices",
            near_pairs.near_edge_edge_contact,
            near,
        ),
        (
            particle_vbd_kernels,
            "evaluate_vertex_triangle_collision_force_hessian_4_vertices",
            near_pairs.near_vertex_triangle_contact,
            near,
        ),
    ]
    return tuple(
        Patch(module, name, replacement, why, getattr(module, name))
        for module, name, replacement, why in table
    )


@cache
def patched_solver() -> type[Any]:
    """SolverVBD with all patches, whose substeps start from the acceleration of the substep before.

    Few iterations do not remove all of the initial guess. With free fall as the guess, cloth at rest falls a
    little in every substep, until it is stretched so far that the iterations compensate for it; with its own
    acceleration as the guess, which is zero, it stays in equilibrium for any number of iterations. (Chen et
    al. 2024, "Vertex Block Descent", section 3.7, use the part of the acceleration along gravity.) The
    acceleration is limited to that of free fall, or stiff waves grow.
    """
    from newton.solvers import SolverVBD

    for patch in patches():
        patch.apply()

    class FromAcceleration(SolverVBD):
        accelerations: Tensor
        """(N, 3) m/s2 of the substep before."""

        def _initialize_particles(self, state_in: Any, state_out: Any, contacts: Any, dt: float) -> None:
            super()._initialize_particles(state_in, state_out, contacts, dt)
            even = dt * wp.to_torch(state_in.particle_qd)
            # The reference is where the substep begins, which is where self-contact is detected.
            fall = wp.to_torch(self.inertia) - wp.to_torch(self.particle_q_prev) - even
            bent = dt**2 * self.accelerations
            share = fall.norm(dim=1, keepdim=True) / bent.norm(dim=1, keepdim=True).clamp(min=1e-12)
            wp.to_torch(self.particle_displacements).copy_(even + share.clamp(max=1.0) * bent)
            self._penetration_free_truncation(state_in, contacts)

    return FromAcceleration


@cache
def leave_out_gradients() -> None:
    """Compile kernels of Newton without gradients, which nobody asks for: most of their compilation."""
    from newton._src.geometry import kernels
    from newton._src.utils import mesh

    for module in (kernels, mesh):
        wp.set_module_options({"enable_backward": False}, module=module)


def keep_apart(pipeline: Any, touches: Tensor) -> None:
    """Remove pairs that may not touch from a collision pipeline, which pairs all vertices with all shapes.

    touches: (S, N), True where vertex n may touch shape s. Their places are filled with the last shape of the
    pipeline, which touches nothing.
    """
    pairs = pipeline.soft_rigid_contact_pairs.numpy()
    allowed = torch.cat([touches, touches.new_zeros(1, touches.shape[1])]).numpy()
    pairs[~allowed[pairs[:, 1], pairs[:, 0]], 1] = len(touches)
    pipeline.soft_rigid_contact_pairs.assign(pairs)
