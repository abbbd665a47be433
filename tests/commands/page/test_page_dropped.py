"""The page of `uvcloth page`: files that are dropped on it."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from tests.commands.chromium import Chromium
from tests.commands.page.opened import DROP, PLAYING, SAID, needs_browser, needs_wasm, open_page
from tests.glb_json import edited
from tests.motion.bvh_text import bvh_text, performer, still
from uvcloth.commands.run.play_motion import retargeted
from uvcloth.motion.options import MotionOptions
from uvcloth.player.baked import EXTENSION, open_baked


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
    note = "document.getElementById('retargeted').hidden"
    assert browser.value(note)
    (folder / "moves.bvh").write_text(text)
    browser.value(DROP % ("moves.bvh", "moves.bvh"))
    browser.wait_for(f"uvcloth.playback.clip.name === 'moves.bvh' && !{note}", 30.0)
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
