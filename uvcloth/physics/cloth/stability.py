"""Step size of explicit integration: from the highest frequency and damping of the cloth."""

import numpy as np
from numpy.typing import NDArray

from uvcloth.physics.cloth.cloth import Cloth
from uvcloth.player.cloth import Elastic


def largest_step(cloth: Cloth, rest: NDArray[np.float32]) -> float:
    """Longest stable step, s, of symplectic Euler for cloth at rest, (N, 3) m (runtime/src/stability.h)."""
    return Elastic(cloth.elastic_sections(), len(rest)).stable_step(cloth.particles.mass, rest)
