"""Baked files: joints of an animation as the runtime has them, and files that are cut, changed or others."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from tests.characters.made_up import rewritten
from tests.fuzz.glb_mutators import GLB
from tests.player.baked_box import CONTENT, FPS, FRAMES, outfit, transforms, write_baked_box
from tests.writers.glb_reader import GlbReader
from uvcloth.player.baked import EXTENSION, SCHEMA, open_baked

MUTANTS = 400


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_baked_box(tmp_path / "box.glb")


def skinned(path: Path) -> list[np.ndarray]:
    """Vertices of the coat in all frames, each moved by its only joint, with all that playing checks."""
    baked, (coat,) = open_baked(path), outfit().garments
    rest = coat.mesh.vertices.double().numpy()
    baked.require_fit(2, [len(rest)])
    assert len(baked.content) == len(CONTENT)
    moved = baked.motion(fps=FPS).transforms[:, coat.weights.argmax(1).numpy()]
    return list(np.einsum("fnab,nb->fna", moved[..., :3], rest) + moved[..., 3])


def test_joints_are_those_of_the_motion(path: Path) -> None:
    motion = open_baked(path).motion()
    assert (motion.fps, len(motion.times), motion.transforms.dtype) == (FPS, FRAMES, np.float64)
    np.testing.assert_allclose(motion.transforms, transforms(), atol=1e-6)
    twice = open_baked(path).motion(fps=2 * FPS)
    np.testing.assert_allclose(twice.transforms[::2], transforms(), atol=1e-6)


def test_viewers_see_what_the_joints_move(path: Path) -> None:
    baked, glb = open_baked(path), GlbReader.load(path)
    assert glb.gltf.extensionsUsed == [EXTENSION]
    assert not glb.gltf.extensionsRequired
    (garment,) = baked.garments
    assert len(garment.vertices) > garment.size == 8
    for frame, vertices in enumerate(skinned(path)):
        seen = glb.posed("coat", frame)
        np.testing.assert_allclose(seen, vertices[garment.vertices], atol=2e-6)
        shown = glb.skinned("coat", glb.morphed("coat", np.zeros(0)), glb.locals(frame))
        np.testing.assert_allclose(baked.in_scene(vertices)[garment.vertices], shown, atol=2e-6)
    worn = outfit()
    for name, mesh in (("body", worn.body.mesh), ("coat", worn.garments[0].mesh)):
        source = garment.vertices if name == "coat" else np.arange(len(mesh.vertices))
        rest = glb.posed(name, None)[: len(source)]
        np.testing.assert_allclose(rest, mesh.vertices.numpy()[source], atol=1e-6)


def put(*way: Any) -> Callable[[dict[str, Any]], None]:
    """A change that puts the last of some words at the place in the extension that the others lead to."""
    *holders, key, value = way

    def change(written: dict[str, Any]) -> None:
        place: Any = written["extensions"][EXTENSION]
        for holder in holders:
            place = place[holder]
        place[key] = value

    return change


def no_animation(written: dict[str, Any]) -> None:
    del written["animations"]


def no_extension(written: dict[str, Any]) -> None:
    del written["extensions"]


def in_a_moment(written: dict[str, Any]) -> None:
    """Keep the first key alone."""
    for sampler in written["animations"][0]["samplers"]:
        for each in (sampler["input"], sampler["output"]):
            written["accessors"][each]["count"] = 1


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (no_extension, "has no cloth to play .no extension UVCLOTH_cloth.; `uvcloth bake` writes such files"),
        (put("version", 2), "UVCLOTH_cloth is of version 2, this program reads version 1"),
        (put("version", "1"), "UVCLOTH_cloth.version is 1, expected a whole number from 0"),
        (put("bufferView", 999), "UVCLOTH_cloth.bufferView is 999, expected one of the"),
        (put("skin", 7), "UVCLOTH_cloth.skin is 7, expected one of the 1 skins"),
        (put("joints", []), "UVCLOTH_cloth.joints are 0, its skin has 2"),
        (put("garments", []), "UVCLOTH_cloth.garments are none"),
        (put("garments", 0, "node", 0), "hips, a garment of its cloth, has no mesh"),
        (put("garments", 0, "vertices", 0), "accessor 0 is MAT4 of 5126, expected SCALAR"),
        (put("axes", [1.0] * 16), "UVCLOTH_cloth.axes are not a rotation and a scale"),
        (put("axes", [float("nan")] * 16), "UVCLOTH_cloth.axes is .*, expected 16 numbers"),
        (no_animation, "has no animation of its skeleton"),
        (in_a_moment, "the animation lasts no time, expected two frames or more"),
    ],
)
def test_other_files_are_refused(path: Path, change: Callable[[dict[str, Any]], None], sentence: str) -> None:
    with pytest.raises(ValueError, match=rf"box\.glb: {sentence}"):
        skinned(rewritten(path, change))


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"none\.glb: cannot be read \(No such file"):
        open_baked(tmp_path / "none.glb")
    with pytest.raises(ValueError, match="no such file, this is a folder or a device"):
        open_baked(tmp_path)


def test_mutants_are_refused_or_played(path: Path) -> None:
    whole, mutant = path.read_bytes(), path.with_name("mutant.glb")
    refused = 0
    for number in range(MUTANTS):
        random = Random(number)
        content = bytearray(whole)
        match number % 4:
            case 0:
                content = content[: random.randrange(len(content))]
            case 1 | 2:
                for _ in range(random.choice((1, 2, 8))):
                    content[random.randrange(len(content))] ^= 1 << random.randrange(8)
        mutant.write_bytes(bytes(content))
        if number % 4 == 3:
            random.choice(GLB)(mutant, random)
        try:
            frames = skinned(mutant)
        except ValueError:
            refused += 1
        else:
            assert all(np.isfinite(frame).all() for frame in frames)
    assert refused > MUTANTS / 2


def test_the_page_has_every_entry_of_the_extension(path: Path) -> None:
    page = Path(__file__).parents[2] / "docs" / "runtime_file.md"
    rows = re.findall(r"^\| `(\w+)` \|", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert set(rows) == {"version", *SCHEMA}
    assert set(open_baked(path).file.document["extensions"][EXTENSION]) == set(rows)


def test_the_player_needs_numpy_alone() -> None:
    code = (
        "import sys, time; start = time.perf_counter()\n"
        "import numpy; numpy_took = time.perf_counter() - start\n"
        "from uvcloth.player import animation, baked, cloth, clearing, gltf_document, gltf_file, library\n"
        "from uvcloth.player import meshes, nodes, opening, sections, shell, surface_graph\n"
        "others = {name.partition('.')[0] for name in sys.modules} - set(sys.stdlib_module_names)\n"
        "own = sorted(name for name in sys.modules if name.startswith(('uvcloth.', 'rasterize')))\n"
        "print(sorted(others), [name for name in own if not name.startswith('uvcloth.player')])\n"
        "print(time.perf_counter() - start)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    named, seconds = done.stdout.splitlines()
    assert float(seconds) < 3.0  # 0.2 s where nothing else runs.
    for heavy in ("torch", "scipy", "numba", "warp", "trimesh"):
        assert heavy not in named
    assert named.endswith("[]"), "a module outside uvcloth.player"
