"""The page of a baked skirt in a browser: scripts that read and steer it."""

import pytest

from tests.commands.chromium import PROGRAM, Chromium
from uvcloth.commands.run.page import WASM

needs_wasm = pytest.mark.skipif(
    not WASM.is_file(), reason="the runtime for WebAssembly is not compiled: make wasm"
)

needs_browser = pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")

FRAMES = 10

MILLIMETRE = 1e-3

PLAYING = "Boolean(globalThis.uvcloth?.playback.shown > 0.1)"

PAUSE = "document.getElementById('play').click()"

SETTLED = """(({ motion, settling, clock, next }) =>
  !motion.grip && settling === 0 && clock === next - 1)(uvcloth.playback)"""

SAID = "document.getElementById('message').textContent"

WATCH = """(() => {
  const { playback } = uvcloth, { figure } = playback, old = playback.onFrame;
  const most = globalThis.most = { frames: 0, joint: 0, cloth: 0 };
  const place = (bone) => bone.getWorldPosition(bone.position.clone());
  let joints, vertices;
  playback.onFrame = (frame) => {
    old(frame);
    figure.write(frame.pose);
    const now = figure.cloth.bones.map(place), way = (point, index) => point.distanceTo(joints[index]) * 30;
    if (joints) most.joint = Math.max(most.joint, ...now.map(way));
    frame.vertices[0].forEach((x, i) => {
      if (vertices) most.cloth = Math.max(most.cloth, Math.abs(x - vertices[i]) * 30);
    });
    [joints, vertices] = [now, frame.vertices[0]];
    most.frames++;
  };
})()"""
"""Note the largest speeds, m/s, of joints and, along an axis, of cloth."""

MARK = """(() => {
  const { mesh } = uvcloth.hand.marks.find(({ part }) => part === "%s");
  return [...uvcloth.stage.onPage(mesh.position), ...mesh.position];
})()"""

DROP = """(async () => {
  const file = new File([await (await fetch("%s")).arrayBuffer()], "%s");
  const data = new DataTransfer();
  data.items.add(file);
  dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true }));
})()"""


def open_page(browser: Chromium, address: str) -> None:
    """Open a page and wait until it plays, without shadows, which take longest without a graphics card."""
    browser.open(address)
    browser.wait_for("Boolean(globalThis.uvcloth)")
    browser.value("uvcloth.stage.light.castShadow = false")
    browser.wait_for(PLAYING)


def point(browser: Chromium, kind: str, x: float, y: float) -> None:
    """Press, move or release the mouse."""
    browser.call(
        "Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, button="left", buttons=1, clickCount=1
    )


def drag(browser: Chromium, part: str, way: tuple[float, float]) -> None:
    """Take a part of the figure and drag it by pixels, without letting go."""
    x, y = browser.value(MARK % part)[:2]
    point(browser, "Pressed", x, y)
    assert browser.value("uvcloth.playback.motion.grip?.part") == part
    for share in (0.5, 1.0):
        point(browser, "Moved", x + share * way[0], y + share * way[1])
