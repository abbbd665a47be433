"""The live view as Chromium shows it: the simulation beside the prediction, and the heat map of its error."""

import colorsys
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.small_body import small_body
from uvcloth.geometry.mesh import Mesh
from uvcloth.rendering.render import GARMENT_COLORS
from uvcloth.rollouts.rollout import RolloutFrame
from uvcloth.view.computation import Computation, Performance
from uvcloth.view.heat import COLORS, ERROR
from uvcloth.view.viewer import Viewer

pytest.importorskip("viser", reason="viser is not installed")
browser = pytest.importorskip("tests.view.browser", reason="websockets or Pillow is not installed")

APART = 0.03
"""Metres between predicted and simulated cloth: band 5 of 9, which end at 50 mm."""


def standing() -> Performance:
    """A shell that stands still around the small body; the simulation has it elsewhere."""
    body = small_body()
    mesh = Mesh(1.2 * body.mesh.vertices, body.mesh.faces, body.mesh.uvs, body.mesh.face_uvs)
    still = torch.eye(3, 4).repeat(len(body.skeleton.names), 1, 1)

    def frames() -> Iterator[RolloutFrame]:
        yield RolloutFrame(0, (mesh.vertices,), (mesh.vertices,), still, body.mesh.vertices, {})

    truth = (mesh.vertices + torch.tensor([0.0, APART, 0.0]))[None]
    return Performance("standing", body, [mesh], 1, 30.0, frames(), truth)


def alike(picture: np.ndarray, color: tuple[float, float, float]) -> np.ndarray:
    """Which pixels (h, w) have the hue of a color (0 to 1) and some saturation, however they are lit."""
    channels = picture.astype(float) / 255
    greatest, least = channels.max(-1), channels.min(-1)
    spread = np.maximum(greatest - least, 1e-6)
    red, green, blue = (channels - least[..., None]).transpose(2, 0, 1) / spread
    hue = np.select([red >= 1, green >= 1], [(green - blue) % 6, blue - red + 2], red - green + 4) / 6
    near = np.abs((hue - colorsys.rgb_to_hsv(*color)[0] + 0.5) % 1 - 0.5) < 0.04
    return near & (spread > 0.15)


def picture_when(page: "browser.Page", ready: Callable[[np.ndarray], bool]) -> np.ndarray:
    """The first picture that is as wanted, two minutes at most."""
    deadline = time.monotonic() + 120
    while not ready(picture := page.picture()):
        assert time.monotonic() < deadline, "the page never came there"
        time.sleep(0.5)
    return picture


def test_a_browser_shows_simulation_and_error_beside_each_other(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    viewer = Viewer(port=port)
    viewer.show(Computation(standing).start())
    viewer._heat.value = ERROR.label
    ticking = threading.Thread(target=viewer.run, daemon=True)
    ticking.start()
    band = tuple(channel / 255 for channel in COLORS[5])
    try:
        with browser.opened(viewer.address, tmp_path / "profile") as page:
            left = slice(0, browser.SIZE[0] * 5 // 8)  # The panel is on the right.
            picture = picture_when(page, lambda seen: alike(seen[:, left], band).sum() > 300)[:, left]
            predicted, simulated = (alike(picture, color).nonzero()[1] for color in (band, GARMENT_COLORS[0]))
            assert len(simulated) > 300
            assert simulated.mean() < predicted.mean()
    finally:
        viewer.close()
        ticking.join()
