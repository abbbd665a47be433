"""Measures of motion and looks on made-up motion whose answer is known."""

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from benchmarks.measures import FPS, UP, moving, sheet, waving
from evaluate.after_stop import stop_scores
from evaluate.force_balance import MOST_FORCE, balanced_frames, force_balance, force_scores
from evaluate.hem import find_hem, hem_scores
from evaluate.look_fields import WAVES, look_fields
from evaluate.metrics import Reference, peak_accelerations, swing_velocities
from evaluate.surface import make_surface
from evaluate.swing_bands import BANDS, band_scores
from evaluate.wrinkles import wave_filters, wrinkle_scores
from uvcloth.geometry.units import GRAVITY
from uvcloth.physics.fabric import JERSEY


def bands(predicted: Tensor, truth: Tensor) -> dict[str, Any]:
    """Fields of bands of offsets against those of the simulation."""
    case = moving(truth)
    scores = {
        **band_scores(case.skinned + predicted, case),
        **{key: torch.zeros(1, 4) for key in ("wrinkle_mm2",)},
        "peak_acceleration": torch.zeros(0),
    }
    return look_fields([scores], [scores], ["clip"], "")


@pytest.mark.parametrize(("hertz", "band"), [(0.5, "0_1"), (2.0, "1_3"), (5.5, "3_8"), (11.0, "8_15")])
def test_a_swing_is_in_its_band_and_halved_there(hertz: float, band: str) -> None:
    """Half the amplitude beside an equal drift halves the ratio in one band only."""
    rest = sum(waving(other) for other in (0.5, 2.0, 5.5, 11.0) if other != hertz)
    assert isinstance(rest, Tensor)
    fields = bands(rest + waving(hertz, 0.01), rest + waving(hertz))
    for low, high in BANDS:
        expected = 0.5 if f"{low}_{high}" == band else 1.0
        assert fields[f"swing_ratio_{low}_{high}_hz"] == pytest.approx(expected, abs=0.08)


def test_a_delay_lowers_the_correlation_of_fast_bands_most() -> None:
    """By the cosine of its phase: 50 ms are a tenth of a turn at 2 Hz, and more than a quarter at 5.5 Hz."""
    delay = 0.05
    truth = waving(2.0) + waving(5.5)
    fields = bands(waving(2.0, delay=delay) + waving(5.5, delay=delay), truth)
    for hertz, band in ((2.0, "1_3"), (5.5, "3_8")):
        expected = math.cos(2 * math.pi * hertz * delay)
        assert fields[f"swing_correlation_{band}_hz"] == pytest.approx(expected, abs=0.05)
        assert fields[f"swing_ratio_{band}_hz"] == pytest.approx(1.0, abs=0.05)


def test_a_short_window_measures_no_slow_band_and_skinning_has_no_direction() -> None:
    short = bands(waving(5.5, frames=40), waving(5.5, frames=40))
    assert short["swing_ratio_0_1_hz"] is None
    assert short["swing_ratio_3_8_hz"] == pytest.approx(1.0)
    skinned = bands(0.0 * waving(2.0), waving(2.0))
    assert skinned["swing_ratio_1_3_hz"] == 0.0
    assert skinned["swing_correlation_1_3_hz"] is None
    assert band_scores(waving(2.0, frames=3).expand(-1, 441, -1), moving(waving(2.0, frames=3))) == {}


def test_the_bands_of_a_long_window_sum_to_its_motion() -> None:
    """So that a long window counts for more than a short one."""
    case = moving(waving(0.7, frames=150) + waving(2.0, frames=150) + waving(5.5, frames=150))
    velocities, _ = swing_velocities(case.vertices, case)
    total = float(velocities.square().sum())
    assert float(band_scores(case.vertices, case)["band_square"].sum()) == pytest.approx(total, rel=0.05)


def test_a_patch_has_its_width() -> None:
    """The average of x^2 around x = 0 is the variance."""
    rest, faces = sheet(41, 41)
    squares = (rest[:, :1] - 0.4).square().double()[None]
    averages = make_surface(rest, faces).diffusion(0.08)(squares)
    assert float(averages[0, 20 * 41 + 20]) == pytest.approx(0.08**2, rel=0.02)


@pytest.mark.parametrize(("wavelength", "band"), [(0.4, 0), (0.14, 1), (0.07, 2), (0.035, 3)])
def test_noise_of_one_wavelength_is_in_its_band(wavelength: float, band: int) -> None:
    rest, faces = sheet(81, 11, 0.01)
    wave = 0.01 * torch.cos(2 * torch.pi * rest[:, 0] / wavelength)
    case = Reference((rest + wave[:, None] * UP)[None], (), rest[None], rest, faces, FPS, None, None)
    squares = wrinkle_scores(wave_filters(make_surface(rest, faces)), case.vertices, case)["wrinkle_mm2"][0]
    assert squares.shape == (len(WAVES),)
    assert float(squares[band] / squares.sum()) > 0.75
    assert float(squares.sum()) == pytest.approx(50.0, rel=0.05)


def test_saw_teeth_and_a_swing_of_the_hem_have_their_size() -> None:
    """Every second vertex is 4 mm up: 4 mm from the middle of its neighbours, at the four corners more."""
    case = moving(torch.zeros(2, 1, 3))
    hem = find_hem(case.rest, case.faces)
    assert len(hem.here) == 4 * 20
    index = torch.arange(len(case.rest))
    teeth = 0.004 * ((index // 21 + index % 21) % 2)[:, None] * UP
    rough = hem_scores(hem, case.skinned + teeth, case)["hem_roughness_mm"]
    corner = math.hypot(4.0, 10.0 * 2**0.5)
    assert rough.tolist() == pytest.approx([(76 * 4.0 + 4 * corner) / 80] * 2, rel=1e-3)
    swung = moving(torch.tensor([0.0, 0.003])[:, None, None] * UP)
    assert hem_scores(hem, swung.vertices, swung)["hem_square"].tolist() == pytest.approx([9.0], rel=1e-3)


def test_a_spike_is_the_largest_acceleration() -> None:
    """One frame 5 mm up, of one vertex in a hundred: 2 x 5 mm x 900 / s2 in its middle."""
    spike = torch.zeros(9, 441, 3)
    spike[4, ::100, 2] = 0.005
    case = moving(torch.zeros(9, 1, 3))
    peaks = peak_accelerations(case.skinned + spike, case)
    assert peaks.tolist() == pytest.approx([0, 0, 4.5, 9.0, 4.5, 0, 0], abs=1e-3)


def test_energy_after_a_stop_and_the_time_to_settle() -> None:
    """A swing that decays by e in a second has a tenth of its energy after ln(10) / 2 seconds."""
    frames, walk = 90, 30
    seconds = (torch.arange(frames) - walk).clamp(min=0) / FPS
    swing = (
        0.05
        * torch.exp(-seconds)[:, None, None]
        * torch.stack([torch.sin(40 * seconds), torch.cos(40 * seconds), 0 * seconds], 1)[:, None]
    )
    case = moving(swing)
    walked = torch.arange(frames).clamp(max=walk)[:, None, None] * torch.tensor([0.03, 0.0, 0.0])
    case = replace(case, skinned=case.skinned + walked, vertices=case.vertices + walked)
    scores = stop_scores(case.vertices, case)
    assert len(scores["stop_energy"]) == frames - 1 - walk
    speed = FPS * float((swing[walk + 1] - swing[walk]).norm())
    assert float(scores["stop_energy"][0]) == pytest.approx(500.0 * speed**2, rel=1e-3)
    assert float(scores["settle_s"]) == pytest.approx(0.1 + math.log(10.0) / 2, abs=0.05)
    frozen = stop_scores(case.skinned, case)
    assert float(frozen["stop_energy"].max()) == float(frozen["settle_s"]) == 0.0
    assert stop_scores(case.vertices[:40], replace(case, skinned=case.skinned[:40])) == {}


def forces(offsets: Tensor, distance: float = 1.0) -> dict[str, Tensor]:
    """Unbalanced forces of a sheet that moves by offsets (F, 1 or N, 3), m, so far from the skin."""
    case = moving(offsets)
    frames = balanced_frames(len(offsets))
    balance = force_balance(make_surface(case.rest, case.faces), replace(JERSEY, drag=0.0))
    distances = torch.full((len(frames), len(case.rest)), distance)
    return force_scores(balance, case.vertices, frames, distances, FPS)


def test_cloth_that_falls_is_balanced_and_cloth_that_floats_lacks_its_weight() -> None:
    seconds = torch.arange(9) / FPS
    fall = forces(-0.5 * GRAVITY * seconds.square()[:, None, None] * UP)
    assert float(fall["force_median"].max()) < 0.05
    still = forces(torch.zeros(9, 1, 3))
    assert still["force_median"].tolist() == pytest.approx([GRAVITY] * 7, rel=1e-3)
    assert still["force_frame"].tolist() == [1, 2, 3, 4, 5, 6, 7]
    assert forces(torch.zeros(9, 1, 3), distance=0.0)["force_median"].isnan().all()
    assert len(balanced_frames(2)) == 0
    assert balanced_frames(150).tolist()[::19] == [1, 148]


def test_grain_hardly_unbalances_a_patch_but_a_jolt_does_and_its_frame_is_named() -> None:
    """A tenth of a millimetre at every vertex is over 20 m/s2 there, and little on a patch."""
    generator = torch.Generator().manual_seed(0)
    grain = 1e-4 * torch.randn(1, 441, 3, generator=generator).expand(9, -1, -1)
    rough = forces(grain)
    assert rough["force_median"].tolist() == pytest.approx([GRAVITY] * 7, rel=0.25)
    jolt = torch.zeros(9, 1, 3)
    jolt[4, 0, 0] = 0.05
    scores = forces(jolt)
    assert scores["force_median"][3] > 2 * 0.05 * FPS**2
    complete = {**scores, "wrinkle_mm2": torch.zeros(1, 4), "peak_acceleration": torch.zeros(0)}
    fields = look_fields([complete], [complete], ["02_03"], "")
    assert {each["frame"] for each in fields["impossible_frames"]} == {3, 4, 5}
    assert fields["impossible_frames"][0]["clip"] == "02_03"
    assert fields["impossible_frames"][0]["frame"] == 4
    assert fields["impossible_percent"] == pytest.approx(100 * 3 / 7)
    assert MOST_FORCE > GRAVITY
