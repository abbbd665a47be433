"""Cloth moves as physics says: it falls, swings, hangs and keeps its energy."""

import math
from dataclasses import replace

import pytest
import torch
from scipy.special import j0
from torch import Tensor

from tests.simulate.physics.scenes import FPS, G, play, scene, sheet, turning_points
from uvcloth.simulate.fabric import Fabric

newton = pytest.importorskip("uvcloth.simulate.newton", reason="the `simulate` extra is not installed")
pytest.importorskip("newton", reason="the `simulate` extra is not installed")

VACUUM = Fabric(drag=0.0)

LOW = (0.257, -0.287)
HIGH = (0.538, -0.057)
"""When (s) and where (m) the rim of the sheet below turns round, converged: 60 substeps x 30 iterations."""

ROPE = 2.4048 / 2
"""First zero of the Bessel function J0, halved: a hanging rope's first mode has this times sqrt(g / L)."""


def swing(engine: object) -> tuple[Tensor, Tensor]:
    """A sheet of 0.3 m, held along one edge and let go from level: (F, N, 3), and which vertices are its rim."""
    vertices, faces = sheet(0.3, 0.3, 12, 12)
    moved = play(engine, scene(vertices, faces, 0.8, held=vertices[:, 0] < 1e-6))
    return moved, vertices[:, 0] > 0.3 - 1e-6


def test_a_sheet_falls_freely() -> None:
    engine = newton.Newton(fabric=VACUUM)
    vertices, faces = sheet(0.2, 0.2, 6, 6)
    moved = play(engine, scene(vertices, faces, 0.3))
    steps = engine.substeps * torch.arange(len(moved))
    step = 1.0 / (FPS * engine.substeps)
    expected = -0.5 * G * step**2 * steps * (steps + 1)
    torch.testing.assert_close(moved[..., 2].mean(1), expected, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(
        moved - moved.mean(1, keepdim=True), (vertices - vertices.mean(0)).expand_as(moved)
    )


def test_a_sheet_that_is_held_along_an_edge_swings() -> None:
    moved, rim = swing(newton.Newton(fabric=VACUUM))
    (low_at, low), (high_at, high) = turning_points(moved[:, rim, 2].mean(1))
    assert low_at == pytest.approx(LOW[0], rel=0.1)
    assert low_at == pytest.approx(0.28, rel=0.1)
    assert high_at == pytest.approx(HIGH[0], rel=0.1)
    assert low == pytest.approx(LOW[1], rel=0.1)
    assert high - low == pytest.approx(HIGH[1] - LOW[1], rel=0.15)


def test_its_energy_never_rises() -> None:
    """Height and speed alone: what stretching and bending hold is not negative, and none at the start."""
    moved, _ = swing(newton.Newton(fabric=VACUUM))
    speed = (moved[2:] - moved[:-2]) * FPS / 2
    energy = G * moved[1:-1, :, 2].mean(1) + 0.5 * speed.square().sum(-1).mean(1)
    assert energy.max() < 0.02 * G * 0.3


def test_a_hanging_strip_has_the_period_of_a_rope() -> None:
    length = 0.5
    vertices, faces = sheet(length, 0.054, 28, 4)
    below = vertices[:, 0]
    side = (
        0.03 * torch.from_numpy(j0(2 * ROPE * torch.sqrt((length - below) / length).double().numpy())).float()
    )
    hanging = torch.stack([side, vertices[:, 1], -below], dim=1)
    fabric = replace(VACUUM, bend=1e-7)
    moved = play(newton.Newton(fabric=fabric), scene(hanging, faces, 2.2, held=below < 1e-6))
    end = moved[:, below > length - 1e-6, 0].mean(1)
    crossed = torch.nonzero(end[1:] * end[:-1] < 0).squeeze(1)
    times = (crossed + end[crossed] / (end[crossed] - end[crossed + 1])) / FPS
    period = 2 * float(times[-1] - times[0]) / (len(times) - 1)
    assert period == pytest.approx(2 * math.pi / (ROPE * math.sqrt(G / length)), rel=0.05)
    assert end[-25:].abs().max() > 0.8 * 0.03, "the swing is damped"


@pytest.mark.parametrize(("engine", "allowed"), [("converged", 1.1), ("as it makes data", None)])
def test_a_strip_stretches_under_its_weight(engine: str, allowed: float | None) -> None:
    """The end of a strip sinks by w L^2 / 2 k; cut short, the solver lets half a metre stretch 3 % at most."""
    length = 0.2 if allowed else 0.5
    fabric = replace(VACUUM, bend=1e-7, poisson=0.0, stretch=20.0 if allowed else VACUUM.stretch)
    settings = newton.Newton(fabric=fabric)
    if allowed:
        settings = replace(settings, substeps=30, iterations=40)
    vertices, faces = sheet(length, 0.036, round(length / 0.018) + 1, 3)
    hanging = torch.stack([torch.zeros(len(vertices)), vertices[:, 1], -vertices[:, 0]], dim=1)
    moved = play(settings, scene(hanging, faces, 2.0, held=vertices[:, 0] < 1e-6))
    end = -moved[30:, vertices[:, 0] > length - 1e-6, 2].mean()
    sinks = fabric.density * G * length**2 / (2 * fabric.stretch)
    if allowed:
        assert float(end) - length == pytest.approx(sinks, rel=0.1)
    else:
        assert float(end) < 1.03 * length


def test_air_slows_what_moves_along_its_normal() -> None:
    """A level sheet falls towards its terminal speed, one on edge falls on freely."""
    fabric = Fabric()
    vertices, faces = sheet(0.1, 0.1, 4, 4)
    terminal = math.sqrt(2 * fabric.density * G / (1.2 * fabric.drag))
    level = play(newton.Newton(), scene(vertices, faces, 1.0))
    expected = -(terminal**2) / G * math.log(math.cosh(G / terminal))
    assert float(level[-1, :, 2].mean()) == pytest.approx(expected, rel=0.02)
    on_edge = torch.stack([vertices[:, 2], vertices[:, 1], vertices[:, 0]], dim=1)
    edgewise = play(newton.Newton(), scene(on_edge, faces, 1.0))
    fallen = (edgewise[-1] - on_edge)[:, 2].mean()
    assert float(fallen) == pytest.approx(-0.5 * G, rel=0.02)
