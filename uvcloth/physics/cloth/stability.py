"""Step size of explicit integration: from the highest frequency and damping of the cloth."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from uvcloth.physics.cloth.cloth import Cloth
from uvcloth.player.cloth import Elastic

ITERATIONS = 60
"""Power iterations: the eigenvalue is found to about a percent."""

DISPLACEMENT = 2e-4
"""Metres by which a vertex is moved at most where the stiffness is measured by differences of forces."""


def largest_step(cloth: Cloth, rest: NDArray[np.float32]) -> float:
    """Longest stable step, s, of symplectic Euler for cloth at rest, (N, 3) m.

    With a largest frequency w and a largest damping rate c, both measured by power iteration on the forces,
    the step h has to keep h^2 w^2 + 2 h c < 4.
    """
    stiffness = _largest_eigenvalue(cloth, rest, False)
    damping = _largest_eigenvalue(cloth, rest, True)
    return (math.sqrt(damping**2 + 4.0 * stiffness) - damping) / stiffness


def _largest_eigenvalue(cloth: Cloth, rest: NDArray[np.float32], rates: bool) -> float:
    """Largest eigenvalue of the mass-weighted stiffness, 1/s2, or of the damping, 1/s."""
    # In tension cloth is as stiff as it gets, however soft compression is.
    nothing = np.zeros_like(cloth.membrane.area)
    still, hinges = cloth.membrane._replace(pressure=nothing, reduction=1.0), cloth.hinges
    if not rates:
        still, hinges = still._replace(damping=nothing), hinges._replace(damping=0.0)
    elastic = Elastic(replace(cloth, membrane=still, hinges=hinges).elastic_sections(), len(rest))
    root = np.sqrt(cloth.particles.mass.astype(np.float64))[:, None]
    direction = np.random.default_rng(0).normal(size=rest.shape)
    centred = rest - rest.mean(0)
    value = 0.0
    for _ in range(ITERATIONS):
        direction /= np.linalg.norm(direction)
        displacement = direction / root
        size = (1.0 if rates else DISPLACEMENT) / np.abs(displacement).max()
        forces = []
        for sign in (1.0, -1.0):
            shift = (sign * size * displacement).astype(np.float32)
            positions, velocities = (centred, shift) if rates else (centred + shift, np.zeros_like(shift))
            force = np.zeros_like(shift)
            elastic.add_forces(positions, velocities, force)
            forces.append(force.astype(np.float64))
        direction = (forces[1] - forces[0]) / (2.0 * size * root)
        value = float(np.linalg.norm(direction))
        if value == 0.0:
            break
    return value
