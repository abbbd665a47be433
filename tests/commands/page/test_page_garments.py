"""The page of `uvcloth page`: garments that are hidden are not simulated."""

from pathlib import Path

import numpy as np
import pytest

from tests.commands.chromium import Chromium
from tests.commands.page.opened import MILLIMETRE, needs_browser, needs_wasm, open_page
from uvcloth.commands.bake import Bake
from uvcloth.commands.page import Page
from uvcloth.commands.run.bake import bake
from uvcloth.commands.run.page import write_page
from uvcloth.motion.options import MotionOptions
from uvcloth.player.baked import open_baked
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.player.worn import without_others

BOX = "document.querySelectorAll('#garments input')[{}].click();"

WORN = """(({{ panes: [{{ source, garments }}], isStarting, frames }}) =>
  !isStarting && frames.length > 1 && source.worn.join() === "{}" &&
  garments.every(({{ node }}, place) => node.visible === ({}).includes(place)))(uvcloth.playback)"""
"""Whether the cloth of these garments moves and is shown, and no other."""

FIRST = """new Promise((done) => {
  const { playback } = uvcloth;
  playback.onFrame = ({ joints, vertices }) => {
    playback.onFrame = null;
    done({ joints: [...joints], vertices: vertices.map((each) => each && [...each]) });
  };
  playback.start(playback.clip, 0);
})"""


@pytest.fixture(scope="module")
def layers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shirt over trousers."""
    path = tmp_path_factory.mktemp("layers") / "layers.glb"
    motion = MotionOptions(frames="20:40")
    bake(Bake(("bottoms", "tops"), path, motion="walk", quality="fast", options=motion))
    return path


@needs_wasm
@needs_browser
def test_only_the_garments_that_are_shown_are_solved(
    browser: Chromium, folder: Path, address: str, layers: Path
) -> None:
    write_page(Page(folder / "layers", (layers,)))
    open_page(browser, address + "layers/")
    baked = open_baked(layers)
    # The outermost garment is the first box.
    browser.value(BOX.format(0))
    browser.wait_for(WORN.format("0", "[0]"))
    assert browser.value("document.getElementById('hidden').hidden")
    frame = browser.value(FIRST)
    assert frame["vertices"][1] is None
    cloth, joints = (
        Cloth(Outfit(without_others(baked.content, (0,)))),
        np.reshape(frame["joints"], (-1, 3, 4)),
    )
    cloth.start(joints)
    cloth.step(joints, 1.0 / 30.0)
    shown = np.reshape(frame["vertices"][0], (-1, 3))
    off = np.linalg.norm(shown - baked.in_scene(cloth.vertices(0)), axis=1) / MILLIMETRE
    assert off.mean() < 0.05
    # The other one alone, then both, before the former has come.
    browser.value(BOX.format(0) + BOX.format(1))
    browser.wait_for(WORN.format("1", "[1]"))
    browser.value(BOX.format(1) + BOX.format(0) + BOX.format(0))
    browser.wait_for(WORN.format("0,1", "[0, 1]"))
    # Without any garment there is no outfit: they are simulated on, and the page says so.
    browser.value(BOX.format(0) + BOX.format(1))
    browser.wait_for("!document.getElementById('hidden').hidden")
    assert browser.errors == []
