"""Ensemble members: the same motion and garment simulated by other means, to see what is chance.

Member 0 is the usual simulation. 1 takes more substeps, 2 another mesh of the garment, 3 both.
"""

from rasterize.errors import InputError
from uvcloth.simulate.engine import Engine, SubstepEngine

MEMBERS = 4
"""Members of an ensemble, the usual simulation included."""

MORE_SUBSTEPS = 0.5
"""Share by which substeps are more in members that take more."""


def member_engine(engine: Engine, member: int) -> Engine:
    """The engine that simulates a member. Raises InputError for one that cannot change its substeps."""
    if not member:
        return engine
    if not isinstance(engine, SubstepEngine):
        name = engine.describe()["engine"]
        raise InputError(f"ensemble members need the explicit engine, {name} cannot change its substeps")
    return engine.with_more_substeps(MORE_SUBSTEPS) if member % 2 else engine
