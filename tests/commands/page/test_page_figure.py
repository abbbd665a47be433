"""The page of `uvcloth page`: the figure is moved by hand."""

from pathlib import Path

import numpy as np
import pytest

from tests.commands.chromium import Chromium
from tests.commands.page.opened import (
    MARK,
    PAUSE,
    SAID,
    SETTLED,
    WATCH,
    drag,
    needs_browser,
    needs_wasm,
    open_page,
    point,
)
from uvcloth.player.baked import open_baked

FOOT = """(() => {
  const { figure } = uvcloth.playback;
  const joints = ["right_foot", "right_toes"].map((role) => figure.joints[role]);
  return joints.map((joint) => joint.matrixWorld.elements[13] - figure.floorOf(joint));
})()"""
"""Heights of the right foot and its toes over where they are on a figure that stands, m."""


def open_paused(browser: Chromium, address: str) -> None:
    """Open a page, pause it, watch what moves fastest, and wait until it has settled."""
    open_page(browser, address)
    browser.value(f"{PAUSE}; {WATCH}")
    browser.wait_for(SETTLED)


@needs_wasm
@needs_browser
@pytest.mark.parametrize(
    ("part", "way"),
    [("left_hand", (50.0, -80.0)), ("right_foot", (-60.0, -40.0)), ("hips", (-60.0, 50.0))],
)
def test_a_part_that_is_dragged_comes_to_the_pointer_and_stays_in_a_pause(
    browser: Chromium, address: str, part: str, way: tuple[float, float]
) -> None:
    open_paused(browser, address)
    time, before = browser.value("uvcloth.playback.time"), browser.value(MARK % part)
    drag(browser, part, way)
    browser.wait_for("most.frames > 24")
    after = browser.value(MARK % part)
    assert np.hypot(after[0] - before[0] - way[0], after[1] - before[1] - way[1]) < 6.0
    point(browser, "Released", *after[:2])
    browser.wait_for(SETTLED)
    assert browser.value("uvcloth.playback.time") == time
    np.testing.assert_allclose(browser.value(MARK % part)[2:], after[2:], atol=0.01)
    # No body is this fast, and cloth has followed.
    most = browser.value("most")
    assert 0.1 < most["joint"] < 4.0
    assert 0.1 < most["cloth"] < 8.0
    assert browser.value("document.getElementById('message').textContent") == ""
    assert browser.errors == []


@needs_wasm
@needs_browser
def test_a_foot_does_not_go_through_the_floor(browser: Chromium, address: str) -> None:
    open_paused(browser, address)
    before = browser.value(FOOT)
    drag(browser, "right_foot", (40.0, 150.0))
    browser.wait_for("most.frames > 30")
    after, side = browser.value(FOOT), browser.value(MARK % "right_foot")
    for was, is_now in zip(before, after, strict=True):
        assert is_now > min(was, 0.0) - 0.005
    # It goes sideways along the floor nevertheless.
    point(browser, "Moved", side[0] - 60.0, side[1] + 150.0)
    browser.wait_for("most.frames > 60")
    assert browser.value(MARK % "right_foot")[2] < side[2] - 0.05
    assert min(browser.value(FOOT)) > min(*before, 0.0) - 0.005
    assert browser.errors == []


@needs_wasm
@needs_browser
def test_keys_move_a_part(browser: Chromium, address: str) -> None:
    open_paused(browser, address)
    before = browser.value(MARK % "left_hand")
    browser.value("document.querySelector('.grip[aria-label=\"left hand\"]').focus()")
    for _ in range(8):
        press(browser, "ArrowUp")
    assert browser.value("uvcloth.playback.motion.grip?.part") == "left_hand"
    browser.wait_for("most.frames > 24")
    # Eight steps of 0.015 heights, upwards as it is shown.
    after, height = browser.value(MARK % "left_hand"), browser.value("uvcloth.playback.figure.height")
    assert after[3] - before[3] == pytest.approx(8 * 0.015 * height, rel=0.2)
    press(browser, "Escape")
    assert not browser.value("Boolean(uvcloth.playback.motion.grip)")
    # In a pause it stays, and one that loses the focus is let go too.
    press(browser, "ArrowLeft")
    assert browser.value("Boolean(uvcloth.playback.motion.grip)")
    browser.value("document.activeElement.blur()")
    assert not browser.value("Boolean(uvcloth.playback.motion.grip)")
    assert browser.errors == []


def press(browser: Chromium, key: str) -> None:
    """Press a key and let it go."""
    for kind in ("keyDown", "keyUp"):
        browser.call("Input.dispatchKeyEvent", type=kind, key=key, code=key)


@needs_wasm
@needs_browser
def test_a_figure_out_of_reach_is_dragged_along_as_a_whole(browser: Chromium, address: str) -> None:
    open_page(browser, address)
    browser.value(PAUSE)
    before = {part: browser.value(MARK % part)[2] for part in ("hips", "left_foot", "right_foot")}
    drag(browser, "hips", (-250.0, 0.0))
    browser.wait_for("uvcloth.playback.next > 60")
    for part, place in before.items():
        assert browser.value(MARK % part)[2] < place - 0.3
    assert browser.errors == []


@needs_wasm
@needs_browser
def test_a_figure_that_is_held_goes_through_the_end_of_its_animation(browser: Chromium, address: str) -> None:
    open_page(browser, address)
    drag(browser, "hips", (-120.0, 20.0))
    browser.value(f"{WATCH}; uvcloth.playback.goTo(uvcloth.playback.clip, uvcloth.playback.last - 0.1)")
    browser.wait_for("most.frames > 30 && uvcloth.playback.time < uvcloth.playback.last / 2")
    point(browser, "Released", 300.0, 300.0)
    # A figure that is set back by the way that it was dragged is at 16 m/s.
    assert browser.value("most.joint") < 11.0
    assert browser.value(SAID) == ""
    assert browser.errors == []


@needs_wasm
@needs_browser
def test_a_figure_that_is_let_go_returns_into_its_animation(
    browser: Chromium, address: str, skirt: Path
) -> None:
    open_page(browser, address)
    browser.value(WATCH)
    drag(browser, "right_hand", (-60.0, -150.0))
    browser.wait_for("most.frames > 20")
    point(browser, "Released", 300.0, 300.0)
    browser.wait_for("!uvcloth.playback.motion.transition")
    shown = browser.value(
        """new Promise((done) => {
          uvcloth.playback.onFrame = ({ time, joints }) =>
            uvcloth.playback.motion.transition || done({ frame: Math.round(time * 30), joints: [...joints] });
        })"""
    )
    expected = open_baked(skirt).motion(fps=30.0).transforms[shown["frame"]]
    joints = np.reshape(shown["joints"], (-1, 3, 4))
    # The figure may have been moved and turned on the floor, all else is the animation's.
    turned = joints[0, :, :3] @ expected[0, :, :3].T
    np.testing.assert_allclose(turned[2], [0, 0, 1], atol=1e-5)
    np.testing.assert_allclose(joints[:, :, :3], turned @ expected[:, :, :3], atol=1e-5)
    assert browser.value("most.joint") < 12.0
    assert browser.errors == []
