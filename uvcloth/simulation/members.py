"""Ensemble members: the same motion and garment, simulated in other ways to measure the effect of chance.

Member 0 is the usual simulation. 1 takes more substeps, 2 another mesh of the garment, 3 both.
"""

from importlib.util import find_spec

from uvcloth.errors import InputError
from uvcloth.simulation.engine import Engine, SubstepEngine
from uvcloth.simulation.remeshed import Remeshed

MORE_SUBSTEPS = 0.5
"""Share of additional substeps in members that take more."""


def member_engine(engine: Engine, member: int) -> Engine:
    """The engine that simulates a member.

    Raises InputError for an engine that cannot change its substeps, and without the remesher.
    """
    if not member:
        return engine
    if not isinstance(engine, SubstepEngine):
        name = engine.describe()["engine"]
        raise InputError(f"ensemble members need the explicit engine, {name} cannot change its substeps")
    substeps, mesh = member % 2, member // 2
    if mesh and find_spec("pyacvd") is None:
        raise InputError("ensemble members on another mesh need the remesher: install uvcloth[body]")
    stepped = engine.with_more_substeps(MORE_SUBSTEPS) if substeps else engine
    if not mesh:
        return stepped
    return stepped.on_another_mesh() if isinstance(stepped, Remeshed) else Remeshed(stepped)
