"""The lossy transform: how near points stay, and that every machine finds the same spectrum."""

import numpy as np
import pytest
from scipy.linalg import eigh

from rasterize import spectral
from rasterize.spectral import STEP, compress, decompress, mesh_spectrum, to_planes
from tests.rasterize.test_moving import FACES, GRID, waving

COUNT = len(GRID)


@pytest.mark.parametrize("frames", [1, 2, 3, 90])
def test_errors_are_those_of_rounding(frames: int) -> None:
    points, spectrum = waving(frames, 2.0), mesh_spectrum(FACES, COUNT)
    again = decompress(compress(points, spectrum), spectrum)
    # An orthonormal transform keeps the sum of squares; each coefficient is off by half a step at most.
    off = again - points
    assert 0 < np.sqrt(np.square(off).mean()) < STEP / 2
    fine = decompress(compress(points, spectrum, 1e-5), spectrum, 1e-5)
    np.testing.assert_allclose(fine, points, atol=2e-5 * np.sqrt(frames * COUNT))


def test_a_spectrum_is_orthonormal_and_long_waves_come_first() -> None:
    spectrum = mesh_spectrum(FACES, COUNT)
    np.testing.assert_allclose(spectrum.T @ spectrum, np.eye(COUNT), atol=1e-12)
    edges = np.concatenate([FACES[:, [0, 1]], FACES[:, [1, 2]], FACES[:, [2, 0]]])
    changes = np.square(spectrum[edges[:, 0]] - spectrum[edges[:, 1]]).sum(0)
    assert changes[0] < 1e-4
    assert changes[:5].max() < changes[-5:].min() / 5


@pytest.mark.parametrize("driver", ["ev", "evd", "evx"])
def test_another_solver_finds_the_same_spectrum(driver: str, monkeypatch) -> None:
    """On a symmetric sheet, of which an even Laplacian has pairs of equal eigenvalues."""
    side = np.arange(144).reshape(12, 12)
    corners = side[:-1, :-1], side[1:, :-1], side[:-1, 1:], side[1:, 1:]
    first, second, third, fourth = (corner.reshape(-1) for corner in corners)
    faces = np.concatenate([np.stack([first, second, third], 1), np.stack([second, fourth, third], 1)])
    expected = mesh_spectrum(faces, 146)
    monkeypatch.setattr(spectral, "eigh", lambda matrix, **_: eigh(matrix, driver=driver))
    np.testing.assert_allclose(mesh_spectrum(faces, 146), expected, atol=1e-9)


def test_smooth_motion_takes_few_coefficients() -> None:
    time, place = np.arange(120)[:, None] / 120, 0.1 * GRID[:, 0]
    sheet = np.stack([place + 0 * time, 0 * place + time, 0.1 * np.sin(time + place)], axis=-1)
    spectrum = mesh_spectrum(FACES, COUNT)
    assert (compress(sheet, spectrum)[0] > 0).mean() < 0.1


def test_what_does_not_fit_is_refused() -> None:
    spectrum = mesh_spectrum(FACES, COUNT)
    for value, words in ((np.nan, "not finite"), (np.inf, "not finite"), (1e6, "too far away")):
        points = waving(9, 0.1)
        points[4, 7, 1] = value
        with pytest.raises(ValueError, match=words):
            compress(points, spectrum)
    with pytest.raises(ValueError, match="too fast"):
        to_planes(np.array([2**23]))
