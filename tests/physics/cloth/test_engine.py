"""The explicit engine: it goes on from any frame, makes more substeps, and its free skirt is converged."""

from dataclasses import replace

import pytest
import torch

from tests.simulation.physics.experiments import skirt_swing
from tests.simulation.physics.scenes import play, scene, sheet
from uvcloth.geometry.mesh import join_meshes
from uvcloth.physics.cloth.solver import Settings
from uvcloth.physics.fabric import Fabric
from uvcloth.simulation.engine import Scene
from uvcloth.simulation.explicit import Explicit

FPS = 30.0


def two_sheets(frames: int = 10) -> Scene:
    """One sheet falls on another that is held along an edge, which walks away ever faster."""
    lower, upper = sheet(0.3, 0.3, 12, 12), sheet(0.15, 0.15, 7, 7)
    joined = join_meshes([lower, (upper[0] + torch.tensor([0.05, 0.07, 0.008]), upper[1])])
    rest = joined.vertices
    held = (torch.arange(len(rest)) < len(lower[0])) & (rest[:, 0] < 1e-6)
    made = scene(rest, joined.faces, (frames - 1) / FPS, held=held)
    way = torch.arange(float(frames))[:, None, None] ** 2 * torch.tensor([0.003, -0.001, 0.002])
    return replace(made, skinned=made.skinned + way)


def test_it_goes_on_from_any_frame_as_if_it_had_not_stopped() -> None:
    made = two_sheets()
    engine = Explicit()
    frames = list(engine.simulate(made))
    truth = torch.stack([frame.vertices for frame in frames])
    assert [frame.index for frame in frames] == list(range(10))
    for stopped in (0, 1, 5, 9):
        rest = list(engine.simulate(made, after=frames[stopped]))
        assert [frame.index for frame in rest] == list(range(stopped + 1, 10))
        if rest:
            assert torch.equal(torch.stack([frame.vertices for frame in rest]), truth[stopped + 1 :])
            assert torch.equal(rest[-1].memory, frames[-1].memory)


def test_its_memory_holds_speeds_and_the_sides_of_cloth_on_cloth() -> None:
    """Without either it goes on another way: with all speeds at zero, or the sheets on each other's side."""
    made, engine = two_sheets(), Explicit()
    frame = list(engine.simulate(made))[5]
    truth = next(engine.simulate(made, after=frame)).vertices
    numbers, count = frame.memory, frame.vertices.numel()
    points = int(numbers[0])
    assert points > 20
    speeds, sides = (
        slice(2 + count, 2 + 2 * count),
        slice(2 + 2 * count + 2 * points, 2 + 2 * count + 3 * points),
    )
    assert set(numbers[sides].tolist()) == {-1.0, 1.0}
    for part, factor in ((speeds, 0.0), (sides, -1.0)):
        other = numbers.clone()
        other[part] *= factor
        found = next(engine.simulate(made, after=replace(frame, memory=other))).vertices
        assert (found - truth).abs().max() > 1e-4
    with pytest.raises(ValueError, match="without the engine's state"):
        next(engine.simulate(made, after=replace(frame, memory=None)))


def test_more_substeps_change_the_motion_little_and_its_description() -> None:
    engine = Explicit(settings=Settings(self_contact=False), fabric=Fabric(drag=0.0))
    more = engine.with_more_substeps(0.5).with_more_substeps(1.0)
    assert more.more_substeps == pytest.approx(3.0)
    assert more.describe()["settings"]["more_substeps"] == pytest.approx(3.0)
    rest, faces = sheet(0.3, 0.3, 12, 12)
    made = scene(rest, faces, 0.4, held=rest[:, 0] < 1e-6)
    first, second = (play(each, made)[-1] for each in (engine, more))
    assert 0.0 < (first - second).abs().max() < 0.01


def test_a_free_skirt_swings_as_it_does_with_eight_times_the_substeps() -> None:
    """Reference: skirt_swing(Explicit(..., more_substeps=8.0)), otherwise as below."""
    found = skirt_swing(Explicit(fabric=Fabric(drag=0.0), settings=Settings(self_contact=False)))
    assert found.periods[0] == pytest.approx(PERIOD, rel=0.03)
    assert found.extremes[2] == pytest.approx(THIRD, rel=0.15)


PERIOD, THIRD = 1.2391, -0.2629
