"""The page of `uvcloth page`: cloth, its controls, and what is drawn over it."""

from pathlib import Path

import numpy as np
import pytest

from tests.commands.chromium import Chromium
from tests.commands.page.opened import (
    FRAMES,
    MILLIMETRE,
    PAUSE,
    PLAYING,
    SAID,
    SETTLED,
    WATCH,
    needs_browser,
    needs_wasm,
    open_page,
)
from uvcloth.commands.page import Page
from uvcloth.commands.run.page import write_page
from uvcloth.player.baked import open_baked
from uvcloth.player.outfit import Cloth, Outfit

RECORD = f"""new Promise((done) => {{
  const {{ playback }} = uvcloth, out = [];
  playback.onFrame = ({{ frame, joints, vertices }}) => {{
    out.push({{ frame, joints: [...joints], vertices: [...vertices[0]] }});
    if (out.length === {FRAMES}) done(out);
  }};
  playback.start(playback.clip, 0);
}})"""
"""Expression whose value is the first frames of the cloth, with the joints that it was given."""


def check_cloth(browser: Chromium, skirt: Path) -> None:
    """Compare the first frames of the page that is open with the native runtime's."""
    frames = browser.value(RECORD)
    assert [each["frame"] for each in frames] == list(range(FRAMES))
    joints = np.array([each["joints"] for each in frames]).reshape(FRAMES, -1, 3, 4)
    baked = open_baked(skirt)
    np.testing.assert_allclose(joints, baked.motion(fps=30.0).transforms[:FRAMES], atol=2e-6)
    cloth = Cloth(Outfit(baked.content))
    cloth.start(joints[0])
    off = []
    for each, transforms in zip(frames, joints, strict=True):
        cloth.step(transforms, 1.0 / 30.0)
        expected = baked.in_scene(cloth.vertices(0))
        off.append(np.linalg.norm(np.reshape(each["vertices"], (-1, 3)) - expected, axis=1) / MILLIMETRE)
    print("mm off, mean and largest:", *(f"{each.mean():.4f} {each.max():.3f}," for each in off))
    # Compilers round in other ways, and cloth has come to rest in 65 steps before the first frame.
    assert np.mean(off) < 0.05
    assert np.max(off[0]) < 1.0
    assert np.max(off) < 5.0
    assert browser.errors == []


@needs_wasm
@needs_browser
def test_the_cloth_of_a_folder_is_that_of_the_runtime(
    drawing_browser: Chromium, address: str, skirt: Path
) -> None:
    open_page(drawing_browser, address)
    check_cloth(drawing_browser, skirt)


@needs_wasm
@needs_browser
def test_the_cloth_of_a_single_file_is_that_of_the_runtime(
    browser: Chromium, single: Path, skirt: Path
) -> None:
    open_page(browser, single.as_uri())
    check_cloth(browser, skirt)


@needs_wasm
@needs_browser
def test_wrinkles_are_those_of_the_runtime(
    browser: Chromium, address: str, folder: Path, shirt: Path
) -> None:
    write_page(Page(folder / "wrinkles", (shirt,)))
    open_page(browser, f"{address}wrinkles/")
    check_cloth(browser, shirt)
    assert browser.value("uvcloth.cloth.garments[0].size") > 10_000


@needs_wasm
@needs_browser
def test_controls_change_the_cloth(browser: Chromium, address: str) -> None:
    open_page(browser, address)
    # Without gravity, in a gale, of silk: the hem rises.
    browser.value(
        """for (const [name, value] of [["wind-x", 12], ["gravity", 0], ["fabric", "0.08 50 2e-06"]]) {
          const control = document.getElementById(name);
          control.value = value;
          for (const kind of ["input", "change"]) control.dispatchEvent(new Event(kind));
        }"""
    )
    lowest = "Math.min(...uvcloth.cloth.garments[0].points.filter((_, i) => i % 3 === 1))"
    before = browser.value(lowest)
    browser.wait_for(f"{lowest} > {before} + 0.02")
    browser.value(PAUSE)
    browser.wait_for(SETTLED)
    time = browser.value("uvcloth.playback.time")
    browser.value("new Promise((done) => setTimeout(done, 300))")
    assert browser.value("uvcloth.playback.time") == time
    browser.value(
        "document.getElementById('time').value = 0.8;"
        "document.getElementById('time').dispatchEvent(new Event('input'))"
    )
    # The figure goes over to that time, and its cloth has come along.
    browser.wait_for("Math.abs(uvcloth.playback.time - 0.8) < 0.001 && !uvcloth.playback.motion.isMoving")
    browser.value(
        "document.getElementById('play').click();"
        "document.getElementById('animation').value = 1;"
        "document.getElementById('animation').dispatchEvent(new Event('change'))"
    )
    browser.wait_for(f"uvcloth.playback.clip.name === 'jump' && {PLAYING}")
    assert browser.value(SAID) == ""
    assert browser.errors == []


@needs_wasm
@needs_browser
@pytest.mark.parametrize(
    "act",
    [
        "uvcloth.playback.goTo(uvcloth.playback.clip, uvcloth.playback.last - 0.1)",
        "document.getElementById('animation').value = 1;"
        "document.getElementById('animation').dispatchEvent(new Event('change'))",
    ],
    ids=["the end of an animation", "another animation"],
)
def test_cloth_goes_through_without_a_cut(browser: Chromium, address: str, act: str) -> None:
    open_page(browser, address)
    browser.value(f"{WATCH}; globalThis.run = uvcloth.playback.run; {act}")
    browser.wait_for("most.frames > 40 && uvcloth.playback.time < uvcloth.playback.last / 2")
    browser.wait_for("!uvcloth.playback.motion.transition")
    assert browser.value("uvcloth.playback.run === run && !uvcloth.playback.isStarting")
    # In both animations joints are below 5 m/s; a cut is a joint at 30 m/s.
    most = browser.value("most")
    assert most["joint"] < 8.0
    assert most["cloth"] < 8.0
    assert browser.value(SAID) == ""
    assert browser.errors == []


@needs_wasm
@needs_browser
def test_garments_are_hidden_and_strain_and_cages_shown(browser: Chromium, address: str, skirt: Path) -> None:
    open_page(browser, address)
    browser.value(PAUSE)
    browser.wait_for(SETTLED)
    skin = """(() => {
      let sum = 0;
      uvcloth.stage.shown.traverse(({ name, geometry }) => {
        if (name === "body") for (const x of geometry.attributes.position.array) sum += Math.abs(x);
      });
      return sum;
    })()"""
    lowered = browser.value(skin)
    browser.value("document.querySelector('#garments input').click()")
    assert not browser.value("uvcloth.cloth.garments[0].isShown")
    assert browser.value(skin) != lowered
    browser.value("document.querySelector('#garments input').click()")
    assert browser.value(skin) == lowered
    layer = "document.getElementById('layer').value = '%s';" + (
        "document.getElementById('layer').dispatchEvent(new Event('change'))"
    )
    # Cloth that is a tenth larger than at rest has the colour between those of 5 and of 15 %.
    browser.value(layer % "strain")
    colours = browser.value(
        """(() => {
          const { points, rest, meshes } = uvcloth.cloth.garments[0];
          rest.forEach((x, i) => { points[i] = 1.1 * x; });
          uvcloth.overlays.strains[0].update();
          return [...meshes[0].geometry.attributes.color.array];
        })()"""
    )
    np.testing.assert_allclose(
        np.reshape(colours, (-1, 3)), [[0.8, 0.31, 0.035]] * (len(colours) // 3), atol=1e-3
    )
    browser.value(layer % "cage")
    browser.wait_for("uvcloth.overlays.cages[0]?.lines.geometry.attributes.position.array.some((x) => x)")
    lines = browser.value(
        """(({ index, attributes }) => [[...index.array], [...attributes.position.array]])(
          uvcloth.overlays.cages[0].lines.geometry)"""
    )
    outfit = Outfit(open_baked(skirt).content)
    faces = outfit.cage_faces()
    edges = {
        tuple(sorted(edge)) for face in faces.tolist() for edge in zip(face, face[1:] + face[:1], strict=True)
    }
    assert {tuple(edge) for edge in np.reshape(lines[0], (-1, 2)).tolist()} == edges
    places = np.reshape(lines[1], (-1, 3))
    assert len(places) == outfit.cages == faces.max() + 1
    lengths = np.linalg.norm(np.diff(places[np.array(sorted(edges))], axis=1), axis=2)
    assert 0.002 < lengths.min() < lengths.max() < 0.2
    assert "ms per frame of cloth" in browser.value("document.getElementById('milliseconds').textContent")
    assert browser.errors == []


@needs_wasm
@needs_browser
def test_a_machine_that_is_too_slow_takes_the_fast_quality(
    browser: Chromium, address: str, qualities: str
) -> None:
    browser.open(address + qualities)
    browser.wait_for("Boolean(globalThis.uvcloth)")
    browser.value(
        """(() => {
          const { playback } = uvcloth, old = playback.onFrame;
          playback.onFrame = (frame) => {
            if (uvcloth.beside.first.quality === "default") frame.answers[0].parts.cloth = 50;
            old(frame);
          };
        })()"""
    )
    browser.wait_for(
        "uvcloth.beside.first.quality === 'fast' && uvcloth.playback.panes[0].method.quality === 'fast'"
    )
    assert "it goes on in fast quality" in browser.value(SAID)
    assert browser.value("document.getElementById('quality').selectedOptions[0].text") == "fast"
    assert browser.errors == []


@needs_wasm
@needs_browser
def test_a_page_that_slept_goes_on_where_it_was(browser: Chromium, address: str) -> None:
    open_page(browser, address)
    browser.value(WATCH)
    before, after = browser.value(
        """(() => {
          const { playback } = uvcloth, before = playback.clock;
          playback.advance(3600);
          return [before, playback.clock];
        })()"""
    )
    assert after - before <= 3.0
    browser.wait_for("most.frames > 10")
    assert browser.value("most.joint") < 8.0
    assert browser.value(SAID) == ""
    assert browser.errors == []


@needs_wasm
@needs_browser
def test_a_browser_without_vectors_is_told_so(browser: Chromium, address: str) -> None:
    source = "WebAssembly.validate = () => false;"
    script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=source)
    try:
        browser.open(address)
        browser.wait_for(f"document.readyState === 'complete' && {SAID}.includes('SIMD')", 30.0)
    finally:
        browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script["identifier"])
    assert browser.value("document.getElementById('busy').hidden")
    assert browser.errors == []
