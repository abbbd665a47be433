"""The page of `uvcloth page`: methods beside each other, and their errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.commands.chromium import Chromium
from tests.commands.page.opened import MILLIMETRE, drag, needs_browser, needs_wasm, open_page
from uvcloth.bodies.body import load_body
from uvcloth.commands.bake import Bake
from uvcloth.commands.page import Page
from uvcloth.commands.run.bake import bake
from uvcloth.commands.run.page import write_page
from uvcloth.dataset.clip import SimulatedClip, clip_of_garment
from uvcloth.dataset.clip_file import load_simulated, save_simulated
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit as Dressed
from uvcloth.garments.loading import load_outfit
from uvcloth.methods.capabilities import before_finish
from uvcloth.methods.registry import load_method
from uvcloth.motion.options import MotionOptions
from uvcloth.player.baked import BakedFile, open_baked
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.rollouts.rollout import rollout

PANES = """new Promise((done) => {
  const { playback } = uvcloth, out = [];
  playback.onFrame = ({ joints, answers }) => {
    out.push({ joints: [...joints], panes: answers.map(({ vertices }) => [...vertices[0]]) });
    if (out.length === 10) done(out);
  };
  playback.start(playback.clip, 0);
})"""

WARM_UP, LIFTED = 4, 0.01
"""Frames of the simulation below that do not count, and metres that its prediction is too high."""


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
def test_models_move_as_in_python(browser: Chromium, folder: Path, address: str, tmp_path: Path) -> None:
    baked, sequence = tmp_path / "tops.glb", tmp_path / "sequence.npz"
    bake(Bake(("tops",), baked, motion="jump", quality="fast", options=MotionOptions(frames="20:40")))
    save_simulated(played(baked, 16), sequence)
    kinds = {"recurrent": "live", "pbns": "live", "deepsd": "live", "lbs_smooth": "stored frames"}
    write_page(Page(folder / "learned", (baked,), simulated=sequence, model=tuple(kinds)))
    browser.open(f"{address}learned/")
    browser.wait_for("Boolean(globalThis.uvcloth)")
    browser.value("uvcloth.stage.light.castShadow = false")
    body, clip = load_body(), load_simulated(sequence)
    outfit = Dressed(body, load_outfit(("tops",), body))
    for names in (("recurrent", "lbs_smooth"), ("pbns", "deepsd")):
        for name, shown in zip(names, frames_beside(browser, names, 16), strict=True):
            kind = browser.value(f"uvcloth.beside.methods.find((each) => each.name === '{name}').kind")
            assert kind == kinds[name]
            method = before_finish(load_method(name, body))
            rolled = rollout(method, outfit, clip.transforms.double(), 30.0, clear=False)
            expected = torch.stack([frame.in_world().vertices[0] for frame in rolled]).numpy()
            off = np.linalg.norm(shown - open_baked(baked).in_scene(expected), axis=2) / MILLIMETRE
            print(name, "mm off, mean and largest:", off.mean(), off.max())
            assert off.max() < 0.2
    assert browser.errors == []


def frames_beside(browser: Chromium, names: tuple[str, ...], count: int) -> list[np.ndarray]:
    """The first frames (F, N, 3) of the only garment by methods that are shown beside the cloth."""
    browser.value(
        f"uvcloth.beside.choose(uvcloth.beside.methods.filter(({{ name }}) => {list(names)}.includes(name)))"
    )
    panes = "uvcloth.playback.panes.slice(1).map(({ method }) => method.name).join()"
    browser.wait_for(f"{panes} === '{','.join(names)}'")
    frames = browser.value(
        f"""new Promise((done) => {{
          const {{ playback }} = uvcloth, out = [];
          playback.onFrame = ({{ answers }}) => {{
            out.push(answers.slice(1).map(({{ vertices }}) => [...vertices[0]]));
            if (out.length === {count}) done(out);
          }};
          playback.start(playback.clip, 0);
        }})"""
    )
    return list(np.array(frames).reshape(count, len(names), -1, 3).swapaxes(0, 1))


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
