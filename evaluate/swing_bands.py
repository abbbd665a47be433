"""Swing by bands of frequency: power of the cloth's motion relative to the skinned garment, and of the truth.

A drift, a sway, a flutter and a tremble are apart there, where one figure is that of the largest.
"""

import numpy as np
import torch
from scipy.signal import csd
from torch import Tensor

from .metrics import Reference, swing_velocities

BANDS = ((0, 1), (1, 3), (3, 8), (8, 15))
"""Lowest and highest frequency of each band, Hz."""

SEGMENT_SECONDS = 2.0
"""Approximate length of the segments whose spectra are averaged (Welch 1967); they overlap by half."""

NOISE_BANDWIDTH = 1.5
"""Equivalent noise bandwidth of a Hann window, as a multiple of the distance of two frequencies."""


def band_scores(vertices: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Power of `swing_velocities` in each of the BANDS times frames, mm2 per frame2: (1, B).

    band_square, true_band_square: of (F, N, 3) and of the simulation. band_product: of both, the real part of
    the cross spectrum. Not a number for a band that the window cannot measure: narrower than the noise
    bandwidth of its segments, as 0-1 Hz in less than 1.5 s, or above half the frame rate. Nothing for fewer
    than four frames.
    """
    if len(vertices) < 4:
        return {}
    velocities, truth = (
        swing_velocity.double().flatten(1).numpy() for swing_velocity in swing_velocities(vertices, reference)
    )
    count, fps = len(velocities), reference.fps
    segments = max(1, round(2.0 * count / (fps * SEGMENT_SECONDS) - 1.0))
    length = 2 * count // (segments + 1)
    setting = {"fs": fps, "nperseg": length, "detrend": False, "axis": 0}
    pairs = {
        "band_square": (velocities, velocities),
        "true_band_square": (truth, truth),
        "band_product": (velocities, truth),
    }
    scores = {}
    for key, (one, other) in pairs.items():
        frequencies, spectrum = csd(one, other, **setting)
        power = spectrum.real.sum(1) * fps / length * count
        scores[key] = torch.tensor([[_band(frequencies, power, *band, fps, length) for band in BANDS]])
    return scores


def _band(
    frequencies: np.ndarray, power: np.ndarray, low: float, high: float, fps: float, length: int
) -> float:
    """Sum of a power spectrum over a band, not a number where it cannot be measured."""
    resolved = (high - low) * length >= NOISE_BANDWIDTH * fps and low < 0.5 * fps
    inside = (frequencies >= low) & ((frequencies < high) | (high >= BANDS[-1][1]))
    return float(power[inside].sum()) if resolved else float("nan")
