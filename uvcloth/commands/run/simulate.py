"""Simulations of a plan, of outfits, or of garments over clips."""

from uvcloth.bodies.body import load_body
from uvcloth.commands.simulate import Simulate
from uvcloth.simulation.batch import simulate_batch
from uvcloth.simulation.options import SimulationOptions
from uvcloth.simulation.outfits import simulate_outfits
from uvcloth.simulation.plan import ClipSelection
from uvcloth.simulation.planned import simulate_plan
from uvcloth.simulation.workers import Workers


def run(command: Simulate) -> None:
    """Simulate what is missing in the folder. Raises InputError for bad input."""
    out, workers = command.out, Workers(command.jobs, command.scheduler)
    options = SimulationOptions(command.engine, command.fabric, command.edge, workers)
    if command.plan:
        simulate_plan(command.plan, out, command.clips_from, options)
        return
    clips = ClipSelection(command.clips, command.windows, command.clips_from, command.split, command.options)
    if command.outfits:
        simulate_outfits(command.outfits, clips, out, command.most_frames, options)
        return
    simulate_batch(
        clips,
        [command.garment] if command.layered else [(name,) for name in command.garment],
        out,
        load_body(command.body),
        command.ensemble,
        options,
    )
