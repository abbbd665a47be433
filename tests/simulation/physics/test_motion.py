"""Cloth moves as physics says: it falls, swings, hangs and keeps its energy."""

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from tests.simulation.physics.experiments import (
    LIMP,
    energy,
    rope_period,
    rope_theory,
    sag,
    sag_theory,
    swing,
)
from tests.simulation.physics.scenes import FPS, G, play, scene, sheet
from uvcloth.physics.fabric import Fabric

VACUUM = Fabric(drag=0.0)

LOW = (0.257, -0.287)
HIGH = (0.538, -0.057)
"""When (s) and where (m) the rim of the sheet below turns round, converged: 60 substeps x 30 iterations."""


def test_a_sheet_falls_freely(engine: Any) -> None:
    rest, faces = sheet(0.2, 0.2, 6, 6)
    moved = play(replace(engine, fabric=VACUUM), scene(rest, faces, 0.3))
    time = torch.arange(len(moved)) / FPS
    step = _step(engine, moved)
    assert 0.0 <= step < 1.0 / (8 * FPS)
    torch.testing.assert_close(
        moved[..., 2].mean(1), -0.5 * G * time * (time + step), rtol=1e-4, atol=1e-5, check_dtype=False
    )
    torch.testing.assert_close(moved - moved.mean(1, keepdim=True), (rest - rest.mean(0)).expand_as(moved))


def _step(engine: Any, moved: Tensor) -> float:
    """Seconds of a substep: as the engine is set, or else as the end of a free fall tells."""
    if hasattr(engine, "substeps") or hasattr(engine, "quality"):
        return 1.0 / (FPS * (engine.substeps if hasattr(engine, "substeps") else engine.quality))
    fallen, seconds = -float(moved[-1, :, 2].mean()), (len(moved) - 1) / FPS
    return 2.0 * fallen / (G * seconds) - seconds


def test_a_sheet_that_is_held_along_an_edge_swings_and_gains_no_energy(engine: Any) -> None:
    """It starts at rest, flat and level, with no energy at all; stretch and bend are counted.

    Four times as many frames as usual, or the turning point is faster than differences of frames say.
    """
    finer = {"substeps": engine.substeps // 4} if hasattr(engine, "substeps") else {}
    found = swing(replace(engine, fabric=VACUUM, **finer), fps=4 * FPS)
    (low_at, low), (high_at, high) = found.low, found.high
    assert low_at == pytest.approx(LOW[0], rel=0.1)
    assert low_at == pytest.approx(0.28, rel=0.1)
    assert high_at == pytest.approx(HIGH[0], rel=0.1)
    assert low == pytest.approx(LOW[1], rel=0.1)
    assert high - low == pytest.approx(HIGH[1] - LOW[1], rel=0.15)
    held = energy(found, VACUUM)
    assert held.abs()[:2].max() < 0.02 * G * 0.15
    assert held.max() < 0.05 * G * 0.15
    assert torch.diff(held).max() < 0.05 * G * 0.15


def test_a_hanging_strip_has_the_period_of_a_rope(engine: Any) -> None:
    period, left = rope_period(engine)
    assert period == pytest.approx(rope_theory(), rel=0.05)
    assert left > 0.8, "the swing is damped"


def test_a_strip_of_the_fabric_hangs_at_most_three_percent_longer(engine: Any) -> None:
    assert 0.0 < sag(replace(engine, fabric=replace(LIMP, poisson=0.0)), 0.5) < 0.03


@pytest.mark.cannot("blender", "0.85 of the closed form where a strip has three vertices across")
def test_a_strip_of_the_fabric_hangs_by_its_weight_over_its_stiffness_longer(engine: Any) -> None:
    limp = replace(LIMP, poisson=0.0)
    assert sag(replace(engine, fabric=limp), 0.5) == pytest.approx(sag_theory(limp, 0.5), rel=0.1)


@pytest.mark.cannot("blender", "0.85 of the closed form on five edges, 0.92 to 1.02 on finer meshes")
def test_a_converged_strip_stretches_by_its_weight_over_its_stiffness(engine: Any) -> None:
    """Five edges of fabric that its own weight stretches."""
    soft = replace(LIMP, poisson=0.0, stretch=20.0)
    found = sag(replace(engine, fabric=soft), 0.2, edge=0.04, seconds=0.6)
    assert found == pytest.approx(sag_theory(soft, 0.2), rel=0.1)


@pytest.mark.cannot("blender", "its air slows any motion, whichever way a face looks")
def test_air_slows_what_moves_along_its_normal(engine: Any) -> None:
    """A level sheet falls towards its terminal speed, one on edge falls on freely."""
    fabric = Fabric()
    rest, faces = sheet(0.1, 0.1, 4, 4)
    terminal = math.sqrt(2 * fabric.density * G / (1.2 * fabric.drag))
    level = play(engine, scene(rest, faces, 1.0))
    expected = -(terminal**2) / G * math.log(math.cosh(G / terminal))
    assert float(level[-1, :, 2].mean()) == pytest.approx(expected, rel=0.02)
    on_edge = torch.stack([rest[:, 2], rest[:, 1], rest[:, 0]], dim=1)
    edgewise = play(engine, scene(on_edge, faces, 1.0))
    fallen = (edgewise[-1] - on_edge)[:, 2].mean()
    assert float(fallen) == pytest.approx(-0.5 * G, rel=0.02)
