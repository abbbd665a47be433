"""Options of every simulation: the engine, what it makes cloth of, and the processes that run it."""

from dataclasses import dataclass

from uvcloth.errors import InputError
from uvcloth.physics.fabric import find_fabric
from uvcloth.simulation.engine import Engine, SubstepEngine
from uvcloth.simulation.engines import ENGINES, require_engine_name
from uvcloth.simulation.remeshed import Remeshed
from uvcloth.simulation.workers import ONE_PER_CORE, Workers


@dataclass(frozen=True)
class SimulationOptions:
    """Engine, cloth, mesh and processes of simulations.

    engine: one of ENGINES. fabric: a key of FABRICS, of all garments; None for the engine's, or for that of
    each random outfit. edge: m, length of the edges of an even mesh that is simulated instead of a garment's
    own, and whose motion is carried back to it, as `Remeshed` does; None for the garment's own. workers:
    processes that simulate.
    """

    engine: str = "explicit"
    fabric: str | None = None
    edge: float | None = None
    workers: Workers = ONE_PER_CORE

    def make_engine(self) -> Engine:
        """Make the engine. Raises InputError for one that is unknown or missing, for less than one worker,
        and for an even mesh where the engine has none.
        """
        require_engine_name(self.engine)
        if self.workers.jobs is not None and self.workers.jobs < 1:
            raise InputError(f"--jobs {self.workers.jobs}: expected at least 1")
        engine = ENGINES[self.engine]()
        if self.fabric is not None:
            engine = engine.with_fabric(find_fabric(self.fabric))
        if self.edge is None:
            return engine
        if not isinstance(engine, SubstepEngine):
            needs = f"needs the explicit engine, {self.engine} simulates a garment's own mesh"
            raise InputError(f"--edge {self.edge:g}: {needs}")
        return Remeshed(engine, self.edge)


USUAL = SimulationOptions()
