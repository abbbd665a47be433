"""`uvcloth page`: what is written, and how clothes move in a browser."""

import functools
import re
import threading
from collections.abc import Iterator
from dataclasses import replace
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tests.commands.chromium import PROGRAM, Chromium
from tests.glb_json import edited
from tests.motion.bvh_text import bvh_text, performer, still
from uvcloth.bodies.body import load_body
from uvcloth.commands import page_file
from uvcloth.commands.bake import Bake
from uvcloth.commands.bake_file import bake
from uvcloth.commands.page import Page
from uvcloth.commands.page_characters import add_clips
from uvcloth.commands.page_file import WASM, write_page
from uvcloth.commands.play_motion import retargeted
from uvcloth.dataset.clip import SimulatedClip, clip_of_garment
from uvcloth.dataset.clip_file import load_simulated, save_simulated
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit as Dressed
from uvcloth.garments.loading import load_outfit
from uvcloth.methods.registry import load_method
from uvcloth.motion.options import MotionOptions
from uvcloth.player.baked import EXTENSION, BakedFile, open_baked
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.rollout import rollout

needs_wasm = pytest.mark.skipif(
    not WASM.is_file(), reason="the runtime for WebAssembly is not compiled: make wasm"
)
needs_browser = pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")

FRAMES = 10
MILLIMETRE = 1e-3

RECORD = f"""new Promise((done) => {{
  const {{ playback }} = uvcloth, out = [];
  playback.onFrame = ({{ frame, joints, vertices }}) => {{
    out.push({{ frame, joints: [...joints], vertices: [...vertices[0]] }});
    if (out.length === {FRAMES}) done(out);
  }};
  playback.start(playback.clip, 0);
}})"""
"""Expression whose value is the first frames of the cloth, with the joints that it was given."""

PLAYING = "Boolean(globalThis.uvcloth?.playback.shown > 0.1)"
PAUSE = "document.getElementById('play').click()"
SETTLED = """(({ motion, settling, clock, next }) =>
  !motion.grip && settling === 0 && clock === next - 1)(uvcloth.playback)"""
SAID = "document.getElementById('message').textContent"


@pytest.fixture(scope="module")
def skirt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A skirt on the body of the package, which walks."""
    path = tmp_path_factory.mktemp("baked") / "a skirt & more.glb"
    bake(Bake(("skirt",), path, motion="walk", quality="fast", options=MotionOptions(frames="20:60")))
    add_clips(path, ("jump",))
    return path


@pytest.fixture(scope="module")
def folder(skirt: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The skirt's page, in a folder below that of a server."""
    out = tmp_path_factory.mktemp("site") / "below"
    write_page(Page(out, (skirt,)))
    return out


@pytest.fixture(scope="module")
def qualities(skirt: Path, folder: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page of a folder beside the skirt's, which has it in two qualities; its name."""
    fast = tmp_path_factory.mktemp("fast") / "another name.glb"
    fast.write_bytes(skirt.read_bytes())
    write_page(Page(folder / "qualities", (skirt,), fast=(fast,)))
    return "qualities/"


@pytest.fixture(scope="module")
def single(skirt: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The skirt's page in one file."""
    out = tmp_path_factory.mktemp("single") / "page.html"
    write_page(Page(out, (skirt,)))
    return out


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    """The address of the folder's page on a server of this machine."""
    handler = functools.partial(SimpleHTTPRequestHandler, directory=folder.parent)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/below/"
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    pytest.importorskip("websockets")
    with Chromium(tmp_path_factory.mktemp("browser")) as browser:
        yield browser


def hosts(text: str) -> set[str]:
    """Addresses of other hosts in a text, but for names of XML."""
    return set(re.findall(r"(?:https?|wss?)://[\w.]+", text)) - {"http://www.w3.org"}


@needs_wasm
def test_a_folder_has_all_that_it_needs(folder: Path, skirt: Path) -> None:
    names = {path.name for path in folder.iterdir()}
    assert {"index.html", "uvcloth.wasm", skirt.name} <= names
    for path in folder.glob("*.js"):
        text = path.read_text(encoding="utf-8")
        assert set(re.findall(r'from ?"\./([\w.]+)"', text)) <= names
        assert hosts(text) == set()
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert hosts(page) == set()
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert "script-src 'self' 'wasm-unsafe-eval'" in policy
    assert "unsafe-inline" not in policy
    assert '<option value="a%20skirt%20%26%20more.glb">a skirt &amp; more</option>' in page
    assert sum(path.stat().st_size for path in folder.iterdir()) - skirt.stat().st_size < 1.2e6


@needs_wasm
def test_a_single_file_holds_everything(single: Path, skirt: Path) -> None:
    text = single.read_text(encoding="utf-8")
    assert hosts(text) == set()
    assert not re.search(r'(src|href)="(?!data:)', text)
    assert single.stat().st_size < 1.4 * skirt.stat().st_size + 2e6


@needs_wasm
def test_bad_input_is_one_sentence(skirt: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.glb"
    cut.write_bytes(skirt.read_bytes()[:-100])
    for paths, words in (((cut,), r"cut\.glb"), ((skirt, skirt), "is there twice")):
        with pytest.raises(InputError, match=words):
            write_page(Page(tmp_path / "out", paths))
    assert not (tmp_path / "out").exists()


@needs_wasm
def test_the_fast_quality_has_to_be_of_the_same_garments(
    skirt: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    out = tmp_path_factory.mktemp("out")
    other = out / "other.glb"
    bake(Bake(("tops",), other, motion="walk", quality="fast", options=MotionOptions(frames="20:24")))
    for page, words in (
        (Page(out / "page", (skirt,), fast=(other,)), "other joints or garments"),
        (Page(out / "page", (skirt,), fast=(skirt, skirt)), "one for each"),
        (Page(out / "page", fast=(skirt,)), "name the files"),
    ):
        with pytest.raises(InputError, match=words):
            write_page(page)
    assert not (out / "page").exists()


def test_without_the_module_the_command_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(page_file, "WASM", tmp_path / "uvcloth.wasm")
    with pytest.raises(InputError, match="`make wasm`"):
        write_page(Page(tmp_path / "out"))


def open_page(browser: Chromium, address: str) -> None:
    """Open a page and wait until it plays, without shadows, which take longest without a graphics card."""
    browser.open(address)
    browser.wait_for("Boolean(globalThis.uvcloth)")
    browser.value("uvcloth.stage.light.castShadow = false")
    browser.wait_for(PLAYING)


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
def test_the_cloth_of_a_folder_is_that_of_the_runtime(browser: Chromium, address: str, skirt: Path) -> None:
    open_page(browser, address)
    check_cloth(browser, skirt)


@needs_wasm
@needs_browser
def test_the_cloth_of_a_single_file_is_that_of_the_runtime(
    browser: Chromium, single: Path, skirt: Path
) -> None:
    open_page(browser, single.as_uri())
    check_cloth(browser, skirt)


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


@needs_wasm
@needs_browser
@pytest.mark.parametrize(
    ("part", "way"),
    [("left_hand", (50.0, -80.0)), ("right_foot", (-60.0, -40.0)), ("hips", (-60.0, 50.0))],
)
def test_a_part_that_is_dragged_comes_to_the_pointer_and_stays_in_a_pause(
    browser: Chromium, address: str, part: str, way: tuple[float, float]
) -> None:
    open_page(browser, address)
    browser.value(f"{PAUSE}; {WATCH}")
    browser.wait_for(SETTLED)
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


FOOT = """(() => {
  const { figure } = uvcloth.playback;
  const joints = ["right_foot", "right_toes"].map((role) => figure.joints[role]);
  return joints.map((joint) => joint.matrixWorld.elements[13] - figure.floorOf(joint));
})()"""
"""Heights of the right foot and its toes over where they are on a figure that stands, m."""


@needs_wasm
@needs_browser
def test_a_foot_does_not_go_through_the_floor(browser: Chromium, address: str) -> None:
    open_page(browser, address)
    browser.value(f"{PAUSE}; {WATCH}")
    browser.wait_for(SETTLED)
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
    open_page(browser, address)
    browser.value(f"{PAUSE}; {WATCH}")
    browser.wait_for(SETTLED)
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


DROP = """(async () => {
  const file = new File([await (await fetch("%s")).arrayBuffer()], "%s");
  const data = new DataTransfer();
  data.items.add(file);
  dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true }));
})()"""


@needs_wasm
@needs_browser
def test_a_bvh_file_is_retargeted_as_the_laboratory_does_it(
    browser: Chromium, address: str, folder: Path, skirt: Path
) -> None:
    joints = performer()
    random = np.random.default_rng(5)
    values = still(joints, 40)
    values[:, 3:] = 25.0 * random.standard_normal(values.shape[1] - 3) * np.sin(np.arange(40) / 6.0)[:, None]
    first = np.cumsum([0, *(len(joint[3]) for joint in joints)])
    for index, joint in enumerate(joints):
        if joint[0] in ("LeftLeg", "RightLeg"):  # Knees bend backwards, and only so.
            values[:, first[index] : first[index] + 3] = np.abs(values[:, first[index], None]) * (0, 0, 1)
    values[:, :3] = np.linspace(0.0, 30.0, 40)[:, None] * (1.0, 0.0, 2.0) + (0.0, 40.0, 0.0)
    text = bvh_text(joints, values)
    refused = {
        "cut.bvh": (text[:-300], "is cut or damaged"),
        "odd.bvh": (text.replace("LeftUpLeg", "Bone7"), "`uvcloth bake --motion`"),
        "lying.bvh": (re.sub(r"OFFSET (\S+) -1(\d\.)", r"OFFSET \1 1\2", text), "`uvcloth bake --motion`"),
        "words.bvh": ("no motion", "no complete BVH"),
    }
    open_page(browser, address)
    for name, (damaged, words) in refused.items():
        (folder / name).write_text(damaged)
        browser.value(DROP % (name, name))
        browser.wait_for(f"{SAID}.startsWith('{name}')", 30.0)
        assert words in browser.value(SAID)
    (folder / "moves.bvh").write_text(text)
    browser.value(DROP % ("moves.bvh", "moves.bvh"))
    browser.wait_for("uvcloth.playback.clip.name === 'moves.bvh'", 30.0)
    assert browser.value(SAID) == ""
    frames = browser.value(
        """(() => {
          const { playback: { motion }, cloth } = uvcloth, out = [];
          for (let frame = 0; frame < 40; frame++) {
            motion.begin(motion.clip, frame / 30);
            motion.next(false);
            out.push([...cloth.transforms()]);
          }
          return out;
        })()"""
    )
    frames = np.reshape(frames, (40, -1, 3, 4))
    expected = retargeted(open_baked(skirt), str(folder / "moves.bvh"), MotionOptions()).transforms
    np.testing.assert_allclose(frames[..., :3], expected[..., :3], atol=1e-4)
    np.testing.assert_allclose(frames[..., :2, 3], expected[..., :2, 3], atol=1e-3)
    # The laboratory puts the lowest skin on the floor, the page the lowest joint of the feet.
    higher = frames[..., 2, 3] - expected[..., 2, 3]
    np.testing.assert_allclose(higher, higher.mean(), atol=1e-3)
    assert abs(higher.mean()) < 0.15
    assert browser.errors == []


PANES = """new Promise((done) => {
  const { playback } = uvcloth, out = [];
  playback.onFrame = ({ joints, answers }) => {
    out.push({ joints: [...joints], panes: answers.map(({ vertices }) => [...vertices[0]]) });
    if (out.length === 10) done(out);
  };
  playback.start(playback.clip, 0);
})"""


@needs_wasm
@needs_browser
def test_methods_are_shown_beside_each_other(
    browser: Chromium, address: str, qualities: str, skirt: Path
) -> None:
    open_page(browser, address + qualities)
    browser.value("uvcloth.beside.choose(uvcloth.beside.methods)")
    browser.wait_for("document.querySelectorAll('.label').length === 3")
    names = browser.value("[...document.querySelectorAll('.label')].map((each) => each.textContent)")
    for name, start in zip(names, ("cloth, default", "cloth, fast", "skinning"), strict=True):
        assert name.startswith(f"{start}live")
    # Side by side, of one size.
    places = browser.value("uvcloth.stage.panes")
    assert len({(each["width"], each["top"]) for each in places}) == 1
    assert places[0]["left"] + places[0]["width"] < places[1]["left"]
    frames = browser.value(PANES)
    baked = open_baked(skirt)
    points, weights = skinned_garment(baked)
    for frame in frames:
        joints = np.reshape(frame["joints"], (-1, 3, 4))
        own, other, skinned = (np.reshape(each, (-1, 3)) for each in frame["panes"])
        # The same outfit in both qualities here: the second runtime knows nothing of the first.
        np.testing.assert_array_equal(own, other)
        blended = np.einsum("nj,jrc->nrc", weights, joints)
        expected = np.einsum("nrc,nc->nr", blended[..., :3], points) + blended[..., 3]
        np.testing.assert_allclose(skinned, baked.in_scene(expected), atol=1e-5)
    assert browser.errors == []


def skinned_garment(baked: BakedFile) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of the only garment at rest, in the runtime's world, and their blend weights (N, J)."""
    (garment,) = baked.garments
    (primitive,) = baked.file.entries("meshes")[baked.file.entries("nodes")[garment.node]["mesh"]][
        "primitives"
    ]
    names = primitive["attributes"]
    place, joints, shares = (
        baked.file.array(names[name], kind)
        for name, kind in (("POSITION", "VEC3"), ("JOINTS_0", "VEC4"), ("WEIGHTS_0", "VEC4"))
    )
    points, weights = np.zeros((garment.size, 3)), np.zeros((garment.size, len(baked.skin.nodes)))
    points[garment.vertices] = place @ baked.skin.axes[:3, :3].T
    weights[garment.vertices[:, None], joints] = shares / shares.sum(1, keepdims=True)
    return points, weights


WARM_UP, LIFTED = 4, 0.01
"""Frames of the simulation below that do not count, and metres that its prediction is too high."""


def played(path: Path, frames: int) -> SimulatedClip:
    """The first animation of a garment's file as a simulation, by the runtime that the page has too."""
    baked = open_baked(path)
    transforms, cloth = baked.motion(fps=30.0).transforms[:frames], Cloth(Outfit(baked.content))
    cloth.start(transforms[0])
    vertices = []
    for joints in transforms:
        cloth.step(joints, 1.0 / 30.0)
        vertices.append(cloth.vertices(0))
    (garment,) = baked.garments
    rest, _ = skinned_garment(baked)
    node = baked.file.entries("nodes")[garment.node]
    (primitive,) = baked.file.entries("meshes")[node["mesh"]]["primitives"]
    faces = garment.vertices[baked.file.array(primitive["indices"], "SCALAR").reshape(-1, 3)]
    return clip_of_garment(
        torch.from_numpy(np.array(vertices, np.float32)),
        torch.from_numpy(faces),
        torch.from_numpy(rest.astype(np.float32)),
        torch.from_numpy(transforms.astype(np.float32)),
        30.0,
        WARM_UP,
        {"clip": "a walk", "garment": garment.name},
    )


@pytest.fixture(scope="module")
def simulation(skirt: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A simulation of the skirt, and a prediction of it that lacks the warm-up."""
    folder, clip = tmp_path_factory.mktemp("simulation"), played(skirt, 24)
    sequence, predicted = folder / "sequence.npz", folder / "predicted.npz"
    save_simulated(clip, sequence)
    np.savez(
        predicted, vertices=clip.vertices.numpy()[WARM_UP:] + np.array([0, 0, LIFTED], np.float32), fps=30.0
    )
    return sequence, predicted


@needs_wasm
@needs_browser
def test_errors_are_those_against_the_stored_simulation(
    browser: Chromium, folder: Path, address: str, skirt: Path, simulation: tuple[Path, Path]
) -> None:
    sequence, predicted = simulation
    write_page(Page(folder / "compared", (skirt,), simulated=sequence, predicted=(f"lifted={predicted}",)))
    browser.open(f"{address}compared/")
    browser.wait_for("Boolean(globalThis.uvcloth)")
    browser.value("uvcloth.stage.light.castShadow = false")
    # The cloth is measured where it has come the whole way; a second time round it starts from the same rest.
    names = "[...document.querySelectorAll('.label')].map((each) => each.textContent)"
    browser.wait_for(f"{names}.length === 4")
    browser.wait_for(
        """uvcloth.beside.wanted.every(
          (each) => each.isTruth || uvcloth.comparison.errors.mean(each).share === 1)"""
    )
    assert browser.value(names) == [
        "cloth, as it was bakedlive",
        "simulationstored frames",
        "liftedstored frames",
        "skinninglive",
    ]
    curves = browser.value(
        """uvcloth.beside.methods.map((method) =>
          [method.name, [...uvcloth.comparison.errors.curve(method)]])"""
    )
    errors = {name: np.array(curve, dtype=float) for name, curve in curves}
    # Stored frames are rounded to 0.05 mm; compilers round in other ways, and cloth goes apart from there.
    assert np.max(errors["cloth"][:10]) < 0.1
    assert np.max(errors["cloth"]) < 5.0
    assert np.isnan(errors["lifted"][:WARM_UP]).all()
    np.testing.assert_allclose(errors["lifted"][WARM_UP:], 1000 * LIFTED, atol=0.1)
    clip, (points, weights) = load_simulated(sequence), skinned_garment(open_baked(skirt))
    blended = np.einsum("nj,fjrc->fnrc", weights, clip.transforms.numpy())
    skinned = np.einsum("fnrc,nc->fnr", blended[..., :3], points) + blended[..., 3]
    expected = 1000 * np.linalg.norm(skinned - clip.vertices.numpy(), axis=2).mean(1)
    np.testing.assert_allclose(errors["skinning"], expected, atol=0.01)
    # What is told is the mean of the frames after the warm-up.
    texts = "[...document.querySelectorAll('.figures .error')].map((each) => each.textContent)"
    browser.wait_for(f"!{texts}.join().includes('…')")
    told = browser.value(texts)
    assert told[1:] == ["", f"{1000 * LIFTED:.1f} mm", f"{expected[WARM_UP:].mean():.1f} mm"]
    stored = browser.value("[...uvcloth.comparison.errors.truth.vertices(7)]")
    np.testing.assert_allclose(np.reshape(stored, (-1, 3)), clip.vertices.numpy()[7], atol=1e-6)
    # A time that is chosen is shown at once where no cloth has to come to rest.
    browser.value("uvcloth.playback.preview(uvcloth.playback.clip, 0.5)")
    assert browser.value("uvcloth.playback.panes.map(({ isThere }) => isThere)") == [False, True, True, True]
    # A hand leads the figure away from its stored frames.
    browser.value("uvcloth.playback.start(uvcloth.playback.clip, 0.3); uvcloth.playback.toggle()")
    browser.wait_for("uvcloth.playback.panes[0].isThere")
    drag(browser, "left_hand", (20.0, -30.0))
    browser.wait_for("!uvcloth.playback.panes[1].isThere && uvcloth.playback.panes[0].isThere")
    browser.wait_for("document.querySelectorAll('.note:not([hidden])').length === 2")
    assert browser.errors == []


@needs_wasm
@needs_browser
def test_a_recurrent_rig_moves_as_in_python(
    browser: Chromium, folder: Path, address: str, tmp_path: Path
) -> None:
    baked, sequence = tmp_path / "tops.glb", tmp_path / "sequence.npz"
    bake(Bake(("tops",), baked, motion="jump", quality="fast", options=MotionOptions(frames="20:40")))
    save_simulated(played(baked, 16), sequence)
    write_page(Page(folder / "learned", (baked,), simulated=sequence, model=("recurrent", "lbs_smooth")))
    browser.open(f"{address}learned/")
    browser.wait_for("Boolean(globalThis.uvcloth)")
    browser.value("uvcloth.stage.light.castShadow = false")
    browser.wait_for("document.querySelectorAll('.label').length === 4")
    names = browser.value("uvcloth.playback.panes.map(({ method: { name, kind } }) => `${name}, ${kind}`)")
    assert names[1:] == ["simulation, stored frames", "recurrent, live", "lbs_smooth, stored frames"]
    frames = browser.value(
        """new Promise((done) => {
          const { playback } = uvcloth, out = [];
          playback.onFrame = ({ answers }) => {
            out.push(answers.slice(2).map(({ vertices }) => [...vertices[0]]));
            if (out.length === 16) done(out);
          };
          playback.start(playback.clip, 0);
        })"""
    )
    body, clip = load_body(), load_simulated(sequence)
    outfit = Dressed(body, load_outfit(("tops",), body))
    for place, name in enumerate(("recurrent", "lbs_smooth")):
        rolled = rollout(load_method(name, body), outfit, clip.transforms.double(), 30.0, clear=False)
        expected = torch.stack([frame.in_world().vertices[0] for frame in rolled]).numpy()
        shown = np.array([frame[place] for frame in frames]).reshape(expected.shape)
        off = np.linalg.norm(shown - open_baked(baked).in_scene(expected), axis=2) / MILLIMETRE
        print(name, "mm off, mean and largest:", off.mean(), off.max())
        assert off.max() < 0.2
    assert browser.errors == []


@needs_wasm
def test_models_need_a_template_that_they_know(
    skirt: Path, simulation: tuple[Path, Path], tmp_path: Path
) -> None:
    sequence, _ = simulation
    for model, words in (("recurrent", "is for the templates"), ("nobody", "nobody")):
        with pytest.raises(InputError, match=words):
            write_page(Page(tmp_path / "out", (skirt,), simulated=sequence, model=(model,)))
    assert not (tmp_path / "out").exists()


@needs_wasm
def test_a_simulation_has_to_be_of_the_garment(
    skirt: Path, simulation: tuple[Path, Path], tmp_path: Path
) -> None:
    sequence, predicted = simulation
    clip = load_simulated(sequence)
    (garment,) = clip.garments
    changed = {
        "torn.npz": replace(clip, garments=(replace(garment, faces=garment.faces[:-1]),)),
        "larger.npz": replace(clip, garments=(replace(garment, rest=1.1 * garment.rest),)),
        "film.npz": replace(clip, fps=24.0),
        "fewer.npz": replace(clip, transforms=clip.transforms[:, :-1]),
    }
    for name, each in changed.items():
        save_simulated(each, tmp_path / name)
    np.savez(tmp_path / "short.npz", vertices=garment.vertices[:5].numpy())
    out = tmp_path / "out"
    for page, words in (
        (Page(out, (skirt,), simulated=tmp_path / "torn.npz"), "their faces differ"),
        (Page(out, (skirt,), simulated=tmp_path / "larger.npz"), "another mesh than that"),
        (Page(out, (skirt,), simulated=tmp_path / "film.npz"), "24 frames per second"),
        (Page(out, (skirt,), simulated=tmp_path / "fewer.npz"), "joints, the body of"),
        (Page(out, (skirt, skirt), simulated=sequence), "on one file"),
        (Page(out, (skirt,), predicted=("a=b",)), "--predicted: needs --simulated"),
        (Page(out, (skirt,), simulated=sequence, predicted=("a=b",)), "no such file"),
        (Page(out, (skirt,), simulated=sequence, predicted=(f"a={tmp_path / 'short.npz'}",)), "has 5 frames"),
        (Page(out, (skirt,), simulated=sequence, predicted=(f"skinning={predicted}",)), "another method"),
    ):
        with pytest.raises(InputError, match=words):
            write_page(page)
    assert not out.exists()


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


def make_newer(document: dict[str, Any]) -> None:
    """Raise the version of the cloth."""
    document["extensions"][EXTENSION]["version"] = 2


def animate_others(document: dict[str, Any]) -> None:
    """Give animations to a node that is no joint."""
    document["nodes"].append({"name": "a lamp"})
    document["scenes"][0]["nodes"].append(len(document["nodes"]) - 1)
    for animation in document["animations"]:
        for channel in animation["channels"]:
            channel["target"]["node"] = len(document["nodes"]) - 1


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


@needs_wasm
@needs_browser
def test_a_dropped_file_is_played_or_refused_with_a_sentence(
    browser: Chromium, address: str, folder: Path, skirt: Path
) -> None:
    content = skirt.read_bytes()
    refused = {
        "cut.glb": (content[: len(content) // 2], "it is cut"),
        "text.glb": (b"no file of this kind, but some words", "no binary glTF"),
        "plain.glb": (
            edited(content, lambda document: document["extensions"].clear()),
            f"no extension {EXTENSION}",
        ),
        "other.glb": (edited(content, animate_others), "other joints than those of its cloth"),
        "newer.glb": (edited(content, make_newer), "of version 2"),
    }
    open_page(browser, address)
    browser.value("globalThis.before = uvcloth.cloth; 0")
    for name, (damaged, words) in refused.items():
        (folder / name).write_bytes(damaged)
        browser.value(DROP % (name, name))
        browser.wait_for(f"{SAID}.startsWith('{name}')")
        assert words in browser.value(SAID)
        assert browser.value("document.getElementById('character').value") == "a%20skirt%20%26%20more.glb"
    # What was shown before plays on, and a whole file is played.
    time = browser.value("uvcloth.playback.shown")
    browser.wait_for(f"uvcloth.playback.shown !== {time}")
    browser.value(DROP % ("a%20skirt%20%26%20more.glb", "again.glb"))
    browser.wait_for(f"uvcloth.cloth !== before && {PLAYING} && {SAID} === ''")
    assert browser.errors == []
