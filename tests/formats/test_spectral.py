"""The lossy transform: how near points stay, and that every machine finds the same spectrum."""

import threading
import time

import numpy as np
import pytest
from scipy.linalg import eigh

from tests.formats.test_moving import FACES, GRID, waving
from uvcloth.formats.spectral import (
    MOST_OF_99,
    MOST_OF_ALL,
    CodedPoints,
    Patch,
    code_points,
    decode_points,
    part_spectra,
    second_half,
)

COUNT = len(GRID)


def sheet(side: int) -> np.ndarray:
    """Faces of a square sheet of side times side points."""
    place = np.arange(side * side).reshape(side, side)
    corners = place[:-1, :-1], place[1:, :-1], place[:-1, 1:], place[1:, 1:]
    first, second, third, fourth = (corner.reshape(-1) for corner in corners)
    return np.concatenate([np.stack([first, second, third], 1), np.stack([second, fourth, third], 1)])


def spectrum_of(faces: np.ndarray, count: int) -> np.ndarray:
    """Spectrum of a mesh that is not divided."""
    (whole,) = part_spectra(faces, np.zeros(count, bool))
    return whole.waves


def parts_of(faces: np.ndarray, count: int) -> tuple[Patch, ...]:
    return part_spectra(faces, second_half(faces, count))


@pytest.mark.parametrize("error", [1e-3, 5e-5])
@pytest.mark.parametrize("frames", [1, 2, 3, 90])
def test_errors_are_those_that_are_allowed(frames: int, error: float) -> None:
    points, parts = waving(frames, 2.0), parts_of(FACES, COUNT)
    # One point jumps for a frame, as in an armpit.
    points[frames // 2, 7] += 0.05
    coded = code_points(points, parts, error)
    off = np.linalg.norm(decode_points(coded, parts, error, frames, COUNT) - points, axis=-1)
    assert 0 < off.mean() <= error
    assert np.percentile(off, 99) <= MOST_OF_99 * error
    assert off.max() <= MOST_OF_ALL * error


def test_steps_are_as_coarse_as_is_allowed() -> None:
    points, parts = waving(90, 2.0), parts_of(FACES, COUNT)
    fine, coarse = (code_points(points, parts, error) for error in (1e-4, 1e-3))
    assert fine.step < coarse.step / 2
    assert len(coarse.code) < 0.6 * len(fine.code)
    still = np.broadcast_to(points[:1], points.shape)
    assert len(code_points(still, parts, 1e-3).code) < len(coarse.code) / 4


def test_a_jump_is_corrected_rather_than_spread() -> None:
    points, parts = waving(90, 0.0), parts_of(FACES, COUNT)
    assert len(code_points(points, parts, 5e-3).gaps) == 0
    points[40, 11] += 0.1
    coded = code_points(points, parts, 5e-3)
    assert coded.gaps.tolist() == [40 * COUNT + 11]


def test_a_spectrum_is_orthonormal_and_long_waves_come_first() -> None:
    spectrum = spectrum_of(FACES, COUNT)
    np.testing.assert_allclose(spectrum.T @ spectrum, np.eye(COUNT), atol=1e-12)
    edges = np.concatenate([FACES[:, [0, 1]], FACES[:, [1, 2]], FACES[:, [2, 0]]])
    changes = np.square(spectrum[edges[:, 0]] - spectrum[edges[:, 1]]).sum(0)
    assert changes[0] < 1e-4
    assert changes[:5].max() < changes[-5:].min() / 5


def test_halves_are_of_one_size_and_hang_together() -> None:
    faces = sheet(12)
    second = second_half(faces, 144)
    assert second.sum() == 72
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert (second[edges[:, 0]] != second[edges[:, 1]]).sum() < 80
    assert np.array_equal(second, second_half(faces, 144))
    first, other = part_spectra(faces, second)
    assert np.array_equal(np.sort(np.concatenate([first.points, other.points])), np.arange(144))
    np.testing.assert_allclose(other.waves.T @ other.waves, np.eye(72), atol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_points_without_faces_are_coded_too(count: int) -> None:
    faces = np.zeros((0, 3), np.int64)
    parts, points = parts_of(faces, count), waving(30, 1.0)[:, :count]
    again = decode_points(code_points(points, parts, 1e-3), parts, 1e-3, 30, count)
    assert np.linalg.norm(again - points, axis=-1).mean() <= 1e-3


@pytest.mark.parametrize("driver", ["ev", "evr", "evx"])
def test_another_solver_finds_the_same_spectrum(driver: str, monkeypatch) -> None:
    """On a symmetric sheet, of which an even Laplacian has pairs of equal eigenvalues."""
    faces = sheet(12)
    expected = spectrum_of(faces, 146)
    monkeypatch.setattr("numpy.linalg.eigh", lambda matrix: eigh(matrix, driver=driver))
    np.testing.assert_allclose(spectrum_of(faces, 146), expected, atol=1e-9)


def test_other_threads_go_on_while_a_spectrum_is_computed() -> None:
    """One of them ends the process soon after Ctrl-C, see `uvcloth.process.interruption`."""
    ticks, done = [time.perf_counter()], threading.Event()

    def tick() -> None:
        while not done.wait(0.01):
            ticks.append(time.perf_counter())

    thread = threading.Thread(target=tick)
    thread.start()
    start = time.perf_counter()
    spectrum_of(sheet(30), 900)
    spent = time.perf_counter() - start
    done.set()
    thread.join()
    assert max(np.diff([*ticks, start + spent])) < 0.5 * spent


def test_what_does_not_fit_is_refused() -> None:
    parts = parts_of(FACES, COUNT)
    for value, words in ((np.nan, "not finite"), (np.inf, "not finite"), (1e7, "too far away")):
        points = waving(9, 0.1)
        points[4, 7, 1] = value
        with pytest.raises(ValueError, match=words):
            code_points(points, parts, 1e-3)
    coded = code_points(waving(9, 0.1), parts, 1e-3)
    with pytest.raises(ValueError, match="to other numbers"):
        decode_points(coded, parts, 1e-3, 8, COUNT)
    wrong = CodedPoints(coded.step, coded.code, np.array([9 * COUNT]), np.zeros((1, 3), np.int64))
    with pytest.raises(ValueError, match="corrections belong to other points"):
        decode_points(wrong, parts, 1e-3, 9, COUNT)
