"""Simulations of a plan, of outfits, or of garments over clips."""

from uvcloth.bodies.body import load_body
from uvcloth.commands.simulate import Simulate
from uvcloth.simulation.batch import simulate_batch
from uvcloth.simulation.outfits import simulate_outfits
from uvcloth.simulation.plan import ClipSelection
from uvcloth.simulation.planned import simulate_plan
from uvcloth.simulation.workers import Workers


def run(command: Simulate) -> None:
    """Simulate what is missing in the folder. Raises InputError for bad input."""
    out, engine, fabric = command.out, command.engine, command.fabric
    workers = Workers(command.jobs, command.scheduler)
    if command.plan:
        simulate_plan(command.plan, out, command.clips_from, engine, fabric, workers, command.edge)
        return
    selection = ClipSelection(
        command.clips, command.windows, command.clips_from, command.split, command.options
    )
    if command.outfits:
        simulate_outfits(
            command.outfits, selection, out, command.most_frames, engine, fabric, workers, command.edge
        )
        return
    simulate_batch(
        selection,
        outfits=[command.garment] if command.layered else [(name,) for name in command.garment],
        out=out,
        body=load_body(command.body),
        engine=engine,
        fabric=fabric,
        ensemble=command.ensemble,
        workers=workers,
        edge=command.edge,
    )
